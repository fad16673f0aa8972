"""Distances between paths in a plane.

>>> a, b = np.zeros((3, 2)), np.array([[0.0, 0.0], [3.0, 4.0]])
>>> apart([a], [b]).tolist()  # over the two steps that both have
[2.5]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import wasserstein_distance

from tvae.spaces import FloatArray, IntArray


def apart(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> FloatArray:
    """(E,) mean distance of two paths (N_i, 2) at equal steps, over the steps that both have."""
    return np.array(
        [
            np.linalg.norm(a[: len(b)] - b[: len(a)], axis=1).mean()
            for a, b in zip(first, second, strict=True)
        ]
    )


def ends(paths: Sequence[FloatArray]) -> FloatArray:
    """(E, 2) the last place of each path."""
    return np.stack([path[-1] for path in paths])


def to_nearest(paths: FloatArray, references: FloatArray) -> FloatArray:
    """(E, T) distance of each of `paths` (E, T, 2) to the nearest of `references` (R, T, 2) at the same step.

    >>> to_nearest(np.zeros((1, 2, 2)), np.array([[[3.0, 4.0], [9.0, 9.0]], [[0.0, 9.0], [0.0, 1.0]]])).tolist()
    [[5.0, 1.0]]
    """
    steps = min(paths.shape[1], references.shape[1])
    between = paths[:, None, :steps] - references[None, :, :steps]
    nearest: FloatArray = np.linalg.norm(between, axis=-1).min(axis=1)
    return nearest


def cut_to(paths: Sequence[FloatArray], num_steps: IntArray) -> list[FloatArray]:
    """Each path (N_i, 2) up to its step `num_steps` (E,)."""
    return [path[: steps + 1] for path, steps in zip(paths, num_steps.tolist(), strict=True)]


def earth_mover(first: FloatArray, second: FloatArray) -> float:
    """The Wasserstein-1 distance of two samples of a number, in its unit."""
    return float(wasserstein_distance(first, second))
