"""What else a table says about steps and episodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import KindError, facts
from tvae.data.issues import Issue, Remedy
from tvae.data.table_index import TableIndex
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema

STEP_COLUMNS = ("reward", "terminated", "truncated")
"""Facts about steps even where they are the same in a whole episode."""


def read_facts(
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
            missing = index.issue(null & rows, name, "is missing or not a number", Remedy.IGNORE)
        if missing:
            issues += missing
            continue
        if name in STEP_COLUMNS and pa.types.is_string(column.type):
            issues.append(Issue("needs numbers, got text", column=name, remedy=Remedy.IGNORE))
            continue
        kept = column.filter(pa.array(rows)).combine_chunks()
        try:
            values = facts(pa.chunked_array([kept]))
        except KindError as error:
            issues.append(Issue(str(error), column=name, remedy=error.remedy))
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
