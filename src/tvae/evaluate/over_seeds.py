"""A number over several seeds: its mean, with Student's 95 % interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import t

from tvae.spaces import FloatArray


def band(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, lower and upper end of the 95 % interval of `values` (R, ...) over the R seeds, each of shape (...).

    mean +- t_{0.975, R-1} s / sqrt(R); a single seed has no spread, and its interval is that point.
    """
    count = len(values)
    mean = values.mean(0)
    if count == 1:
        return mean, mean, mean
    half = t.ppf(0.975, count - 1) * values.std(0, ddof=1) / np.sqrt(count)
    return mean, mean - half, mean + half


def over_seeds(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The numbers of several runs in one tree of the same shape; what is no number in every run is left out.

    A single seed has no interval: `ci95` is None.

    >>> over_seeds([{"success": {"attack": 0.98}}, {"success": {"attack": 0.96}}])["success"]["attack"]["mean"]
    0.97
    """
    summary: dict[str, Any] = {}
    for name in runs[0]:
        values = [run[name] for run in runs if name in run]
        if len(values) < len(runs):
            continue
        if all(isinstance(value, Mapping) for value in values):
            summary[name] = over_seeds(values)
        elif all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            mean, low, high = (float(number) for number in band(np.array(values, dtype=np.float64)))
            interval = [round(low, 6), round(high, 6)] if len(values) > 1 else None
            summary[name] = {"mean": round(mean, 6), "ci95": interval, "seeds": len(values)}
    return summary
