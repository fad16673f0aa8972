"""What mends an issue, in the words of the command line's options."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from shlex import quote

from tvae.data.issues import Issue, Remedy
from tvae.data.validation import Summary, suspicions

_OPTIONS: Mapping[Remedy, str] = {
    Remedy.NAME_EPISODE: "name it: --episode COLUMN; or, where each file is one episode, give their directory",
    Remedy.NAME_STEP: "name it: --step COLUMN where steps are numbered 0, 1, 2, ..., else --time COLUMN",
    Remedy.NAME_ACTIONS: "name them, or a pattern: --action COLUMN, once for each",
    Remedy.NAME_OBSERVATIONS: "with --action, what is left over are observations; or name them: --observation COLUMN",
    Remedy.SAY_KIND: "--continuous {column}, --angular {column} (in radians), --degrees {column} or "
    "--categorical {column}; or --ignore {column}",
    Remedy.SAY_DEGREES: "--degrees {column}, instead of --angular {column}, takes it for an angle in degrees",
    Remedy.SAY_ANGLE_IN_DEGREES: "--degrees {column} takes it for one, --continuous {column} says that it is none",
    Remedy.SAY_ANGLE: "--angular {column} takes it for one, --continuous {column} says that it is none",
    Remedy.SAY_NUMBER: "--continuous COLUMN takes one for a number, --binary COLUMN for yes (1) or no (0)",
    Remedy.OMIT_DEGREES: "leave --degrees {column} out",
    Remedy.SAY_DECIMAL: "--decimal , reads them as numbers, of CSV files; or --categorical {column}",
    Remedy.SAY_CATEGORY_OR_IGNORE: "--ignore {column} or --categorical {column}",
    Remedy.SAY_TEXT_IS_MISSING: "--null TEXT reads a text as a missing value; or --categorical {column}",
    Remedy.FILL: "--missing hold, --missing linear or --missing drop; or --ignore {column}",
    Remedy.FILL_REST: "another --missing besides, such as --missing drop; or --ignore {column}",
    Remedy.TELL_TIME: "--time {column} takes it for a time, which may begin anywhere",
    Remedy.RESAMPLE: "--time {column} with --resample hold or --resample linear",
    Remedy.TELL_PLAYERS_APART: "--player COLUMN where the rows are those of several players",
    Remedy.IGNORE: "--ignore {column}",
}


def doubts(summary: Summary) -> Iterator[str]:
    """What can be read, but is perhaps not meant so, in sentences with the options that say otherwise."""
    for issue in suspicions(summary):
        yield f"Warning: {issue} {options_for(issue)}"


def hinted(hints: Iterable[Issue]) -> Iterator[str]:
    """What may have been forgotten, in sentences with the options that say it."""
    for hint in hints:
        yield f"Hint: {hint}; {options_for(hint)}"


def options_for(issue: Issue) -> str | None:
    """The options that mend an issue; None where the recording itself must be mended.

    >>> options_for(Issue("holds 99 different integers", column="hp", remedy=Remedy.SAY_KIND))
    '--continuous hp, --angular hp (in radians), --degrees hp or --categorical hp; or --ignore hp'
    >>> options_for(Issue("is there already", column="my column", remedy=Remedy.IGNORE))
    "--ignore 'my column'"
    """
    column = "COLUMN" if issue.column is None else quote(issue.column)
    return None if issue.remedy is None else _OPTIONS[issue.remedy].replace("{column}", column)
