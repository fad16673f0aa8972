"""A table as demonstrations, with everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tvae.data.columns import plain
from tvae.data.degrees import angles, in_radians, noted, radians_issue, with_degrees, without_radians
from tvae.data.demonstrations import Demonstrations
from tvae.data.estimates import MissingRule
from tvae.data.filling import filled
from tvae.data.issues import Issue, Remedy
from tvae.data.names import alike
from tvae.data.preparation import AS_RECORDED, Clock, Preparation
from tvae.data.raw_table import RawTable
from tvae.data.resampling import endless, resampled
from tvae.data.table_facts import read_facts
from tvae.data.table_index import TableIndex, index_table
from tvae.data.table_roles import Arranged, arranged, named_kinds
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.table_signals import Signals, column_issues, final_rows, read_signals
from tvae.data.texts import without_nulls
from tvae.spaces import Signal, Space

_NAMING = {"episode": Remedy.NAME_EPISODE, "step": Remedy.NAME_STEP}


@dataclass(frozen=True)
class Decided:
    """Which columns of signals, such as `observation.x`, are of their kind by whose word; others by a schema."""

    by_user: frozenset[str] = frozenset()
    by_type: frozenset[str] = frozenset()
    """Those of which nothing was known but the type of their values."""


@dataclass(frozen=True)
class Examined:
    """What a table holds: demonstrations, or the issues that keep it from being any."""

    demonstrations: Demonstrations | None
    issues: tuple[Issue, ...]
    decided: Decided = Decided()


@dataclass(frozen=True)
class Rows:
    """All rows of a table, in order."""

    table: pa.Table
    index: TableIndex
    observations: Signals
    actions: Signals


def examine(
    raw: RawTable,
    *,
    kinds: Mapping[str, type[Signal]],
    preparation: Preparation = AS_RECORDED,
    observation_space: Space | None = None,
    action_space: Space | None = None,
) -> Examined:
    """Read a table. Given spaces override the schema's, and `kinds` override both.

    With given spaces, such as a model's, what the preparation says of players and times has been done already to a
    table that we wrote (`Preparation.left_for`). Issues name columns as the table does.

    >>> rows = {"episode": [7, 7], "step": [0, 1], "observation.x": [0.0, 1.0], "action.dx": [1.0, None]}
    >>> table = pa.table(rows)
    >>> examine(RawTable(table), kinds={}).demonstrations[0].observations.tolist()
    [[0.0], [1.0]]
    >>> [str(issue) for issue in examine(RawTable(table.drop_columns("action.dx")), kinds={}).issues]
    ['needs at least one column action.*; the columns are episode, step, observation.x']
    """
    if raw.schema is not None and observation_space is not None:
        preparation = preparation.left_for(raw.table.column_names)
    own = arranged(raw.table, raw.schema, preparation, observation_space)
    kinds, issues = named_kinds(kinds, own.table.column_names, own.recorded)
    kinds, degrees, found_issues = with_degrees(kinds, preparation.degrees, own.table.column_names, own.recorded)
    issues += found_issues
    to_turn = without_radians(degrees, raw.schema, own.recorded)
    if observation_space is None and action_space is None and raw.schema is not None:
        ours = angles(raw.schema.observation_space, raw.schema.action_space)
        issues += [
            radians_issue(name, ours.get(own.recorded.get(name, name))) for name in degrees if name not in to_turn
        ]
    issues = [*_layout_issues(raw.table, own, preparation), *issues]
    names = own.table.column_names
    if len(set(names)) < len(names) or raw.table.num_rows == 0:
        found = Examined(None, tuple(issues))
    else:
        table = pa.table([plain(column) for column in own.table.columns], names=names)
        table = without_nulls(table, preparation.nulls) if preparation.nulls else table
        own = replace(own, table=in_radians(table, to_turn))
        if own.issues or issues:
            found = Examined(None, (*issues, *column_issues(own.table, kinds, own.schema)))
        else:
            found = _examined(own.table, own.schema, kinds, preparation, observation_space, action_space)
            found = _with_units(found, to_turn)
    issues = [*raw.issues, *own.issues, *map(own.as_recorded, found.issues)]
    unknown = [
        prefix
        for prefix, space in ((OBSERVATION, observation_space), (ACTION, action_space))
        if space is None and own.schema is None
    ]
    by_type = frozenset(name for name in names if name.startswith(tuple(unknown)) and name not in kinds)
    return Examined(
        None if issues else found.demonstrations, tuple(issues), Decided(frozenset(kinds), by_type)
    )


def _examined(
    table: pa.Table,
    schema: TableSchema | None,
    kinds: Mapping[str, type[Signal]],
    preparation: Preparation,
    observation_space: Space | None,
    action_space: Space | None,
) -> Examined:
    """The same for a table that has all columns that it needs, once."""
    table, index, found = index_table(table, preparation.player, preparation.clock)
    issues = [*found]
    if index is None:
        return Examined(None, (*issues, *column_issues(table, kinds, schema)))
    observations, found = read_signals(
        table, index, OBSERVATION, kinds, observation_space or (schema.observation_space if schema else None)
    )
    issues += found
    actions, found = read_signals(
        table, index, ACTION, kinds, action_space or (schema.action_space if schema else None)
    )
    issues += found
    rows = Rows(table, index, observations, actions)
    if preparation.missing is not None:
        rows = _without_gaps(rows, preparation.missing)
        if len(rows.index.episodes) == 0:
            message = f"all {len(index.episodes):,} episodes lack a value and are left out"
            return Examined(None, (*issues, Issue(message)))
    gap, remedy = "is missing or not a number", Remedy.FILL
    if preparation.missing is not None:
        gap, remedy = f"{gap}, and the rule has no value for it", Remedy.FILL_REST
    for name, missing in zip(observations.columns, np.isnan(rows.observations.rows).T, strict=True):
        issues += rows.index.issue(missing, name, gap, remedy)
    if not actions.whole:
        return Examined(None, tuple(issues))
    final, found = final_rows(rows.actions, rows.index)
    issues += found
    steps, attributes, found = read_facts(rows.table, rows.index, ~final, schema)
    issues += found
    if issues:
        return Examined(None, tuple(issues))
    if preparation.clock is not None and preparation.clock.resample is not None:
        issues += endless(rows.index, preparation.clock)
        if issues:
            return Examined(None, tuple(issues))
        rows, final = _at_even_steps(rows, final, preparation.clock)
        steps, attributes, _ = read_facts(rows.table, rows.index, ~final, schema)
    index = rows.index
    lengths = index.counts - final[index.starts + index.counts - 1]
    demonstrations = Demonstrations(
        observation_space=observations.space,
        action_space=actions.space,
        observations=rows.observations.rows,
        actions=rows.actions.rows[~final],
        observation_starts=index.starts,
        action_starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        final_observed=lengths < index.counts,
        steps=steps,
        attributes={"episode": index.episodes, **attributes},
    )
    return Examined(demonstrations, ())


def _with_units(examined: Examined, degrees: Collection[str]) -> Examined:
    """The same, noting which columns were recorded in degrees."""
    kept = examined.demonstrations
    if kept is None or not degrees:
        return examined
    spaces = noted(kept.observation_space, OBSERVATION, degrees), noted(kept.action_space, ACTION, degrees)
    return replace(examined, demonstrations=replace(kept, observation_space=spaces[0], action_space=spaces[1]))


def _layout_issues(recorded: pa.Table, own: Arranged, preparation: Preparation) -> list[Issue]:
    """Columns that must be there and are not, or that may not be there twice."""
    there, names = recorded.column_names, own.table.column_names
    issues = [
        Issue(f"is there {names.count(name)} times", column=name)
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    called = {preparation.roles.episode, preparation.roles.step}
    missing = [
        Issue(f"needs a column {name!r}{alike(name, there)}", remedy=_NAMING.get(name))
        for name in preparation.needed
        if name not in there and name not in called
    ]
    missing += [
        Issue(f"needs at least one column {prefix}*", remedy=remedy)
        for prefix, remedy in ((OBSERVATION, Remedy.NAME_OBSERVATIONS), (ACTION, Remedy.NAME_ACTIONS))
        if not any(name.startswith(prefix) for name in names)
    ]
    if missing:
        first = missing[0]
        issues += [replace(first, message=f"{first.message}; the columns are {', '.join(there)}"), *missing[1:]]
    if recorded.num_rows == 0:
        issues.append(Issue("needs at least one row, got none"))
    return issues


def _without_gaps(rows: Rows, rule: MissingRule) -> Rows:
    """The same rows with missing values filled, or without the episodes that lack one."""
    nothing_done = np.isnan(rows.actions.rows).all(axis=1) & rows.index.is_last()
    observations, whole = filled(rows.observations, rows.index, rule)
    actions, also_whole = filled(rows.actions, rows.index, rule, ~nothing_done)
    kept = whole & also_whole
    if kept.all():
        return Rows(rows.table, rows.index, observations, actions)
    chosen = kept[rows.index.member]
    return Rows(
        rows.table.filter(pa.array(chosen)),
        rows.index.of_episodes(kept),
        observations.at(chosen),
        actions.at(chosen),
    )


def _at_even_steps(rows: Rows, final: NDArray[np.bool_], clock: Clock) -> tuple[Rows, NDArray[np.bool_]]:
    """The rows at the steps of the clock, and which of them (N,) have no action."""
    table, index, observations, actions, final = resampled(
        rows.table, rows.index, rows.observations, rows.actions, final, clock
    )
    return Rows(table, index, observations, actions), final
