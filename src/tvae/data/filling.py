"""Missing values of a table, filled by a rule that the user chose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tvae.data.estimates import MissingRule
from tvae.data.table_index import TableIndex
from tvae.data.table_signals import Signals
from tvae.spaces import FloatArray, Signal


def filled(
    signals: Signals, index: TableIndex, rule: MissingRule, needed: NDArray[np.bool_] | None = None
) -> tuple[Signals, NDArray[np.bool_]]:
    """The signals with the rule's values where one is missing and `needed` (N,), and which episodes (E,) to keep.

    Without `needed` all are. Values that the rule does not have stay NaN.
    """
    missing = np.isnan(signals.rows)
    if needed is not None:
        missing &= needed[:, None]
    kept = np.ones(len(index.episodes), dtype=np.bool_)
    if not missing.any():
        return signals, kept
    rows = signals.rows.copy()
    gaps = np.add.reduceat(missing, index.starts, dtype=np.int64)
    for episode in np.flatnonzero(gaps.any(axis=1)):
        part = slice(index.starts[episode], index.starts[episode] + index.counts[episode])
        for column in np.flatnonzero(gaps[episode]):
            values, signal = rows[part, column], signals.space.signals[column]
            kept[episode] &= _fill(signal, index.times[part], values, missing[part, column], rule)
    return signals.having(rows), kept


def _fill(
    signal: Signal, times: FloatArray, values: FloatArray, missing: NDArray[np.bool_], rule: MissingRule
) -> bool:
    """Write into `values` (T,) where they are `missing`; False to leave the episode out."""
    known = ~np.isnan(values)
    if known.any():
        estimated = rule(signal, times[missing], times[known], values[known])
    else:
        estimated = rule(signal, times[missing], times[:1], np.array([np.nan]))
    if estimated is None:
        return False
    values[missing] = estimated
    return True
