"""Which column of a table is what, where its names do not say so."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from tvae.data.issues import Issue, Remedy
from tvae.data.names import absent, is_named
from tvae.data.signal_names import bare
from tvae.data.table_schema import ACTION, OBSERVATION

_KNOWN = ("reward", "terminated", "truncated", "label", "group")
"""Columns that mean the same in every table, and are never observed."""


@dataclass(frozen=True)
class Roles:
    """Columns by their own names; all but `episode` and `step` also with all below them, or by a pattern as of files.

    A column's name goes before a pattern, and `ignored` before all. With `actions` but without any observations,
    all columns that are left over are observations, but those that are the same in a whole episode, times, and
    `reward`, `terminated`, `truncated`, `label`, `group` and `info.*`: these are facts, as ever.
    """

    episode: str | None = None
    """Instead of `episode`."""
    step: str | None = None
    """Instead of `step`."""
    actions: tuple[str, ...] = ()
    """Instead of names `action.*`, or besides."""
    observations: tuple[str, ...] = ()
    """Instead of names `observation.*`, or besides."""
    ignored: tuple[str, ...] = ()
    """Columns that are not read."""


AS_NAMED = Roles()


@dataclass(frozen=True)
class Assigned:
    """What becomes of the columns of a table."""

    names: Mapping[str, str]
    """The new name of each column that is kept, in the order of the table."""
    left_over: tuple[str, ...]
    """Those among them of which nothing is said, and which may be observations."""
    issues: tuple[Issue, ...]
    """Columns that are not there, or that are to be two things at once."""


def assigned(there: Sequence[str], roles: Roles, taken: Collection[str], *, lenient: bool = False) -> Assigned:
    """The columns that are `there`, by their roles; those that are `taken` for something else keep their names.

    `lenient` leaves out roles of columns that are not there.

    >>> found = assigned(["match", "t", "hp", "move_x"], Roles("match", "t", ("move_*",)), taken=())
    >>> found.names, found.left_over
    ({'match': 'episode', 't': 'step', 'hp': 'hp', 'move_x': 'action.move_x'}, ('hp',))
    """
    issues = [] if lenient else [Issue(absent(wanted, there)) for wanted in _absent(there, roles)]
    said = ((roles.episode, "episode"), (roles.step, "step"))
    whole = {old: new for old, new in said if old is not None and old in there}
    taken = {*taken, *whole}
    names: dict[str, str] = {}
    left_over = []
    for name in there:
        done, seen = _fit(name, roles.actions, ACTION), _fit(name, roles.observations, OBSERVATION)
        if name in roles.ignored or (name not in taken and _fit(name, roles.ignored, "")):
            continue
        if name in taken:
            names[name] = whole.get(name, name)
            if max(done, seen) == 2:
                issues.append(Issue("is named as a signal, but says which row is which step", column=name))
            continue
        if name in whole.values():
            message = "is there, but another column is named instead"
            issues.append(Issue(message, column=name, remedy=Remedy.IGNORE))
            continue
        if done == seen != 0:
            issues.append(Issue("is named as an action and as an observation", column=name))
        if max(done, seen) == 0:
            names[name] = name
            if not _is_told(name):
                left_over.append(name)
            continue
        names[name] = (ACTION if done > seen else OBSERVATION) + bare(name)
    observed = any(name.startswith(OBSERVATION) for name in names.values())
    return Assigned(names, () if observed or not roles.actions else tuple(left_over), tuple(issues))


def _absent(there: Sequence[str], roles: Roles) -> list[str]:
    """Columns that were named and are not there."""
    whole = [name for name in (roles.episode, roles.step) if name is not None and name not in there]
    several = [
        wanted
        for kind, prefix in ((roles.ignored, ""), (roles.actions, ACTION), (roles.observations, OBSERVATION))
        for wanted in kind
        if not any(_fit(name, [wanted], prefix) for name in there)
    ]
    return list(dict.fromkeys([*whole, *several]))


def _fit(name: str, wanted: Sequence[str], prefix: str) -> int:
    """2 for a column that is named, 1 for one that fits a pattern or is below one that is named, else 0."""
    short = name.removeprefix(prefix)
    if name in wanted or short in wanted:
        return 2
    return int(any(is_named(name, one) or is_named(short, one) for one in wanted))


def _is_told(name: str) -> bool:
    """Whether the name itself says what the column is."""
    return name in {"episode", "step", *_KNOWN} or name.startswith((OBSERVATION, ACTION, "info."))
