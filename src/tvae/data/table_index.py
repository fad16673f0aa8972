"""Which row of a table is which step of which episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import facts, plain
from tvae.data.issues import Issue
from tvae.spaces import IntArray


@dataclass(frozen=True)
class TableIndex:
    """Rows ordered by episode, in the order in which episodes first appear, and by step."""

    episodes: NDArray[Any]
    """(E,) identities, integers or text."""
    member: IntArray
    """(N,) position in `episodes` of each row."""
    steps: IntArray
    """(N,) step of each row."""
    starts: IntArray
    """(E,) first row of each episode."""
    counts: IntArray
    """(E,) number of rows of each episode."""

    def is_last(self) -> NDArray[np.bool_]:
        """(N,) whether a row is the last of its episode."""
        last = np.zeros(len(self.member), dtype=np.bool_)
        last[self.starts + self.counts - 1] = True
        return last

    def issue(self, rows: NDArray[np.bool_], column: str, message: str) -> list[Issue]:
        """An issue at the first of these rows (N,); none if there is no such row."""
        if not rows.any():
            return []
        first = int(rows.argmax())
        return [
            Issue(
                message=message,
                column=column,
                episode=self.episodes[self.member[first]].item(),
                step=int(self.steps[first]),
                count=int(rows.sum()),
            )
        ]


def index_table(table: pa.Table) -> tuple[pa.Table, TableIndex | None, list[Issue]]:
    """The table in order, its index, and what is wrong with the columns `episode` and `step`.

    Without an index (None) the issues say why there is none.
    """
    identities, steps, issues = _identities(table), _steps(table), []
    issues += [found for found in (identities, steps) if isinstance(found, Issue)]
    if isinstance(identities, Issue) or isinstance(steps, Issue):
        return table, None, issues
    coded = identities.dictionary_encode().combine_chunks()
    member = coded.indices.to_numpy().astype(np.int64)
    new, later = np.diff(member) > 0, np.diff(member) == 0
    if not (new | (later & (np.diff(steps) >= 0))).all():
        order = np.lexsort((steps, member))
        table, member, steps = table.take(pa.array(order)), member[order], steps[order]
    starts = np.flatnonzero(np.diff(member, prepend=-1))
    index = TableIndex(
        episodes=facts(pa.chunked_array([coded.dictionary])),
        member=member,
        steps=steps,
        starts=starts,
        counts=np.diff(starts, append=len(member)),
    )
    return table, index, _step_issues(index)


def _identities(table: pa.Table) -> pa.ChunkedArray | Issue:
    """Integers or text, none missing."""
    values = plain(table["episode"])
    if pa.types.is_temporal(values.type):
        values = values.cast(pa.string())
    missing = _missing(values, "episode")
    if missing is not None:
        return missing
    if pa.types.is_floating(values.type):
        return _as_integers(values, "episode")
    if pa.types.is_integer(values.type) or pa.types.is_string(values.type):
        return values
    return Issue(f"needs integers or text, got {values.type}", column="episode")


def _steps(table: pa.Table) -> IntArray | Issue:
    """(N,) integers, none missing."""
    values = plain(table["step"])
    missing = _missing(values, "step")
    if missing is not None:
        return missing
    if not (pa.types.is_integer(values.type) or pa.types.is_floating(values.type)):
        return Issue(f"needs the integers 0, 1, 2, ..., got {values.type}", column="step")
    integers = _as_integers(values, "step")
    if isinstance(integers, Issue):
        return integers
    steps: IntArray = integers.to_numpy()
    return steps


def _missing(values: pa.ChunkedArray, column: str) -> Issue | None:
    null = pc.is_null(values, nan_is_null=True).to_numpy()
    if not null.any():
        return None
    return Issue(
        f"is missing, first in row {int(null.argmax()) + 1} of the data", column=column, count=int(null.sum())
    )


def _as_integers(values: pa.ChunkedArray, column: str) -> pa.ChunkedArray | Issue:
    try:
        return values.cast(pa.int64())
    except pa.ArrowInvalid as error:
        return Issue(f"needs integers: {error}", column=column)


def _step_issues(index: TableIndex) -> list[Issue]:
    """Steps must be 0, 1, 2, ... in every episode."""
    difference = np.diff(index.steps, prepend=0)
    first = np.zeros(len(index.steps), dtype=np.bool_)
    first[index.starts] = True
    issues = index.issue(
        first & (index.steps != 0), "step", "is the first of its episode, but the first must be 0"
    )
    issues += index.issue(~first & (difference == 0), "step", "stands there more than once")
    gap = ~first & (difference > 1)
    if gap.any():
        before = int(index.steps[gap.argmax() - 1])
        issues += index.issue(gap, "step", f"leaves a gap: it follows step {before}")
    return issues
