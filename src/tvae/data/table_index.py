"""Which row of a table is which step of which episode."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import facts, plain
from tvae.data.issues import Issue, Remedy
from tvae.data.preparation import Clock
from tvae.data.table_times import missing_issue, times_of, uneven
from tvae.spaces import FloatArray, IntArray


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
    times: FloatArray
    """(N,) when each row was recorded; its step where nothing else is known."""

    def slices(self) -> Iterator[slice]:
        """The rows of each episode."""
        return (slice(first, first + count) for first, count in zip(self.starts, self.counts, strict=True))

    def of_episodes(self, kept: NDArray[np.bool_]) -> TableIndex:
        """The index of the rows of these episodes (E,) alone."""
        rows = kept[self.member]
        counts = self.counts[kept]
        return TableIndex(
            episodes=self.episodes[kept],
            member=np.repeat(np.arange(len(counts)), counts),
            steps=self.steps[rows],
            starts=np.cumsum(counts) - counts,
            counts=counts,
            times=self.times[rows],
        )

    def is_last(self) -> NDArray[np.bool_]:
        """(N,) whether a row is the last of its episode."""
        last = np.zeros(len(self.member), dtype=np.bool_)
        last[self.starts + self.counts - 1] = True
        return last

    def issue(
        self, rows: NDArray[np.bool_], column: str, message: str, remedy: Remedy | None = None
    ) -> list[Issue]:
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
                remedy=remedy,
            )
        ]


def index_table(
    table: pa.Table, player: str | None = None, clock: Clock | None = None
) -> tuple[pa.Table, TableIndex | None, list[Issue]]:
    """The table in order, its index, and what is wrong with the columns that say which row is which step.

    Without an index (None) the issues say why there is none.
    """
    issues: list[Issue] = []
    if player is not None:
        table, issues = _by_player(table, player)
        if issues:
            return table, None, issues
    identities = _identities(table, "episode")
    order = _steps(table) if clock is None else times_of(table[clock.column], clock.column)
    if isinstance(identities, Issue) or isinstance(order, Issue):
        return table, None, [found for found in (identities, order) if isinstance(found, Issue)]
    coded = identities.dictionary_encode().combine_chunks()
    member = coded.indices.to_numpy().astype(np.int64)
    new, later = np.diff(member) > 0, np.diff(member) == 0
    if not (new | (later & (np.diff(order) >= 0))).all():
        by_time = np.lexsort((order, member))
        table, member, order = table.take(pa.array(by_time)), member[by_time], order[by_time]
    starts = np.flatnonzero(np.diff(member, prepend=-1))
    counts = np.diff(starts, append=len(member))
    index = TableIndex(
        episodes=facts(pa.chunked_array([coded.dictionary])),
        member=member,
        steps=order.astype(np.int64) if clock is None else np.arange(len(member)) - np.repeat(starts, counts),
        starts=starts,
        counts=counts,
        times=order.astype(np.float64),
    )
    return table, index, _step_issues(index) if clock is None else _time_issues(index, clock)


def _by_player(table: pa.Table, player: str) -> tuple[pa.Table, list[Issue]]:
    """The same rows with an identity for each player of an episode, and the fact `session` besides."""
    sessions, players = _identities(table, "episode"), _identities(table, player)
    issues = []
    if "session" in table.column_names:
        message = "is there already, but names the episode that players share"
        issues.append(Issue(message, column="session", remedy=Remedy.IGNORE))
    if issues or isinstance(sessions, Issue) or isinstance(players, Issue):
        return table, [*issues, *(found for found in (sessions, players) if isinstance(found, Issue))]
    pair = [column.cast(pa.string()) for column in (sessions, players)]
    names = pc.binary_join_element_wise(*pair, "/")
    different = pa.table({"session": pair[0], "player": pair[1]}).group_by(["session", "player"]).aggregate([])
    if pc.count_distinct(names).as_py() < len(different):
        return table, [Issue("and the episode look alike when joined by /", column=player)]
    at = table.column_names.index("episode")
    return table.set_column(at, "episode", names).append_column("session", sessions), []


def _identities(table: pa.Table, column: str) -> pa.ChunkedArray | Issue:
    """Integers or text, none missing."""
    values = plain(table[column])
    if pa.types.is_temporal(values.type):
        values = values.cast(pa.string())
    missing = missing_issue(values, column)
    if missing is not None:
        return missing
    if pa.types.is_floating(values.type):
        return _as_integers(values, column)
    if pa.types.is_integer(values.type) or pa.types.is_string(values.type):
        return values
    return Issue(f"needs integers or text, got {values.type}", column=column)


def _steps(table: pa.Table) -> IntArray | Issue:
    """(N,) integers, none missing."""
    values = plain(table["step"])
    missing = missing_issue(values, "step")
    if missing is not None:
        return missing
    if not (pa.types.is_integer(values.type) or pa.types.is_floating(values.type)):
        return Issue(f"needs the integers 0, 1, 2, ..., got {values.type}", column="step")
    integers = _as_integers(values, "step")
    if isinstance(integers, Issue):
        return integers
    steps: IntArray = integers.to_numpy()
    return steps


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
        first & (index.steps != 0), "step", "is the first of its episode, but the first must be 0", Remedy.TELL_TIME
    )
    twice = ~first & (difference == 0)
    issues += index.issue(twice, "step", "stands there more than once", Remedy.TELL_PLAYERS_APART)
    gap = ~first & (difference > 1)
    if gap.any():
        before = int(index.steps[gap.argmax() - 1])
        issues += index.issue(gap, "step", f"leaves a gap: it follows step {before}", Remedy.RESAMPLE)
    return issues


def _time_issues(index: TableIndex, clock: Clock) -> list[Issue]:
    """Rows of an episode must differ in time and, unless they are resampled, be equally far apart."""
    first = np.zeros(len(index.steps), dtype=np.bool_)
    first[index.starts] = True
    twice = ~first & (np.diff(index.times, prepend=0) == 0)
    message = "stands there more than once in the episode"
    issues = index.issue(twice, clock.column, message, Remedy.TELL_PLAYERS_APART)
    if issues or clock.resample is not None:
        return issues
    every, wrong = uneven(index.times, first, clock)
    if not wrong.any():
        return []
    at = int(wrong.argmax())
    gap = index.times[at] - index.times[at - 1]
    message = f"is {gap:.4g} after the row before, but steps are {every:.4g} apart: resample by a rule"
    return index.issue(wrong, clock.column, message, Remedy.RESAMPLE)
