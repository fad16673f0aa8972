"""What each episode did, in a few numbers: no model is asked, only its observations and actions.

Of a signal x_1 .. x_n of an episode:

| kind        | statistic       | formula                                              |
|-------------|-----------------|------------------------------------------------------|
| continuous  | `mean`          | 1/n sum_t x_t                                        |
|             | `lowest`        | min_t x_t                                            |
|             | `highest`       | max_t x_t                                            |
|             | `last`          | x_n                                                  |
|             | `travelled`     | sum_t abs(x_{t+1} - x_t)                             |
| angular     | `concentration` | abs(1/n sum_t exp(i x_t)), 0 .. 1                    |
|             | `turn`          | mean_t abs(x_{t+1} - x_t), the shorter way, radians  |
|             | `net turn`      | sum_t x_{t+1} - x_t, the shorter way, radians        |
|             | `positive`      | 1/n sum_t [0 < x_t < pi]                             |
| binary      | `count`         | sum_t x_t                                            |
| categorical | `share of k`    | 1/n sum_t [x_t = k], at most 20 categories           |
|             | `switches`      | sum_t [x_{t+1} != x_t]                               |

A mean direction is left out: -pi and pi are one direction, so its average over episodes would mean nothing. Which way
was turned is told by `net turn` where the signal is a direction, and by `positive` where it is itself a turn, or the
bearing of something; positive is counter-clockwise, to the left, where angles are measured so. Half a turn, which is
to neither side, counts 0 in `net turn`, and so do directions 0 and pi in `positive`.
Then `steps`, the number T of actions, and what came of the play: `return`, the sum of the rewards, and the last
value of each numeric `info.NAME` where no signal is called NAME.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import blocks, ranges
from tvae.gymnasium_spaces import wrap
from tvae.spaces import Angular, Binary, Categorical, Continuous, FloatArray, IntArray, Signal

MOST_CATEGORIES = 20
"""Shares are told of categorical signals with at most so many categories."""

_OWN_NAMES = ("steps", "return")
"""Statistics that are of no signal; a signal of such a name is called by its role, too."""
_STEPS_AT_ONCE = 2_000_000
_ROUNDING = 1e-12
_ON_THE_SEAM = 1e-6
"""Radians from 0 or pi within which a direction has no side."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """One number that every episode has."""

    name: str
    """Its unique name, such as `distance.lowest`."""
    source: str
    """What it tells of: a signal, `steps`, `return` or `info.NAME`."""
    phrase: str
    """How to say it, for `str.format`: with one field, `{number}`, or `{percent}` for a share."""
    is_outcome: bool = False
    """Whether it tells what came of the play, and not how it was played."""


@dataclass(frozen=True, eq=False)
class EpisodeStatistics:
    """K statistics of E episodes. Those that are not finite in every episode are left out.

    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Space
    >>> walk = Trajectory(np.array([[0.0], [3.0], [1.0]]), np.array([[1.0], [0.0]]))
    >>> spaces = Space((Continuous("x"),)), Space((Binary("jump"),))
    >>> told = EpisodeStatistics.of(Demonstrations.from_trajectories([walk], *spaces))
    >>> told.names
    ('x.mean', 'x.lowest', 'x.highest', 'x.last', 'x.travelled', 'jump.count', 'steps')
    >>> told["x.travelled"].tolist(), told["jump.count"].tolist()
    ([5.0], [1.0])
    """

    statistics: tuple[Statistic, ...]
    """K of them: observations, actions, `steps`, then outcomes."""
    values: FloatArray
    """(E, K)"""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(statistic.name for statistic in self.statistics)

    @property
    def phrases(self) -> tuple[str, ...]:
        return tuple(statistic.phrase for statistic in self.statistics)

    def __getitem__(self, name: str) -> FloatArray:
        """(E,) the statistic of this name."""
        try:
            return self.values[:, self.names.index(name)]
        except ValueError:
            raise KeyError(f"no statistic {name!r}; there are {', '.join(self.names)}") from None

    @classmethod
    def of(cls, demonstrations: Demonstrations) -> EpisodeStatistics:
        """The statistics of these episodes; a bounded number of steps is in memory at a time."""
        parts = list(blocks(demonstrations.lengths, _STEPS_AT_ONCE)) or [slice(0, 0)]
        columns = [list(_columns(demonstrations[part])) for part in parts]
        statistics = [statistic for statistic, _ in columns[0]]
        values = np.concatenate([np.stack([column for _, column in part], axis=1) for part in columns])
        finite = np.isfinite(values).all(axis=0)
        return cls(tuple(statistics[k] for k in np.flatnonzero(finite)), values[:, finite])


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of E episodes, gathered from a flat array; each episode has at least one."""

    at: IntArray
    """(N,) where they stand, all episodes one after another."""
    counts: IntArray
    """(E,) rows of each episode."""

    @property
    def starts(self) -> IntArray:
        starts: IntArray = np.cumsum(self.counts) - self.counts
        return starts

    def of(self, flat: NDArray[Any]) -> FloatArray:
        """(N,) the values of these rows."""
        return flat[self.at].astype(np.float64)

    def total(self, values: NDArray[Any]) -> FloatArray:
        """(E,) sum over each episode; 0 where its terms cancel but for rounding."""
        total = np.add.reduceat(values, self.starts, dtype=np.float64)
        total[np.abs(total) <= _ROUNDING * np.add.reduceat(np.abs(values), self.starts, dtype=np.float64)] = 0.0
        return total

    def mean(self, values: NDArray[Any]) -> FloatArray:
        """(E,) mean over each episode."""
        return self.total(values) / self.counts

    def last(self, values: FloatArray) -> FloatArray:
        """(E,) value of each episode's last row."""
        return values[self.starts + self.counts - 1]

    def changes(self, values: FloatArray) -> FloatArray:
        """(N,) each value less the one before it; 0 where an episode starts."""
        changes = np.diff(values, prepend=0.0)
        changes[self.starts] = 0.0
        return changes


