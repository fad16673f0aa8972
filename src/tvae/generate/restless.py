"""Bots that do not wait longer than people did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.rollouts import Policy
from tvae.spaces import FloatArray, IntArray

_RARE = 0.999


class Restless:
    """A policy that does something at random where nothing has changed for longer than people ever let it.

    Two bots in each other's way, or one before a machine that it cannot use, may find themselves where people hardly
    ever were, and wait for ever: what people did there was to wait a moment. So where an observation has stayed the
    same for more steps than 99.9 % of the rests in the demonstrations, the next action is one of those after which
    something changed in the demonstrations, drawn at random, until something changes. Carroll et al. 2019
    (arXiv 1910.05789) free their cloned players in a like way. Where every step changes something, as in worlds of
    numbers, nothing is different.

    A `Policy` around another, of a T-VAE or any. Raises `DataError` for demonstrations in which nothing ever changes.

    >>> from tvae.data.arrays import from_arrays
    >>> class Waiting:
    ...     def reset(self, num_episodes, seed): pass
    ...     def act(self, observations): return np.zeros((len(observations), 1))
    >>> walks = from_arrays([np.array([[0.0], [0.0], [1.0], [2.0]])], [np.array([[0.0], [5.0], [5.0]])])
    >>> bot = Restless(Waiting(), walks)
    >>> bot.reset(1, seed=0)
    >>> bot.longest_rest, [bot.act(np.array([[7.0]])).item() for _ in range(4)]
    (1, [0.0, 0.0, 5.0, 5.0])
    """

    def __init__(self, policy: Policy, demonstrations: Demonstrations) -> None:
        self.policy = policy
        rests, effective = [], []
        for episode in demonstrations:
            observations = episode.observations
            changed = (observations[1:] != observations[:-1]).any(axis=1)
            effective.append(episode.actions[: len(changed)][changed])
            rests.append(_rests(changed))
        self._effective = np.concatenate(effective)
        if not len(self._effective):
            raise DataError("what ends a rest needs demonstrations in which something changes, got none")
        self.longest_rest = int(np.quantile(np.concatenate(rests), _RARE, method="higher"))
        """Steps without any change that are not yet too many."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self.policy.reset(num_episodes, seed)
        self._random = np.random.default_rng((seed, 1))
        self._before = np.full((num_episodes, 1), np.nan)
        self._rested = np.zeros(num_episodes, dtype=np.int64)

    def act(self, observations: FloatArray) -> FloatArray:
        """Actions (N, A) for the present observations (N, O)."""
        actions = self.policy.act(observations)
        self._rested = np.where((observations == self._before).all(axis=1), self._rested + 1, 0)
        self._before = observations.copy()
        weary = np.flatnonzero(self._rested > self.longest_rest)
        if len(weary):
            actions = actions.copy()
            actions[weary] = self._effective[self._random.integers(len(self._effective), size=len(weary))]
        return actions


def _rests(changed: NDArray[np.bool_]) -> IntArray:
    """How many steps without a change came before each change.

    >>> _rests(np.array([True, False, False, True])).tolist()
    [0, 2]
    """
    at = np.flatnonzero(changed)
    lengths: IntArray = np.diff(at, prepend=-1) - 1
    return lengths
