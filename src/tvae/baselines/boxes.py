"""Actions as points of a Box, for learners that act in nothing else, and back.

One number b of the Box for each signal of an action, K for a categorical one; at b ~ N(0, I) actions are about as
spread as those of the demonstrations, with mean m, standard deviation s and rate p measured on them:

| signal        | its action                        | measured                                     |
|---------------|-----------------------------------|----------------------------------------------|
| `Continuous`  | m + s b                           | m, s                                         |
| `Angular`     | m + s b, wrapped                  | circular mean and circular standard deviation |
| `Binary`      | 1 where b > q, P(N(0, 1) > q) = p | p, at least 1 in 1,000 and at most all but that |
| `Categorical` | the category of the largest b     |                                              |
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from gymnasium import spaces as gym
from scipy.stats import norm

from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.gymnasium_spaces import wrap
from tvae.spaces import FloatArray, IntArray, Space

MOST = 10.0
"""Farthest from 0 that a number of the Box may be."""
_RAREST = 1e-3
_NARROWEST = 1e-3
_FEWEST = 1e-4
"""Smallest probability of a choice that noise must make."""
_GUMBEL = math.pi / math.sqrt(6)
"""Standard deviation of the noise with which the largest log-probability would be a draw."""


class BoxActions:
    """Actions of `space` from points of a Box.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> box = BoxActions(zombie_demonstrations(20))
    >>> rows = np.array([[0.0, 0.5], [1.0, -3.0]])
    >>> box.space.shape, np.allclose(box.raw(box.points(rows)), rows)
    ((2,), True)
    """

    def __init__(self, demonstrations: Demonstrations) -> None:
        signals = self.signals = demonstrations.action_space
        rows = demonstrations.actions[ranges(demonstrations.action_starts, demonstrations.lengths)]
        self._mean, self._scale = rows.mean(0), np.maximum(rows.std(0), _NARROWEST)
        angles = np.exp(1j * rows[:, signals.angular]).mean(0)
        self._mean[signals.angular] = np.angle(angles)
        spread = np.sqrt(-2 * np.log(np.clip(np.abs(angles), _NARROWEST, 1)))
        self._scale[signals.angular] = np.maximum(spread, _NARROWEST)
        rates = np.clip(rows[:, signals.binary].mean(0), _RAREST, 1 - _RAREST)
        self._threshold: FloatArray = norm.isf(rates)
        self._columns = _columns(signals)
        self.choices: IntArray = np.concatenate(
            [self._columns[column] for column in (*signals.binary, *signals.categorical)] or [[]]
        ).astype(np.int64)
        """Numbers of the Box that choose rather than measure: of binary and of categorical signals."""

    @property
    def space(self) -> gym.Box:
        """The Box."""
        return gym.Box(-MOST, MOST, shape=(sum(len(part) for part in self._columns),), dtype=np.float32)

    def raw(self, points: FloatArray) -> FloatArray:
        """(N, A) actions of points (N, B), first clipped to the Box."""
        points = points.clip(-MOST, MOST)
        rows = np.empty((len(points), self.signals.num_columns))
        for column, part in enumerate(self._columns):
            rows[:, column] = points[:, part].argmax(1) if len(part) > 1 else points[:, part[0]]
        for columns in (self.signals.continuous, self.signals.angular):
            rows[:, columns] = self._mean[columns] + self._scale[columns] * rows[:, columns]
        rows[:, self.signals.angular] = wrap(rows[:, self.signals.angular])
        rows[:, self.signals.binary] = rows[:, self.signals.binary] > self._threshold
        return rows

    def points(self, rows: FloatArray) -> FloatArray:
        """(N, B) a point of each action (N, A): of a yes or no one that is 1 from the threshold."""
        centred = rows - self._mean
        centred[:, self.signals.angular] = wrap(centred[:, self.signals.angular])
        numbers = centred / self._scale
        numbers[:, self.signals.binary] = self._threshold + 2 * rows[:, self.signals.binary] - 1
        parts = [
            np.eye(len(part))[rows[:, column].astype(np.int64)] if len(part) > 1 else numbers[:, [column]]
            for column, part in enumerate(self._columns)
        ]
        return np.clip(np.concatenate(parts, axis=1), -MOST, MOST)

    def leaning(self, rows: FloatArray, chances: Mapping[int, FloatArray]) -> FloatArray:
        """(N, B) points of these actions from which noise N(0, 1) chooses about as often as it should.

        `chances` holds, for columns of binary and categorical signals, the probability (N, K) of each value; a yes
        comes exactly as often, if not too rarely, a category about as often: the largest of log p / 1.28 with noise.
        """
        points = self.points(rows)
        for column, chance in chances.items():
            part = self._columns[column]
            known = chance.clip(_FEWEST, 1 - _FEWEST)
            if column in self.signals.binary:
                threshold = self._threshold[self.signals.binary.tolist().index(column)]
                points[:, part[0]] = threshold + norm.ppf(known[:, 1])
            else:
                points[:, part] = np.log(known) / _GUMBEL
        return points


def _columns(signals: Space) -> list[list[int]]:
    """Which numbers of the Box make each signal."""
    counts = np.ones(signals.num_columns, dtype=np.int64)
    counts[signals.categorical] = signals.num_categories
    ends = np.cumsum(counts)
    return [list(range(end - count, end)) for end, count in zip(ends.tolist(), counts.tolist(), strict=True)]