_Column: TypeAlias = tuple[Statistic, FloatArray]
"""A statistic, and its (E,) values."""


def _columns(demonstrations: Demonstrations) -> Iterator[_Column]:
    lengths = demonstrations.lengths
    observed = lengths + demonstrations.final_observed
    steps = _Rows(ranges(demonstrations.action_starts, lengths), lengths)
    observations = _Rows(ranges(demonstrations.observation_starts, observed), observed)

    told = (*demonstrations.observation_space.names, *demonstrations.action_space.names)
    for kind, space, flat, rows in (
        ("observation", demonstrations.observation_space, demonstrations.observations, observations),
        ("action", demonstrations.action_space, demonstrations.actions, steps),
    ):
        for column, signal in enumerate(space.signals):
            plain = told.count(signal.name) == 1 and signal.name not in _OWN_NAMES
            name = signal.name if plain else f"{kind}.{signal.name}"
            for statistic, phrase, values in _of_signal(signal, rows.of(flat[:, column]), rows):
                yield Statistic(f"{name}.{statistic}", name, f"{_literal(name)} {phrase}"), values

    yield Statistic("steps", "steps", "lasts {number} steps"), lengths.astype(np.float64)
    if "reward" in demonstrations.steps:
        returns = steps.total(steps.of(demonstrations.steps["reward"]))
        yield Statistic("return", "return", "return of {number}", is_outcome=True), returns
    last = demonstrations.action_starts + lengths - 1
    for name, values in demonstrations.steps.items():
        short = name.removeprefix("info.")
        if name != short and short not in told and values.dtype.kind in "biuf" and values.ndim == 1:
            phrase = f"{_literal(short)} is {{number}} at the end"
            yield Statistic(name, name, phrase, is_outcome=True), values[last].astype(np.float64)


def _of_signal(signal: Signal, values: FloatArray, rows: _Rows) -> Iterator[tuple[str, str, FloatArray]]:
    """Name, phrase after the signal's name, and (E,) values of each statistic of a signal's (N,) values."""
    changes = rows.changes(values)
    match signal:
        case Continuous():
            yield "mean", "is {number} on average", rows.mean(values)
            yield "lowest", "comes as low as {number}", np.minimum.reduceat(values, rows.starts)
            yield "highest", "comes as high as {number}", np.maximum.reduceat(values, rows.starts)
            yield "last", "ends at {number}", rows.last(values)
            yield "travelled", "changes by {number} in all", rows.total(np.abs(changes))
        case Angular():
            resultant = np.hypot(rows.mean(np.cos(values)), rows.mean(np.sin(values)))
            yield "concentration", "keeps to one direction by {percent}", resultant
            turned = wrap(changes)
            turns = rows.total(np.abs(turned)) / np.maximum(rows.counts - 1, 1)
            yield "turn", "turns by {number} rad a step", turns
            sided = np.where(np.abs(turned) < np.pi - _ON_THE_SEAM, turned, 0.0)
            yield "net turn", "turns by a net {number} rad", rows.total(sided)
            positive = np.abs(wrap(values) - np.pi / 2) < np.pi / 2 - _ON_THE_SEAM
            yield "positive", "is above 0 {percent} of the time", rows.mean(positive)
        case Binary():
            yield "count", "happens {number} times an episode", rows.total(values)
        case Categorical(categories=categories):
            for code, category in enumerate(categories if len(categories) <= MOST_CATEGORIES else ()):
                phrase = f"is {_literal(str(category))} {{percent}} of the time"
                yield f"share of {category}", phrase, rows.mean(values == code)
            yield "switches", "changes {number} times an episode", rows.total(changes != 0)


def _literal(name: str) -> str:
    """The name as `str.format` leaves it."""
    return name.replace("{", "{{").replace("}", "}}")
