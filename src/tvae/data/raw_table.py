"""Rows as they were recorded, before anything in them is checked."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import pyarrow as pa

from tvae.data.issues import Issue
from tvae.data.names import absent, is_named
from tvae.data.table_schema import TableSchema
from tvae.data.trajectory import DataError


@dataclass(frozen=True)
class RawTable:
    """One row a step, and what reading them has shown already."""

    table: pa.Table
    schema: TableSchema | None = None
    """What we wrote about the columns, if we did."""
    issues: tuple[Issue, ...] = ()
    """Rows that could not be read at all."""

    def only(self, columns: Sequence[str], needed: Collection[str] = ()) -> RawTable:
        """These columns and those below them (`observation` has `observation.x`), and what else is `needed`.

        Raises `DataError` for a column that is not there.

        >>> raw = RawTable(pa.table({"episode": [0], "observation.x": [0.5], "observation.y": [1.5], "note": ["a"]}))
        >>> raw.only(["observation.y"], needed={"episode"}).table.column_names
        ['episode', 'observation.y']
        """
        there = self.table.column_names
        for wanted in columns:
            if not any(is_named(name, wanted) for name in there):
                raise DataError(absent(wanted, there))
        chosen = [
            at
            for at, name in enumerate(there)
            if name in needed or any(is_named(name, wanted) for wanted in columns)
        ]
        schema = None if self.schema is None else self.schema.only([there[at] for at in chosen])
        return replace(self, table=self.table.select(chosen), schema=schema)
