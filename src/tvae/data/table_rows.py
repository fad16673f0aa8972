"""A table as demonstrations, with everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import UNKNOWN_CATEGORY, KindError, encode, facts, listed, plain, signal_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.issues import Issue
from tvae.data.table_index import TableIndex, index_table
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.spaces import Binary, Categorical, FloatArray, Signal, Space

STEP_COLUMNS = ("reward", "terminated", "truncated")
"""Facts about steps even where they are the same in a whole episode."""


@dataclass(frozen=True)
class Examined:
    """What a table holds: demonstrations, or the issues that keep it from being any."""

    demonstrations: Demonstrations | None
    issues: tuple[Issue, ...]


def examine(
    table: pa.Table,
    *,
    kinds: Mapping[str, type[Signal]],
    schema: TableSchema | None = None,
    observation_space: Space | None = None,
    action_space: Space | None = None,
) -> Examined:
    """Read a table. Given spaces override the schema's, and `kinds` override both.

    >>> rows = {"episode": [7, 7], "step": [0, 1], "observation.x": [0.0, 1.0], "action.dx": [1.0, None]}
    >>> table = pa.table(rows)
    >>> examine(table, kinds={}).demonstrations[0].observations.tolist()
    [[0.0], [1.0]]
    >>> [str(issue) for issue in examine(table.drop_columns("action.dx"), kinds={}).issues]
    ['needs at least one column action.*; the columns are episode, step, observation.x']
    """
    issues = _layout_issues(table, kinds)
    if issues:
        return Examined(None, tuple(issues))
    table = pa.table([plain(column) for column in table.columns], names=table.column_names)
    table, index, issues = index_table(table)
    if index is None:
        return Examined(None, tuple(issues))
    observations, found = _read_signals(
        table, index, OBSERVATION, kinds, observation_space or (schema.observation_space if schema else None)
    )
    issues += found
    actions, found = _read_signals(
        table, index, ACTION, kinds, action_space or (schema.action_space if schema else None)
    )
    issues += found
    if observations is None or actions is None:
        return Examined(None, tuple(issues))
    for name, missing in zip(observations.columns, np.isnan(observations.rows).T, strict=True):
        issues += index.issue(missing, name, "is missing or not a number")
    final, found = _final_rows(actions, index)
    issues += found
    steps, attributes, found = _read_facts(table, index, ~final, schema)
    issues += found
    if issues:
        return Examined(None, tuple(issues))
    lengths = index.counts - final[index.starts + index.counts - 1]
    demonstrations = Demonstrations(
        observation_space=observations.space,
        action_space=actions.space,
        observations=observations.rows,
        actions=actions.rows[~final],
        observation_starts=index.starts,
        action_starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        final_observed=lengths < index.counts,
        steps=steps,
        attributes={"episode": index.episodes, **attributes},
    )
    return Examined(demonstrations, ())


def _layout_issues(table: pa.Table, kinds: Mapping[str, type[Signal]]) -> list[Issue]:
    """Columns that must be there and are not, or that may not be there twice."""
    names = table.column_names
    there = f"the columns are {', '.join(names)}"
    issues = [
        Issue(f"is there {names.count(name)} times", column=name)
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    issues += [
        Issue(f"needs a column {name!r}; {there}") for name in ("episode", "step") if name not in names
    ]
    issues += [
        Issue(f"needs at least one column {prefix}*; {there}")
        for prefix in (OBSERVATION, ACTION)
        if not any(name.startswith(prefix) for name in names)
    ]
    signals = [name for name in names if name.startswith((OBSERVATION, ACTION))]
    issues += [
        Issue(f"was given a kind, but is no column of a signal; these are: {', '.join(signals)}", column=name)
        for name in kinds
        if name not in signals
    ]
    if table.num_rows == 0:
        issues.append(Issue("needs at least one row, got none"))
    return issues


@dataclass(frozen=True)
class _Signals:
    """All columns of the observations or of the actions."""

    space: Space
    columns: tuple[str, ...]
    rows: FloatArray
    """(N, C), NaN where a value is missing."""


def _read_signals(
    table: pa.Table,
    index: TableIndex,
    prefix: str,
    kinds: Mapping[str, type[Signal]],
    given: Space | None,
) -> tuple[_Signals | None, list[Issue]]:
    names = [name.removeprefix(prefix) for name in table.column_names if name.startswith(prefix)]
    issues: list[Issue] = []
    if given is not None:
        there = ", ".join(prefix + name for name in names) or "none"
        issues += [
            Issue(f"is missing; there are {there}", column=prefix + name) for name in given.names if name not in names
        ]
        expected = ", ".join(prefix + name for name in given.names)
        issues += [
            Issue(f"was not expected; expected are {expected}", column=prefix + name)
            for name in names
            if name not in given.names
        ]
        names = [name for name in given.names if name in names]
    signals: list[Signal] = []
    rows = np.empty((table.num_rows, len(names)))
    for position, name in enumerate(names):
        column = prefix + name
        if table[column].null_count == table.num_rows:
            issues += index.issue(np.ones(table.num_rows, np.bool_), column, "is empty in the whole table")
            continue
        try:
            if given is None or column in kinds:
                signal = signal_of(name, table[column], kinds.get(column))
            else:
                signal = given.signals[given.column(name)]
            rows[:, position] = encode(signal, table[column])
        except KindError as error:
            issues.append(Issue(str(error), column=column))
            continue
        signals.append(signal)
        issues += _value_issues(signal, rows[:, position], table[column], index, column)
    if len(signals) < len(names) or not names:
        return None, issues
    return _Signals(Space(tuple(signals)), tuple(prefix + name for name in names), rows), issues


def _value_issues(
    signal: Signal, raw: FloatArray, values: pa.ChunkedArray, index: TableIndex, column: str
) -> list[Issue]:
    """Values (N,) that are there but not allowed."""
    if isinstance(signal, Categorical):
        bad = raw == UNKNOWN_CATEGORY
        wanted = f"one of {listed(signal.categories)}"
    elif isinstance(signal, Binary):
        bad = ~np.isnan(raw) & (raw != 0) & (raw != 1)
        wanted = "0 or 1"
    else:
        bad = np.isinf(raw)
        wanted = "a finite number"
    if not bad.any():
        return []
    return index.issue(bad, column, f"needs {wanted}, got {values[int(bad.argmax())].as_py()!r}")


def _final_rows(actions: _Signals, index: TableIndex) -> tuple[NDArray[np.bool_], list[Issue]]:
    """(N,) the rows without an action: the observation after the last action, and no other."""
    missing = np.isnan(actions.rows)
    empty = missing.all(axis=1)
    issues: list[Issue] = []
    for name, gone in zip(actions.columns, missing.T, strict=True):
        issues += index.issue(
            gone & ~empty, name, "is missing or not a number, while other actions of the step are there"
        )
    without = np.add.reduceat(~empty, index.starts, dtype=np.int64) == 0
    issues += index.issue(
        np.isin(index.member, np.flatnonzero(without)) & index.is_last(),
        f"{ACTION}*",
        "is empty in the whole episode: an episode needs at least one action",
    )
    issues += index.issue(
        empty & ~index.is_last() & ~without[index.member],
        f"{ACTION}*",
        "is empty, which only the last row of an episode may be",
    )
    return empty & index.is_last(), issues


def _read_facts(
    table: pa.Table, index: TableIndex, rows: NDArray[np.bool_], schema: TableSchema | None
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]], list[Issue]]:
    """Step columns (a value each of `rows`), attributes (a value an episode) and what is wrong with them."""
    steps: dict[str, NDArray[Any]] = {}
    attributes: dict[str, NDArray[Any]] = {}
    issues: list[Issue] = []
    names = [name for name in table.column_names if not name.startswith((OBSERVATION, ACTION))]
    member = index.member[rows]
    firsts = np.flatnonzero(np.diff(member, prepend=-1))
    for name in names:
        column = table[name]
        unknown_and_empty = schema is None and column.null_count == len(column)
        if name in {"episode", "step"} or unknown_and_empty:
            continue
        strict = schema is None and name in STEP_COLUMNS
        missing: list[Issue] = []
        if strict or not pa.types.is_floating(column.type):
            null = pc.is_null(column, nan_is_null=True).to_numpy()
            missing = index.issue(null & rows, name, "is missing or not a number")
        if missing:
            issues += missing
            continue
        if name in STEP_COLUMNS and pa.types.is_string(column.type):
            issues.append(Issue("needs numbers, got text", column=name))
            continue
        kept = column.filter(pa.array(rows)).combine_chunks()
        try:
            values = facts(pa.chunked_array([kept]))
        except KindError as error:
            issues.append(Issue(str(error), column=name))
            continue
        if _is_attribute(name, kept, member, schema):
            attributes[name] = values[firsts]
        else:
            steps[name] = values
    return steps, attributes, issues


def _is_attribute(name: str, values: pa.Array, member: NDArray[np.int64], schema: TableSchema | None) -> bool:
    """Whether values (rows,) say something about episodes: they never change within one."""
    if name in STEP_COLUMNS or (schema is not None and name in schema.steps):
        return False
    codes = values.dictionary_encode(null_encoding="encode").indices.to_numpy()
    return bool(((np.diff(codes) == 0) | (np.diff(member) != 0)).all())
