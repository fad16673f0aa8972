"""What a row of an observation or an action is made of.

A `Space` is an ordered list of signals, one per column of a raw row of numbers:

| signal        | raw value in its column         | law a head gives it |
|---------------|---------------------------------|---------------------|
| `Continuous`  | any real of at most 3.4e38      | Gaussian            |
| `Angular`     | radians; -pi and pi are equal   | von Mises           |
| `Categorical` | 0 .. K-1, index of its category | categorical         |
| `Binary`      | 0 or 1                          | Bernoulli           |

Any mixture of them is a space, so a heading with a rare button press is one action.

>>> action = Space((Angular("heading"), Binary("attack")))
>>> action.num_columns, action.angular.tolist(), action.binary.tolist()
(2, [0], [1])
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Continuous:
    """A real number, such as a distance."""

    name: str


@dataclass(frozen=True, slots=True)
class Angular:
    """A direction in radians; values that differ by 2 pi are the same direction."""

    name: str
    recorded_in_degrees: bool = False
    """Whether the recording had it in degrees, as whoever acts on it does; the raw value is in radians even so."""


@dataclass(frozen=True, slots=True)
class Categorical:
    """One of `categories`; the raw value is the index into them."""

    name: str
    categories: tuple[int | str, ...]

    def __post_init__(self) -> None:
        if not self.categories:
            raise ValueError(f"categorical signal {self.name!r} needs at least one category, got none")
        if len(set(self.categories)) != len(self.categories):
            raise ValueError(f"categories of {self.name!r} must differ, got {self.categories}")


@dataclass(frozen=True, slots=True)
class Binary:
    """Yes (1) or no (0), such as a button."""

    name: str


Signal: TypeAlias = Continuous | Angular | Categorical | Binary

_KINDS: dict[str, type[Signal]] = {
    "continuous": Continuous,
    "angular": Angular,
    "categorical": Categorical,
    "binary": Binary,
}
_KIND_NAMES = {cls: name for name, cls in _KINDS.items()}
_DEGREES, _RADIANS = "degrees", "radians"


def kind_name(signal: Signal) -> str:
    """The kind as users write it: `continuous`, `angular`, `categorical` or `binary`."""
    return _KIND_NAMES[type(signal)]


def describe(signal: Signal) -> str:
    """One phrase for tables and errors, such as `categorical (3)`."""
    if isinstance(signal, Categorical):
        return f"categorical ({len(signal.categories)})"
    return kind_name(signal)


def representable(values: FloatArray) -> NDArray[np.bool_]:
    """Where numbers are finite in single precision, in which models compute.

    >>> representable(np.array([3.4e38, 3.5e38, np.nan])).tolist()
    [True, False, False]
    """
    with np.errstate(over="ignore"):
        return np.isfinite(values.astype(np.float32))


def wanted_number(value: float) -> str:
    """What was needed instead of a number that is not `representable`, in words."""
    return "a number of at most 3.4e38 in size" if math.isfinite(value) else "a finite number"


@dataclass(frozen=True)
class Problem:
    """A value that a space does not allow: where it stands and why."""

    row: int
    column: str
    message: str


@dataclass(frozen=True)
class Space:
    """An ordered list of signals, one per column. Names are unique."""

    signals: tuple[Signal, ...]

    def __post_init__(self) -> None:
        names = [signal.name for signal in self.signals]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ValueError(f"signal names must be unique, got {', '.join(repeated)} more than once")

    @property
    def num_columns(self) -> int:
        return len(self.signals)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.signals)

    def _columns(self, kind: type[Signal]) -> IntArray:
        return np.array([i for i, s in enumerate(self.signals) if isinstance(s, kind)], dtype=np.int64)

    @cached_property
    def continuous(self) -> IntArray:
        """Columns of the continuous signals."""
        return self._columns(Continuous)

    @cached_property
    def angular(self) -> IntArray:
        """Columns of the angular signals."""
        return self._columns(Angular)

    @cached_property
    def binary(self) -> IntArray:
        """Columns of the binary signals."""
        return self._columns(Binary)

    @cached_property
    def categorical(self) -> IntArray:
        """Columns of the categorical signals."""
        return self._columns(Categorical)

    @cached_property
    def num_categories(self) -> tuple[int, ...]:
        """Number of categories of each categorical column, in the order of `categorical`."""
        return tuple(len(s.categories) for s in self.signals if isinstance(s, Categorical))

    @cached_property
    def category_mask(self) -> NDArray[np.bool_]:
        """(number of categorical columns, most categories): which of these categories there are."""
        most = max(self.num_categories, default=1)
        return np.arange(most) < np.array(self.num_categories, dtype=np.int64)[:, None]

    @property
    def num_features(self) -> int:
        """Width of a row as a network sees it: 1 a continuous or binary signal, 2 an angle, K a category."""
        return len(self.continuous) + 2 * len(self.angular) + len(self.binary) + sum(self.num_categories)

    def column(self, name: str) -> int:
        """Index of the column called `name`."""
        try:
            return self.names.index(name)
        except ValueError:
            raise KeyError(f"no signal {name!r}; there are {', '.join(self.names)}") from None

    def first_problem(self, rows: FloatArray) -> Problem | None:
        """The first value, row by row, that this space does not allow; None if all are allowed.

        `rows` has shape (N, num_columns).
        """
        bad = ~representable(rows)
        with np.errstate(invalid="ignore"):
            for column in self.binary:
                bad[:, column] |= (rows[:, column] != 0) & (rows[:, column] != 1)
            for column, count in zip(self.categorical, self.num_categories, strict=True):
                codes = rows[:, column]
                bad[:, column] |= (codes != np.floor(codes)) | (codes < 0) | (codes >= count)
        if not bad.any():
            return None
        row, column = np.argwhere(bad)[0]
        value, signal = rows[row, column], self.signals[column]
        if not representable(rows[row])[column]:
            message = f"needs {wanted_number(float(value))}, got {value}"
        elif isinstance(signal, Binary):
            message = f"is binary and needs 0 or 1, got {value:g}"
        else:
            assert isinstance(signal, Categorical)
            message = f"needs a category index from 0 to {len(signal.categories) - 1}, got {value:g}"
        return Problem(int(row), signal.name, message)

    def differences(self, other: Space) -> list[str]:
        """In words, where `other` has other kinds or numbers of signals; names may differ."""
        found = []
        if self.num_columns != other.num_columns:
            found.append(f"{self.num_columns} signals against {other.num_columns}")
        for index, (mine, theirs) in enumerate(zip(self.signals, other.signals, strict=False)):
            if describe(mine) != describe(theirs):
                found.append(
                    f"signal {index} is {describe(mine)} ({mine.name!r}) against "
                    f"{describe(theirs)} ({theirs.name!r})"
                )
        return found

    def to_json(self) -> list[dict[str, Any]]:
        """Plain data for a JSON file."""
        result: list[dict[str, Any]] = []
        for signal in self.signals:
            entry: dict[str, Any] = {"kind": kind_name(signal), "name": signal.name}
            if isinstance(signal, Categorical):
                entry["categories"] = list(signal.categories)
            if isinstance(signal, Angular) and signal.recorded_in_degrees:
                entry["recorded_unit"] = _DEGREES
            result.append(entry)
        return result

    @classmethod
    def from_json(cls, data: Sequence[Mapping[str, Any]]) -> Space:
        """The space that `to_json` wrote; angles of which no unit is noted were recorded in radians.

        >>> space = Space((Categorical("move", ("left", "right")), Continuous("x")))
        >>> Space.from_json(space.to_json()) == space
        True
        """
        signals: list[Signal] = []
        for entry in data:
            kind = entry.get("kind")
            if kind not in _KINDS:
                raise ValueError(f"signal kind must be one of {', '.join(_KINDS)}, got {kind!r}")
            if kind == "categorical":
                signals.append(Categorical(str(entry["name"]), tuple(entry["categories"])))
            elif kind == "angular":
                unit = entry.get("recorded_unit", _RADIANS)
                if unit not in (_RADIANS, _DEGREES):
                    raise ValueError(f"an angle is recorded in {_RADIANS} or {_DEGREES}, got {unit!r}")
                signals.append(Angular(str(entry["name"]), recorded_in_degrees=unit == _DEGREES))
            else:
                signals.append(_KINDS[kind](str(entry["name"])))  # type: ignore[call-arg]  # all kinds left take a name alone
        return cls(tuple(signals))
