"""Recordings with uneven steps, at steps that are equally far apart."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.estimates import Estimate
from tvae.data.issues import Issue
from tvae.data.preparation import Clock
from tvae.data.ragged import ranges
from tvae.data.table_index import TableIndex
from tvae.data.table_signals import Signals
from tvae.data.table_times import step_time
from tvae.spaces import FloatArray, IntArray

_MOST_STEPS_A_ROW = 1000


def endless(index: TableIndex, clock: Clock) -> list[Issue]:
    """Episodes of which far more steps than rows would be made, as where one row has a time of another kind."""
    first = np.zeros(len(index.member), dtype=np.bool_)
    first[index.starts] = True
    every = step_time(index.times, first, clock)
    steps = (index.times[index.starts + index.counts - 1] - index.times[index.starts]) / every + 1
    long = np.flatnonzero(steps > _MOST_STEPS_A_ROW * index.counts)
    if len(long) == 0:
        return []
    after = np.zeros_like(first)
    for episode in long:
        start = index.starts[episode]
        gaps = np.diff(index.times[start : start + index.counts[episode]])
        after[start + 1 + gaps.argmax()] = True
    at = int(after.argmax())
    gap, rows, made = index.times[at] - index.times[at - 1], index.counts[long[0]], steps[long[0]]
    message = (
        f"is {gap:,.10g} after the row before; at a step every {every:.4g} the episode's {rows:,} rows would become "
        f"{made:,.10g} steps, more than {_MOST_STEPS_A_ROW:,} times as many: mend the time, or say a longer one from "
        "step to step (--every)"
    )
    return index.issue(after, clock.column, message)


def resampled(
    table: pa.Table,
    index: TableIndex,
    observations: Signals,
    actions: Signals,
    final: NDArray[np.bool_],
    clock: Clock,
) -> tuple[pa.Table, TableIndex, Signals, Signals, NDArray[np.bool_]]:
    """All of it, and which rows are `final` (N,), at the clock's steps from each episode's first row on.

    Observations and actions follow the clock's rule. What happens between two steps counts at the earlier one: a
    binary action, `terminated` or `truncated` that is there once is there, and rewards add up. Everything else is as
    it was last recorded. The observation after the last action stays where it falls on a step.
    """
    assert clock.resample is not None
    first = np.zeros(len(index.member), dtype=np.bool_)
    first[index.starts] = True
    every = step_time(index.times, first, clock)
    at = (index.times - index.times[index.starts][index.member]) / every
    near = np.abs(at - np.round(at)) <= clock.tolerance
    at = np.where(near, np.round(at), at)
    last = index.starts + index.counts - 1
    # A row without an action that falls between two steps ends the episode without being a step.
    counts = np.floor(at[last]).astype(np.int64) + 1
    new_final = np.zeros(int(counts.sum()), dtype=np.bool_)
    ends = np.cumsum(counts) - 1
    new_final[ends] = final[last] & (at[last] == np.floor(at[last]))
    acting = counts - new_final[ends]
    member = np.repeat(np.arange(len(counts)), counts)
    step = ranges(np.zeros_like(counts), counts)
    new = TableIndex(index.episodes, member, step, ends + 1 - counts, counts, step.astype(np.float64))
    cell = _cells(at, index, new, acting)
    seen = _estimated(observations, at, np.ones_like(final), index, new, clock.resample)
    done = _estimated(actions, at, ~final, index, new, clock.resample)
    for column in actions.space.binary:
        done[:, column] = _any(actions.rows[~final, column], cell[~final], done[:, column])
    done[new_final] = np.nan
    held = _held(at, index, new)
    table = _facts(table, held, ~final, cell, len(member))
    table = _set(table, clock.column, _moments(table[clock.column], index, held, new.times * every))
    return table, new, observations.having(seen), actions.having(done), new_final


def _cells(at: FloatArray, index: TableIndex, new: TableIndex, acting: IntArray) -> IntArray:
    """(N,) the new row at or before each row, at most the last one with an action."""
    within = np.minimum(np.floor(at).astype(np.int64), (acting - 1)[index.member])
    cells: IntArray = new.starts[index.member] + within
    return cells


def _held(at: FloatArray, index: TableIndex, new: TableIndex) -> IntArray:
    """(M,) the last row at or before each new one."""
    held = [
        part.start + np.searchsorted(at[part], new.times[to], side="right") - 1
        for part, to in zip(index.slices(), new.slices(), strict=True)
    ]
    rows: IntArray = np.concatenate(held)
    return rows


def _estimated(
    signals: Signals,
    at: FloatArray,
    known: NDArray[np.bool_],
    index: TableIndex,
    new: TableIndex,
    rule: Estimate,
) -> FloatArray:
    """(M, C) the rule's values at the new rows from the rows (N,) that are known.

    Behind the last one, which a rule may know nothing of, it holds.
    """
    rows = np.empty((len(new.member), signals.rows.shape[1]))
    for part, to in zip(index.slices(), new.slices(), strict=True):
        times = at[part][known[part]]
        wanted = np.minimum(new.times[to], times[-1])
        for column, signal in enumerate(signals.space.signals):
            rows[to, column] = rule(signal, wanted, times, signals.rows[part, column][known[part]])
    return rows


def _any(values: FloatArray, cell: IntArray, held: FloatArray) -> FloatArray:
    """(M,) whether a value in a cell is 1; what is held where a cell has no row."""
    most = np.full(len(held), -1.0)
    np.maximum.at(most, cell, values)
    return np.where(most < 0, held, most)


def _facts(
    table: pa.Table, held: IntArray, acting: NDArray[np.bool_], cell: IntArray, count: int
) -> pa.Table:
    """The table at the new rows, with rewards added up and ends kept."""
    taken = table.take(pa.array(held))
    for name in ("reward", "terminated", "truncated"):
        if name not in table.column_names:
            continue
        kind = table[name].type
        if not (pa.types.is_boolean(kind) or pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            continue
        values = table[name].filter(pa.array(acting)).cast(pa.float64()).to_numpy()
        together = np.zeros(count)
        gather = np.add if name == "reward" else np.maximum
        gather.at(together, cell[acting], values)
        column = pa.chunked_array([together])
        taken = _set(taken, name, column if name == "reward" else pc.cast(column, kind, safe=False))
    return taken


def _set(table: pa.Table, name: str, column: pa.ChunkedArray) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, column)


def _moments(recorded: pa.ChunkedArray, index: TableIndex, held: IntArray, later: FloatArray) -> pa.ChunkedArray:
    """When the new rows are, `later` (M,) than their episode's first; times of the day stay as last recorded."""
    times = index.times[index.starts][index.member[held]] + later
    if pa.types.is_timestamp(recorded.type):
        nanoseconds = pa.chunked_array([np.round((times - index.times[held]) * 1e9).astype(np.int64)])
        return pc.add(recorded, nanoseconds.cast(pa.duration("ns")))
    return recorded if pa.types.is_temporal(recorded.type) else pa.chunked_array([times])
