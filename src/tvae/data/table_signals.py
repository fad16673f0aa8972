"""The observations and the actions in a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import MOST_CATEGORIES, UNKNOWN_CATEGORY, KindError, encode, listed, signal_of
from tvae.data.issues import Issue, Remedy
from tvae.data.table_index import TableIndex
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.table_times import missing_issue
from tvae.data.texts import as_numbers, no_numbers, some_of
from tvae.spaces import (
    Angular,
    Binary,
    Categorical,
    Continuous,
    FloatArray,
    Signal,
    Space,
    representable,
    wanted_number,
)

_STRAY = (
    "is no number, got {}, but most values are: say which texts are missing values, or that the column is categorical"
)


@dataclass(frozen=True)
class Signals:
    """All columns of the observations or of the actions."""

    space: Space
    columns: tuple[str, ...]
    rows: FloatArray
    """(N, C), NaN where a value is missing."""
    whole: bool = True
    """Whether none was left out since it could not be read."""

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
) -> tuple[Signals, list[Issue]]:
    """The columns with this prefix that can be read, and what is wrong with them and the others."""
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
    for name in names:
        column = prefix + name
        values = table[column]
        if values.null_count == table.num_rows:
            empty = np.ones(table.num_rows, np.bool_)
            issues += index.issue(empty, column, "is empty in the whole table", Remedy.IGNORE)
            continue
        known = None if given is None else given.signals[given.column(name)]
        wanted = kinds.get(column, None if known is None else type(known))
        known = known if type(known) is wanted else None
        stray = _stray_text(values, wanted)
        if stray.any():
            message = _STRAY.format(some_of(values, stray))
            issues += index.issue(stray, column, message, Remedy.SAY_TEXT_IS_MISSING)
        if stray.any() and wanted is not None:
            continue
        values = _numbers(values, wanted)
        try:
            signal = signal_of(name, values, wanted) if known is None else known
            rows[:, len(signals)] = encode(signal, values)
        except KindError as error:
            if not stray.any():
                issues.append(Issue(str(error), column=column, remedy=error.remedy))
            continue
        issues += _value_issues(signal, rows[:, len(signals)], values, index, column)
        signals.append(signal)
    space = Space(tuple(signals))
    columns = tuple(prefix + name for name in space.names)
    return Signals(space, columns, rows[:, : len(signals)], len(signals) == len(names) > 0), issues


def _stray_text(values: pa.ChunkedArray, wanted: type[Signal] | None) -> NDArray[np.bool_]:
    """(N,) the text among what is mostly numbers, where these are wanted or too many for categories."""
    none = np.zeros(len(values), dtype=np.bool_)
    if not pa.types.is_string(values.type) or wanted in {Categorical, Binary}:
        return none
    if wanted is None and pc.count_distinct(values).as_py() <= MOST_CATEGORIES:
        return none
    stray = no_numbers(values)
    known = len(values) - values.null_count
    return stray if 2 * stray.sum() < known else none


def _numbers(values: pa.ChunkedArray, wanted: type[Signal] | None) -> pa.ChunkedArray:
    """The same, with text that is numbers as numbers where these are wanted."""
    if not pa.types.is_string(values.type) or wanted not in {Continuous, Angular} or no_numbers(values).any():
        return values
    return as_numbers(values)


def column_issues(
    table: pa.Table, kinds: Mapping[str, type[Signal]], schema: TableSchema | None
) -> list[Issue]:
    """What is wrong with the columns of signals where it is not known which row is which step."""
    issues = []
    for column in table.column_names:
        if not column.startswith((OBSERVATION, ACTION)) or (schema is not None and column not in kinds):
            continue
        values, wanted = table[column], kinds.get(column)
        stray = _stray_text(values, wanted)
        if stray.any():
            message = f"{_STRAY.format(some_of(values, stray))}, first in row {int(stray.argmax()) + 1} of the data"
            remedy = Remedy.SAY_TEXT_IS_MISSING
            issues.append(Issue(message, column=column, count=int(stray.sum()), remedy=remedy))
        else:
            try:
                values = _numbers(values, wanted)
                encode(signal_of(column, values, wanted), values)
            except KindError as error:
                issues.append(Issue(str(error), column=column, remedy=error.remedy))
                continue
        if column.startswith(OBSERVATION):
            missing = missing_issue(values, column)
            issues += [] if missing is None else [missing.mended_by(Remedy.FILL)]
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
        bad = ~np.isnan(raw) & ~representable(raw)
        wanted = wanted_number(float(raw[bad.argmax()]))
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
            gone & ~empty, name, "is missing or not a number, while other actions of the step are there", Remedy.FILL
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
        Remedy.FILL,
    )
    return empty & index.is_last(), issues
