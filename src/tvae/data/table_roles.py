"""A table whose columns are called as ours are, from one in which they are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import pyarrow as pa
import pyarrow.compute as pc

from tvae.data.columns import plain
from tvae.data.issues import Issue
from tvae.data.preparation import Preparation
from tvae.data.roles import AS_NAMED, assigned
from tvae.data.signal_names import bare, called
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.spaces import Signal, Space


@dataclass(frozen=True)
class Arranged:
    """A table with our names."""

    table: pa.Table
    schema: TableSchema | None
    recorded: Mapping[str, str]
    """What each column that was renamed was called."""
    issues: tuple[Issue, ...] = ()

    def as_recorded(self, issue: Issue) -> Issue:
        """The same issue in the table's own words."""
        column = issue.column
        return issue if column is None else issue.at(self.recorded.get(column, column))


def arranged(
    table: pa.Table, schema: TableSchema | None, preparation: Preparation, observation_space: Space | None
) -> Arranged:
    """The columns that are kept, called as their roles say.

    Of a table that we wrote, roles of columns that are not there count for nothing, as it has our names already.
    Columns that are left over are observations where `observation_space` has them or, without one, where they change
    within any episode and are no times.

    >>> from tvae.data.roles import Roles
    >>> rows = pa.table({"id": ["a", "a"], "t": [0, 1], "hp": [9, 8], "map": ["sea", "sea"], "key": ["w", "s"]})
    >>> roles = Preparation(roles=Roles("id", "t", actions=("key",)))
    >>> arranged(rows, None, roles, None).table.column_names
    ['episode', 'step', 'observation.hp', 'map', 'action.key']
    """
    roles, there = preparation.roles, table.column_names
    if roles == AS_NAMED or len(set(there)) < len(there):
        return Arranged(table, schema, {})
    taken = [name for name in preparation.needed if name not in (roles.episode, roles.step)]
    found = assigned(there, roles, taken, lenient=schema is not None)
    names = dict(found.names)
    if observation_space is None:
        identity = [name for name in there if name in (roles.episode or "episode", preparation.player)]
        seen = [name for name in found.left_over if _may_be_seen(table, name, identity)]
    else:
        seen = [name for name in found.left_over if name in observation_space.names]
    names |= {name: OBSERVATION + name for name in seen}
    kept = table.select(list(names)).rename_columns(list(names.values()))
    renamed = {new: old for old, new in names.items() if new != old}
    return Arranged(
        kept,
        None if schema is None or renamed else schema.only(list(names)),
        renamed,
        found.issues,
    )


def _may_be_seen(table: pa.Table, name: str, identity: Sequence[str]) -> bool:
    """Whether a column is no time and changes within any episode, as far as is known."""
    values = plain(table[name])
    if pa.types.is_temporal(values.type):
        return False
    if pa.types.is_nested(values.type) or not identity:
        return True
    keys = [plain(table[key]) for key in identity]
    together = pa.table([*keys, values], names=[*(f"key {at}" for at in range(len(keys))), "value"])
    counts = together.group_by(together.column_names[:-1]).aggregate([("value", "count_distinct")])
    return bool((pc.max(counts["value_count_distinct"]).as_py() or 0) > 1)


def named_kinds(
    kinds: Mapping[str, type[Signal]], names: Sequence[str], recorded: Mapping[str, str]
) -> tuple[dict[str, type[Signal]], list[Issue]]:
    """The kind of each signal that was named: in full, as recorded, without `observation.`, or by a pattern.

    >>> from tvae.spaces import Angular, Continuous
    >>> kinds = {"heading": Angular, "observation.*": Continuous}
    >>> list(named_kinds(kinds, ["step", "observation.x", "action.heading"], {})[0])
    ['observation.x', 'action.heading']
    """
    signals = [name for name in names if name.startswith((OBSERVATION, ACTION))]
    by_name: dict[str, type[Signal]] = {}
    by_pattern: dict[str, type[Signal]] = {}
    issues = []
    for wanted, kind in kinds.items():
        found = by_name
        columns = [name for name in [called(wanted, signals, recorded)] if name is not None]
        if not columns:
            found = by_pattern
            columns = [name for name in signals if any(fnmatchcase(own, wanted) for own in (name, bare(name)))]
        if not columns:
            listed = ", ".join(recorded.get(name, name) for name in signals)
            issues.append(Issue(f"was given a kind, but is no column of a signal; these are: {listed}", column=wanted))
        issues += [
            Issue("needs one kind, got two", column=column)
            for column in columns
            if found.setdefault(column, kind) is not kind
        ]
    return {**by_pattern, **by_name}, issues
