"""Where a run's demonstrations come from, so that they can be read again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from tvae.data.columns import kinds_by_column
from tvae.data.csv_files import CsvFormat
from tvae.data.demonstrations import Demonstrations
from tvae.data.estimates import Estimate, MissingRule, drop_episode, hold_last, in_turn, interpolate
from tvae.data.preparation import Clock, Preparation
from tvae.data.roles import Roles
from tvae.data.segments import segment, segment_at_event, segment_by_column
from tvae.data.sources import read_source
from tvae.data.table_rows import Decided
from tvae.data.table_sets import is_pattern
from tvae.data.trajectory import DataError
from tvae.spaces import Space

ResampleName: TypeAlias = Literal["hold", "linear"]
MissingName: TypeAlias = Literal["hold", "linear", "drop"]
_RESAMPLE: Mapping[str, Estimate] = {"hold": hold_last, "linear": interpolate}
_MISSING: Mapping[str, MissingRule] = {**_RESAMPLE, "drop": drop_episode}

_SEPARATORS: Mapping[str, str] = {"tab": "\t", "\\t": "\t"}
"""Words for what is no character that can be typed."""


@dataclass(frozen=True)
class Reading:
    """How a data set is read, in words that a configuration file can hold."""

    episode: str | None = None
    """Column that says which episode a row belongs to, where it is not called episode."""
    step: str | None = None
    """Column that numbers the steps of an episode, where it is not called step."""
    action: tuple[str, ...] = ()
    """Column of what was done, where it is not called action.NAME, or a pattern such as 'move_*'; may be repeated."""
    observation: tuple[str, ...] = ()
    """Column of what was seen, likewise; by default, with --action, all that is left over and changes in an episode."""
    ignore: tuple[str, ...] = ()
    """Column to leave out, or a pattern; may be repeated."""
    angular: tuple[str, ...] = ()
    """Column that is an angle in radians, such as heading; may be repeated."""
    degrees: tuple[str, ...] = ()
    """Column that is an angle in degrees, such as heading, and is read in radians; may be repeated."""
    continuous: tuple[str, ...] = ()
    """Column that is a number; may be repeated."""
    categorical: tuple[str, ...] = ()
    """Column that is a category; may be repeated."""
    binary: tuple[str, ...] = ()
    """Column that is yes (1) or no (0), such as a button; may be repeated."""
    separator: str | None = None
    """Character between the columns of a CSV file, or tab; by default the comma, semicolon or tab of the first line."""
    decimal: str | None = None
    """Decimal mark of a CSV file, a point or a comma; by default a comma where numbers are written so and columns are
    not separated by one."""
    null: tuple[str, ...] = ()
    """Text that stands for a missing value, such as lost; may be repeated."""
    only: tuple[str, ...] = ()
    """Column to read, with all below it, such as observation.state; by default all; may be repeated."""
    player: str | None = None
    """Column of the player whose row it is; the rows of each are an episode of their own."""
    time: str | None = None
    """Column that says when each row was recorded, instead of a column step."""
    every: float | None = None
    """Time from step to step, in units of --time, of dates in seconds; by default the median."""
    resample: ResampleName | None = None
    """Rule for steps that are not equally far apart: the last value holds, or a straight line; by default refused."""
    missing: tuple[MissingName, ...] = ()
    """Rule for missing values: the last holds, a straight line, or drop the episode; by default refused. A second one
    counts where the first has no value."""
    segment: int | None = None
    """Cut recordings into segments of at most so many steps."""
    segment_by: str | None = None
    """Cut recordings where this column changes."""
    segment_at: str | None = None
    """Cut recordings behind each step at which this column is true."""

    @property
    def preparation(self) -> Preparation:
        """What is done to rows before they are episodes. Raises `DataError` for options that lack another."""
        if self.time is None and (self.every is not None or self.resample is not None):
            raise DataError("steps are resampled by a column with the time: name it, too (--time)")
        if self.every is not None and not self.every > 0:
            raise DataError(f"the time from step to step needs to be above 0, got {self.every} (--every)")
        rule = None if self.resample is None else _RESAMPLE[self.resample]
        return Preparation(
            columns=self.only,
            roles=Roles(self.episode, self.step, self.action, self.observation, self.ignore),
            csv=CsvFormat(_SEPARATORS.get(self.separator or "", self.separator), self.decimal),
            nulls=self.null,
            degrees=self.degrees,
            player=self.player,
            clock=None if self.time is None else Clock(self.time, self.every, rule),
            missing=in_turn(*(_MISSING[name] for name in self.missing)) if self.missing else None,
        )

    @property
    def left_over(self) -> str | None:
        """In words, that columns were taken for something by themselves; None where that is not so."""
        if not self.action or self.observation:
            return None
        return (
            "Columns that no option names were taken for observations where they change within an episode, else for "
            "facts; --observation names them instead, --ignore leaves one out."
        )

    def cut(self, demonstrations: Demonstrations) -> Demonstrations:
        """The segments that are asked for. Raises `DataError` where there is more than one way to cut."""
        if sum(way is not None for way in (self.segment, self.segment_by, self.segment_at)) > 1:
            raise DataError("recordings are cut one way: --segment, --segment-by or --segment-at, not several")
        if self.segment is not None and self.segment < 1:
            raise DataError(f"segments need at least 1 step, got {self.segment} (--segment)")
        if self.segment_by is not None:
            return segment_by_column(demonstrations, self.segment_by)
        if self.segment_at is not None:
            return segment_at_event(demonstrations, self.segment_at)
        return demonstrations if self.segment is None else segment(demonstrations, self.segment)


AS_IT_IS = Reading()


@dataclass(frozen=True)
class Source:
    """A data set and how it is read."""

    path: str
    """File, pattern of files, directory or Minari id."""
    reading: Reading = AS_IT_IS

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Source:
        """The inverse of `dataclasses.asdict`, after JSON has made lists of tuples.

        Runs of earlier versions have the fields of `reading` beside `path`, and at most one rule for missing values.
        """
        written = data["reading"] if "reading" in data else {name: data[name] for name in data if name != "path"}
        reading: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in written.items()
        }
        if not isinstance(reading.get("missing", ()), tuple):
            reading["missing"] = () if reading["missing"] is None else (reading["missing"],)
        return cls(data["path"], Reading(**reading))

    def load(self, observation_space: Space | None = None, action_space: Space | None = None) -> Demonstrations:
        """Read the demonstrations; given spaces, such as a model's, must fit.

        `DataError` says what is wrong with them.
        """
        return self.read(observation_space, action_space)[0]

    def read(
        self, observation_space: Space | None = None, action_space: Space | None = None
    ) -> tuple[Demonstrations, Decided]:
        """The same, and who decided what each column is."""
        reading = self.reading
        demonstrations, decided = read_source(
            self.path,
            kinds_by_column(reading.angular, reading.continuous, reading.categorical, reading.binary),
            reading.preparation,
            observation_space=observation_space,
            action_space=action_space,
        )
        return reading.cut(demonstrations), decided

    def load_others(self, path: str, observation_space: Space, action_space: Space) -> Demonstrations:
        """Other sessions, at `path`, read as these are. `DataError` likewise."""
        try:
            return replace(self, path=path).load(observation_space, action_space)
        except DataError as error:
            if "column 'episode'" in str(error) and Path(path).is_file() and not Path(self.path).is_file():
                raise DataError(
                    f"{error}. A file that is one session, as those of {self.path} may be, is read with its directory: "
                    f"give {Path(path).parent}"
                ) from error
            raise

    def absolute(self) -> Source:
        """The same, found from any working directory."""
        here = Path(self.path)
        found = here.exists() or is_pattern(self.path)
        return replace(self, path=str(here.resolve() if here.exists() else here.absolute())) if found else self
