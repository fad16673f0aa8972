"""What the user may have forgotten to say about a column: hints, which may be wrong and stop nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tvae.data.columns import MOST_CATEGORIES
from tvae.data.demonstrations import Demonstrations
from tvae.data.issues import Issue, Remedy
from tvae.data.ragged import blocks, ranges
from tvae.data.table_rows import Decided
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.spaces import Categorical, Continuous, FloatArray, IntArray, Space

_MOST_STEPS = 1 << 20
"""Steps that are looked at."""
_FEWEST_WRAPS = 3
_LEAST_WRAP = 3 / 4
"""Of a turn: what counts as a jump by about one."""
_LEAST_SHARE = 0.9
_MOST_NAMES = 8


@dataclass(frozen=True)
class _Turn:
    """A full turn in some unit."""

    length: float
    words: str
    remedy: Remedy


_TURNS = (
    _Turn(360.0, "an angle in degrees: between steps it jumps by about 360", Remedy.SAY_ANGLE_IN_DEGREES),
    _Turn(2 * math.pi, "an angle in radians: between steps it jumps by about 2 pi", Remedy.SAY_ANGLE),
)


def hints(demonstrations: Demonstrations, decided: Decided) -> Iterator[Issue]:
    """Numbers that look like angles, but for those of which the user said what they are; whole numbers as categories.

    >>> from tvae.data.arrays import from_arrays
    >>> walk = from_arrays([np.arange(0.0, 1600.0, 30.0)[:, None] % 360], [np.ones((53, 1))])
    >>> print(*hints(walk, Decided()))
    column observation.0: looks like an angle in degrees: between steps it jumps by about 360 (4 times)
    """
    kept = demonstrations
    seen = kept.lengths + kept.final_observed
    yield from _angles(
        OBSERVATION, kept.observation_space, kept.observations, kept.observation_starts, seen, decided
    )
    yield from _angles(ACTION, kept.action_space, kept.actions, kept.action_starts, kept.lengths, decided)
    counted = [
        f"{prefix}{signal.name} ({len(signal.categories)})"
        for prefix, space in ((OBSERVATION, kept.observation_space), (ACTION, kept.action_space))
        for signal in space.signals
        if isinstance(signal, Categorical)
        and prefix + signal.name in decided.by_type
        and all(isinstance(category, int) for category in signal.categories)
    ]
    if counted:
        more = f" and {len(counted) - _MOST_NAMES} more" if len(counted) > _MOST_NAMES else ""
        names = ", ".join(counted[:_MOST_NAMES])
        message = f"taken for categories, as they hold at most {MOST_CATEGORIES} different whole numbers: {names}{more}"
        yield Issue(message, remedy=Remedy.SAY_NUMBER)


def _angles(
    prefix: str, space: Space, flat: FloatArray, starts: IntArray, counts: IntArray, decided: Decided
) -> Iterator[Issue]:
    """The numbers that look like angles, by the first steps of all."""
    part = next(blocks(counts, _MOST_STEPS), slice(0))
    rows = ranges(starts[part], counts[part])
    within = np.ones(len(rows), dtype=np.bool_)
    within[np.cumsum(counts[part]) - counts[part]] = False
    for column, signal in enumerate(space.signals):
        if not isinstance(signal, Continuous) or prefix + signal.name in decided.by_user:
            continue
        values = np.asarray(flat[rows, column])
        for turn in _TURNS:
            count = wraps(values, within[1:], turn.length)
            if count:
                yield Issue(f"looks like {turn.words}", prefix + signal.name, count=count, remedy=turn.remedy)


def wraps(values: FloatArray, within: NDArray[np.bool_], turn: float) -> int:
    """How often numbers (N,) pass the end of a turn, if they look like an angle that does, else 0.

    They do if all lie in [-turn / 2, turn / 2] or all in [0, turn], and of the steps d from one number to the next that
    are longer than turn / 2 at least 3, and at least 9 in 10, have |d| >= 3/4 turn and are, the short way around,
    turn - |d|, no longer than twice the longest of the other steps. So noise does not, as its long steps are of every
    length, nor do places between which one jumps. `within` (N - 1,) says which steps stay in one episode.

    >>> compass = np.array([350.0, 10.0, 350.0, 330.0, 350.0, 5.0])
    >>> wraps(compass, np.ones(5, dtype=bool), 360.0), wraps(compass + 90, np.ones(5, dtype=bool), 360.0)
    (3, 0)
    """
    slack = 1e-6 * turn  # of single precision
    low, high = values.min() + slack, values.max() - slack
    if not ((low >= -turn / 2 and high <= turn / 2) or (low >= 0 and high <= turn)):
        return 0
    lengths = np.abs(np.diff(values))[within]
    long = lengths > turn / 2
    longest = lengths[~long].max(initial=0.0)
    count = int((lengths >= max(_LEAST_WRAP * turn, turn - 2 * longest - slack)).sum())
    return count if longest > 0 and count >= max(_FEWEST_WRAPS, _LEAST_SHARE * long.sum()) else 0
