"""What is wrong with data, in words, and where."""

from __future__ import annotations

from dataclasses import dataclass


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

    def __str__(self) -> str:
        places = (("episode", self.episode), ("step", self.step), ("column", self.column))
        where = ", ".join(f"{what} {place}" for what, place in places if place is not None)
        times = f" ({self.count:,} times)" if self.count > 1 else ""
        return f"{where}: {self.message}{times}" if where else f"{self.message}{times}"
