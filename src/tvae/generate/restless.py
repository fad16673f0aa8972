"""Bots that do not wait longer than people did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.distributions import RowDistribution
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import LatentSource, Tempered
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray

_COMMON = 0.99
_MOST_DRAWS = 16
_HOT = 1.5


class Restless(LatentPolicy):
    """A bot that tries something else where nothing has changed for longer than people mostly let it.

    Two bots in each other's way, or one before a machine that it cannot use, may find themselves where people hardly
    ever were, and wait for ever: what people did there was to wait a moment. `longest_rest` is as long as 99 % of the
    rests between two changes of the demonstrations' observations. Where a rest has lasted r > 0 steps more, the next
    action is drawn from p^(1/T) with T = (1 + r) `temperature`, and drawn again, up to 16 times, while it is one that
    was tried in this rest and changed nothing. For `longest_rest` steps after such a rest T is at least 1.5, so that
    the two do not fall back into the same one. Elsewhere T is `temperature`. Where every step changes something, as in
    worlds of numbers, it is `LatentPolicy`.

    Carroll et al. 2019 (arXiv 1910.05789) free their cloned players by a random action.

    Raises `DataError` for demonstrations in which nothing ever changes.

    >>> from tvae.data.arrays import from_arrays
    >>> from tvae.model.decoding import Fixed
    >>> walks = from_arrays([np.array([[0.0], [0.0], [1.0], [2.0]])], [np.array([[0.0], [5.0], [5.0]])])
    >>> model = TrajectoryVAE(walks.observation_space, walks.action_space)
    >>> Restless(model, Fixed(np.zeros(2)), walks).longest_rest
    1
    """

    def __init__(
        self,
        model: TrajectoryVAE,
        latents: LatentSource,
        demonstrations: Demonstrations,
        *,
        temperature: float = 1.0,
        window: int | None = None,
    ) -> None:
        super().__init__(model, latents, choice=Tempered(temperature), window=window)
        self.temperature = temperature
        rests = []
        for episode in demonstrations:
            changed = (episode.observations[1:] != episode.observations[:-1]).any(axis=1)
            rests.append(_rests(changed))
        lengths = np.concatenate(rests)
        if not len(lengths):
            raise DataError("how long people rest needs demonstrations in which something changes, got none")
        self.longest_rest = int(np.quantile(lengths, _COMMON, method="higher"))
        """Steps without any change that are not yet too many."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes, each with a z of its own."""
        super().reset(num_episodes, seed)
        self._before = np.full((num_episodes, 1), np.nan)
        self._rested = np.zeros(num_episodes, dtype=np.int64)
        self._hot = np.zeros(num_episodes, dtype=np.int64)
        self._tried: list[set[bytes]] = [set() for _ in range(num_episodes)]

    def choose(self, law: RowDistribution, observations: FloatArray) -> Tensor:
        """Values of the next actions (N, A)."""
        still = (observations == self._before).all(axis=1)
        freed = ~still & (self._rested > self.longest_rest)
        self._rested = np.where(still, self._rested + 1, 0)
        self._hot = np.where(freed, self.longest_rest, np.maximum(self._hot - 1, 0))
        self._before = observations.copy()
        for copy in np.flatnonzero(~still):
            self._tried[copy].clear()
        too_long = np.maximum(self._rested - self.longest_rest, 0)
        temperature = self.temperature * (1 + too_long)
        temperature[self._hot > 0] = max(_HOT, self.temperature)
        actions = law.sample()
        for level in np.unique(temperature):
            tempered, asked = law.tempered(float(level)), temperature == level
            for _ in range(_MOST_DRAWS):
                actions[asked] = tempered.sample()[asked]
                asked &= too_long > 0
                asked &= [_key(row) in tried for row, tried in zip(actions, self._tried, strict=True)]
                if not asked.any():
                    break
        for row, tried in zip(actions, self._tried, strict=True):
            tried.add(_key(row))
        return actions


def _key(row: Tensor) -> bytes:
    """What is the same for the same action."""
    return row.cpu().numpy().tobytes()


def _rests(changed: NDArray[np.bool_]) -> IntArray:
    """How many steps without a change came before each change.

    >>> _rests(np.array([True, False, False, True])).tolist()
    [0, 2]
    """
    at = np.flatnonzero(changed)
    lengths: IntArray = np.diff(at, prepend=-1) - 1
    return lengths
