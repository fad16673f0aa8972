"""What is done to recordings before they are demonstrations, as the user says; by default nothing."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from tvae.data.csv_files import AS_WRITTEN, CsvFormat
from tvae.data.estimates import Estimate, MissingRule
from tvae.data.roles import AS_NAMED, Roles


@dataclass(frozen=True)
class Clock:
    """A column that says when each row was recorded; the rows of an episode are its steps in the order of time.

    A column `step` is then not read. Steps must be equally far apart, unless there is a rule to resample them.
    """

    column: str
    """Numbers in any unit, or dates and times, which count in seconds."""
    every: float | None = None
    """Time from step to step, in the column's unit; by default the median of the recording."""
    resample: Estimate | None = None
    """The rule for observations and actions at the new steps; by default uneven steps are refused."""
    tolerance: float = 0.01
    """How far a step may be from where it should be, as a share of `every`."""

    def __post_init__(self) -> None:
        if self.every is not None and not self.every > 0:
            raise ValueError(f"every needs to be above 0, got {self.every}")
        if not 0 <= self.tolerance < 0.5:
            raise ValueError(f"tolerance needs to be at least 0 and below 0.5, got {self.tolerance}")


@dataclass(frozen=True)
class Preparation:
    """How rows become episodes.

    >>> from tvae.data.estimates import hold_last
    >>> Preparation(player="player", clock=Clock("seconds", every=0.1, resample=hold_last)).needed
    ('episode', 'player', 'seconds')
    """

    columns: tuple[str, ...] = ()
    """Read these columns, those below them, such as all of `action`, or those of a pattern; by default all."""
    roles: Roles = AS_NAMED
    """Which column is what, where their names do not say so."""
    csv: CsvFormat = AS_WRITTEN
    """What separates columns and marks decimals in CSV files; no matter to other tables."""
    nulls: tuple[str, ...] = ()
    """Texts that stand for a missing value, such as `lost`."""
    degrees: tuple[str, ...] = ()
    """Columns of angles in degrees, such as `heading`, or patterns; they are read in radians. An angle in a table that
    we wrote, or in a source that is no table, is in radians already and refused, unless the spaces are given: then it
    stays as it is, so that a model which learned from degrees also reads what was converted."""
    player: str | None = None
    """Column of the player whose row it is. Each player's rows are an episode, called EPISODE/PLAYER; the fact
    `session` is what the column `episode` says."""
    clock: Clock | None = None
    """When each row was recorded."""
    missing: MissingRule | None = None
    """The rule for missing observations and actions; by default they are refused."""

    @property
    def needed(self) -> tuple[str, ...]:
        """Columns that are read in any case, by their own names."""
        episode = self.roles.episode or "episode"
        step = self.roles.step or "step" if self.clock is None else self.clock.column
        return (episode, step) if self.player is None else (episode, self.player, step)

    def left_for(self, columns: Collection[str]) -> Preparation:
        """What is left to be done to a table that we wrote, of these columns.

        Its rows are steps in their order already. So a clock that is not there counts for nothing, and so do players
        that are not there, or that are told apart already, as `session` says.

        >>> Preparation(player="player", clock=Clock("seconds")).left_for(["episode", "step", "seconds"]).needed
        ('episode', 'seconds')
        """
        apart = self.player is not None and (self.player not in columns or "session" in columns)
        timed = self.clock is not None and self.clock.column not in columns
        return replace(self, player=None if apart else self.player, clock=None if timed else self.clock)


AS_RECORDED = Preparation()
