"""Distances between paths in a plane.

>>> a, b = np.zeros((3, 2)), np.array([[0.0, 0.0], [3.0, 4.0]])
>>> apart([a], [b]).tolist()
[5.0]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import wasserstein_distance

from tvae.spaces import FloatArray, IntArray


def apart(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> FloatArray:
    """(E,) mean distance of two paths (N_i, 2) at equal steps after their common start.

    The one that ends first stands at its last place.
    """
    distances = []
    for a, b in zip(first, second, strict=True):
        steps = np.arange(1, max(len(a), len(b), 2))
        there = a[np.minimum(steps, len(a) - 1)] - b[np.minimum(steps, len(b) - 1)]
        distances.append(np.linalg.norm(there, axis=1).mean())
    return np.array(distances)


def ends(paths: Sequence[FloatArray]) -> FloatArray:
    """(E, 2) the last place of each path."""
    return np.stack([path[-1] for path in paths])


def to_nearest(paths: FloatArray, references: FloatArray) -> FloatArray:
    """(E, T) distance at each step of `paths` (E, T, 2) to that of `references` (R, T, 2) which is nearest on average.

    >>> to_nearest(np.zeros((1, 2, 2)), np.array([[[3.0, 4.0], [0.0, 9.0]], [[0.0, 9.0], [0.0, 1.0]]])).tolist()
    [[9.0, 1.0]]
    """
    errors = []
    for path in paths:
        between = np.linalg.norm(references - path, axis=-1)
        errors.append(between[between.mean(1).argmin()])
    return np.stack(errors)


def cut_to(paths: Sequence[FloatArray], num_steps: IntArray) -> list[FloatArray]:
    """Each path (N_i, 2) up to its step `num_steps` (E,)."""
    return [path[: steps + 1] for path, steps in zip(paths, num_steps.tolist(), strict=True)]


def earth_mover(first: FloatArray, second: FloatArray) -> float:
    """The Wasserstein-1 distance of two samples of a number, in its unit."""
    return float(wasserstein_distance(first, second))
