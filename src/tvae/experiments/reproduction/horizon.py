"""How errors grow with the steps taken: T-VAE beside behavioural cloning, over all seeds."""

from __future__ import annotations

import numpy as np

from tvae.evaluate.over_seeds import band
from tvae.experiments.reproduction.numbers import Picture, Runs, stacked
from tvae.figures.horizon import horizon
from tvae.figures.panels import Band

_NAMES = {
    "default": "T-VAE",
    "paper": "the paper's reading",
    "cloning_lstm": "cloning, LSTM",
    "cloning_memoryless": "cloning, memoryless",
}


def horizon_picture(runs: Runs, error: str) -> Picture:
    """Mean error at each step, with 95 % intervals over seeds; a bot starts where demonstrations start."""
    bands, tables, means = {}, [], {}
    for preset, name in _NAMES.items():
        if not runs.get(preset):
            continue
        errors = np.array([run["horizon"] for run in runs[preset]])
        means[preset] = errors.mean(0).round(5).tolist()
        mean, low, high = band(errors[:, 1:])
        bands[name] = Band(mean, low.clip(0), high)
        steps = len(mean)
        tables.append(
            {
                "method": [name] * steps,
                "step": list(range(1, steps + 1)),
                "error": mean.round(5).tolist(),
                "low": low.round(5).tolist(),
                "high": high.round(5).tolist(),
            }
        )
    facts = {"error": error, "seeds": {name: len(metrics) for name, metrics in runs.items()}, "mean_by_step": means}
    return Picture("figure-horizon", horizon(bands, y=error), stacked(tables), facts)
