"""Bots that do not wait, or go to and fro, longer than people did."""

from __future__ import annotations

from collections import deque

import numpy as np
from torch import Tensor

from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.distributions import RowDistribution
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import LatentSource, Tempered
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray

_COMMON = 0.99
_MOST_STEPS = 200_000
"""Of demonstrations whose rests are looked at; of more, evenly spaced episodes."""
_REMEMBERED = 16
_MOST_DRAWS = 16
_HOT = 1.5


class Restless(LatentPolicy):
    """A bot that tries something else where nothing new has been seen for longer than people mostly let it.

    Two bots in each other's way, or one before a machine that it cannot use, may find themselves where people hardly
    ever were, and wait for ever, or step aside and back: what people did there was to wait a moment. An observation is
    new that is none of the 16 before it, and a rest is a run of those that are not. `longest_rest` is as long as 99 %
    of the demonstrations' rests between two new observations. Where a rest has lasted r > 0 steps more, the next action
    is drawn from p^(1/T) with T = (1 + r) `temperature`, and drawn again, up to 16 times, while it is one that was
    tried at this observation in this rest. For `longest_rest` steps after such a rest T is at least 1.5, so that the
    two do not fall back into the same one. Elsewhere T is `temperature`. Where every observation is new, as in worlds
    of numbers, it is `LatentPolicy`.

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
        some = evenly(demonstrations, _MOST_STEPS)
        lengths = np.concatenate([_rests(episode.observations) for episode in some])
        if not len(lengths):
            raise DataError("how long people rest needs demonstrations in which something changes, got none")
        self.longest_rest = int(np.quantile(lengths, _COMMON, method="higher"))
        """Steps without anything new that are not yet too many."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes, each with a z of its own."""
        super().reset(num_episodes, seed)
        self._memories = [_Memory() for _ in range(num_episodes)]
        self._rested = np.zeros(num_episodes, dtype=np.int64)
        self._hot = np.zeros(num_episodes, dtype=np.int64)
        self._tried: list[set[tuple[bytes, bytes]]] = [set() for _ in range(num_episodes)]

    def choose(self, law: RowDistribution, observations: FloatArray) -> Tensor:
        """Values of the next actions (N, A)."""
        seen = [row.tobytes() for row in observations]
        still = np.array([memory.knew(key) for memory, key in zip(self._memories, seen, strict=True)])
        freed = ~still & (self._rested > self.longest_rest)
        self._rested = np.where(still, self._rested + 1, 0)
        self._hot = np.where(freed, self.longest_rest, np.maximum(self._hot - 1, 0))
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
                asked &= [pair in tried for pair, tried in zip(_pairs(seen, actions), self._tried, strict=True)]
                if not asked.any():
                    break
        for pair, tried in zip(_pairs(seen, actions), self._tried, strict=True):
            tried.add(pair)
        return actions


class _Memory:
    """What was seen last."""

    def __init__(self) -> None:
        self._last: deque[bytes] = deque(maxlen=_REMEMBERED)

    def knew(self, seen: bytes) -> bool:
        """Whether this is among it; from now on it is."""
        known = seen in self._last
        self._last.append(seen)
        return known


def _pairs(seen: list[bytes], actions: Tensor) -> list[tuple[bytes, bytes]]:
    """What is the same for the same action at the same observation."""
    return [(key, row.cpu().numpy().tobytes()) for key, row in zip(seen, actions, strict=True)]


def _rests(observations: FloatArray) -> IntArray:
    """How many steps without anything new came before each new observation, but for the first.

    >>> _rests(np.array([[1.0], [2.0], [1.0], [2.0], [3.0], [4.0]])).tolist()
    [0, 2, 0]
    """
    memory = _Memory()
    new = np.array([not memory.knew(row.tobytes()) for row in observations])
    lengths: IntArray = np.diff(np.flatnonzero(new)) - 1
    return lengths
