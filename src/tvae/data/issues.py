"""What is wrong with data, in words, and where."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum, auto


class Remedy(Enum):
    """What mends an issue, where something that the user may say does."""

    NAME_EPISODE = auto()
    NAME_STEP = auto()
    NAME_ACTIONS = auto()
    NAME_OBSERVATIONS = auto()
    SAY_KIND = auto()
    """Whether the column is a number, an angle or a category."""
    SAY_DEGREES = auto()
    """That the column is an angle in degrees."""
    SAY_ANGLE_IN_DEGREES = auto()
    """That a number is an angle in degrees."""
    SAY_ANGLE = auto()
    """That a number is an angle in radians."""
    SAY_NUMBER = auto()
    """That a category is a number."""
    OMIT_DEGREES = auto()
    """Not to say that the column is an angle in degrees."""
    SAY_DECIMAL = auto()
    """That decimals are marked by a comma."""
    SAY_CATEGORY_OR_IGNORE = auto()
    SAY_TEXT_IS_MISSING = auto()
    """Which texts stand for a missing value, or that the column is a category."""
    FILL = auto()
    """A rule for missing values."""
    FILL_REST = auto()
    """Another rule, for what the first has no value for."""
    TELL_TIME = auto()
    """That the column is a time and no number of a step."""
    RESAMPLE = auto()
    """A rule for uneven steps."""
    TELL_PLAYERS_APART = auto()
    IGNORE = auto()


@dataclass(frozen=True)
class Issue:
    """One kind of problem: where it first stands and how often there is one like it.

    >>> print(Issue("is missing", column="observation.x", episode=3, step=7, count=12))
    episode 3, step 7, column observation.x: is missing (12 times)
    """

    message: str
    column: str | None = None
    episode: int | str | None = None
    step: int | None = None
    count: int = 1
    remedy: Remedy | None = field(default=None, compare=False)

    def at(self, column: str) -> Issue:
        """The same of a column that is called otherwise."""
        return replace(self, column=column)

    def mended_by(self, remedy: Remedy) -> Issue:
        """The same with what mends it."""
        return replace(self, remedy=remedy)

    def __str__(self) -> str:
        places = (("episode", self.episode), ("step", self.step), ("column", self.column))
        where = ", ".join(f"{what} {place}" for what, place in places if place is not None)
        times = f" ({self.count:,} times)" if self.count > 1 else ""
        return f"{where}: {self.message}{times}" if where else f"{self.message}{times}"
