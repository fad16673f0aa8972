"""The observations and the actions in a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import MOST_CATEGORIES, UNKNOWN_CATEGORY, KindError, encode, listed, signal_of
from tvae.data.issues import Issue
from tvae.data.table_index import TableIndex
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.table_times import missing_issue
from tvae.spaces import Binary, Categorical, FloatArray, Signal, Space

_NUMBER = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*$"
_STRAY = "is no number, got {!r}, but most values are: correct it, or say that the column is categorical"


@dataclass(frozen=True)
class Signals:
    """All columns of the observations or of the actions."""

    space: Space
    columns: tuple[str, ...]
    rows: FloatArray
    """(N, C), NaN where a value is missing."""

    def having(self, rows: FloatArray) -> Signals:
        """The same signals with other values."""
        return replace(self, rows=rows)

    def at(self, chosen: NDArray[np.bool_]) -> Signals:
        """The chosen rows (N,) alone."""
        return self.having(self.rows[chosen])


def read_signals(
    table: pa.Table,
    index: TableIndex,
    prefix: str,
    kinds: Mapping[str, type[Signal]],
    given: Space | None,
) -> tuple[Signals | None, list[Issue]]:
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
            if given is None and column not in kinds:
                stray = _stray_text(table[column])
                if stray.any():
                    first = table[column][int(stray.argmax())].as_py()
                    issues += index.issue(stray, column, _STRAY.format(first))
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
    return Signals(Space(tuple(signals)), tuple(prefix + name for name in names), rows), issues


def _stray_text(values: pa.ChunkedArray) -> NDArray[np.bool_]:
    """(N,) the text among what is mostly numbers, and too many different ones for categories."""
    none = np.zeros(len(values), dtype=np.bool_)
    if not pa.types.is_string(values.type) or pc.count_distinct(values).as_py() <= MOST_CATEGORIES:
        return none
    numbers = pc.fill_null(pc.match_substring_regex(values, _NUMBER), True).to_numpy()
    known = len(values) - values.null_count
    return ~numbers if 2 * (~numbers).sum() < known else none


def column_issues(
    table: pa.Table, kinds: Mapping[str, type[Signal]], schema: TableSchema | None
) -> list[Issue]:
    """What is wrong with the columns of signals where it is not known which row is which step."""
    issues = []
    for column in table.column_names:
        if not column.startswith((OBSERVATION, ACTION)) or (schema is not None and column not in kinds):
            continue
        values = table[column]
        try:
            encode(signal_of(column, values, kinds.get(column)), values)
        except KindError as error:
            issues.append(Issue(str(error), column=column))
            continue
        stray = np.zeros(0, np.bool_) if column in kinds else _stray_text(values)
        if stray.any():
            row = int(stray.argmax())
            message = f"{_STRAY.format(values[row].as_py())}, first in row {row + 1} of the data"
            issues.append(Issue(message, column=column, count=int(stray.sum())))
        if column.startswith(OBSERVATION):
            missing = missing_issue(values, column)
            issues += [] if missing is None else [missing]
    return issues


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


def final_rows(actions: Signals, index: TableIndex) -> tuple[NDArray[np.bool_], list[Issue]]:
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
