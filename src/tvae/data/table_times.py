"""When the rows of a table were recorded."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import plain
from tvae.data.issues import Issue
from tvae.data.preparation import Clock
from tvae.spaces import FloatArray


def missing_issue(values: pa.ChunkedArray, column: str) -> Issue | None:
    """An issue where a column that must be whole is not."""
    null = pc.is_null(values, nan_is_null=True).to_numpy()
    if not null.any():
        return None
    return Issue(
        f"is missing, first in row {int(null.argmax()) + 1} of the data", column=column, count=int(null.sum())
    )


def times_of(values: pa.ChunkedArray, column: str) -> FloatArray | Issue:
    """(N,) finite numbers; of dates and times the seconds since the earliest.

    >>> times_of(pa.chunked_array([["2026-01-01 10:00:00.5", "2026-01-01 10:00:00"]]).cast(pa.timestamp("ms")), "t")
    array([0.5, 0. ])
    """
    values = plain(values)
    missing = missing_issue(values, column)
    if missing is not None:
        return missing
    kind = values.type
    if pa.types.is_timestamp(kind) or pa.types.is_time(kind) or pa.types.is_duration(kind):
        whole = pa.int32() if pa.types.is_time32(kind) else pa.int64()
        ticks = values.cast(whole).to_numpy()
        per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[kind.unit]
        seconds: FloatArray = (ticks - ticks.min(initial=ticks[0])) / per_second
        return seconds
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        return Issue(f"needs numbers or times, got {kind}", column=column)
    times: FloatArray = values.cast(pa.float64(), safe=False).to_numpy()
    if not np.isfinite(times).all():
        return Issue("needs finite numbers", column=column, count=int((~np.isfinite(times)).sum()))
    return times


def step_time(times: FloatArray, first: NDArray[np.bool_], clock: Clock) -> float:
    """The time from step to step: as the clock says, else the median over rows (N,) that are no episode's first."""
    if clock.every is not None:
        return clock.every
    gaps = np.diff(times, prepend=0)[~first]
    return float(np.median(gaps)) if len(gaps) else 1.0


def uneven(times: FloatArray, first: NDArray[np.bool_], clock: Clock) -> tuple[float, NDArray[np.bool_]]:
    """The time from step to step, and the rows (N,) that come earlier or later after the one before."""
    every = step_time(times, first, clock)
    off = np.abs(np.diff(times, prepend=0) - every) > clock.tolerance * every
    return every, off & ~first
