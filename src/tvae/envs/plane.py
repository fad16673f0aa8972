"""Points and directions in the plane. Angles in radians, counterclockwise from the x axis."""

from __future__ import annotations

import numpy as np

from tvae.spaces import FloatArray


def direction(angle: FloatArray) -> FloatArray:
    """Unit vectors (..., 2) of angles (...)."""
    return np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def bearing(vector: FloatArray) -> FloatArray:
    """Angles (...) in [-pi, pi] of vectors (..., 2); 0 for the zero vector.

    >>> bearing(np.array([[0.0, 2.0], [-1.0, 0.0]])) / np.pi
    array([0.5, 1. ])
    """
    angle: FloatArray = np.arctan2(vector[..., 1], vector[..., 0])
    return angle


def length(vector: FloatArray) -> FloatArray:
    """Euclidean lengths (...) of vectors (..., 2)."""
    value: FloatArray = np.hypot(vector[..., 0], vector[..., 1])
    return value
