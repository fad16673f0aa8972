"""From points to clusters, and which clusters a noisy sample tells apart.

Points are posterior means in units in which the posteriors' variances are 1, so that a sample is a point plus
standard normal noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.evaluate.mixtures import Components, assign, joined, plausible_mixtures
from tvae.evaluate.valleys import clusters
from tvae.spaces import FloatArray

FEWEST_POINTS = 5
"""A cluster has at least so many points."""
_SMALLEST_SHARE = 0.02
_MOST_FITTED = 2_000
_FLOOR = 0.01
"""Smallest variance of a component."""
_HELD = 0.25
"""Share of two clusters that a cluster of another mixture must hold to make them one."""
_MOST_WRONG = 0.25
"""Share of wrongly told samples above which clusters are not told apart."""


@dataclass(frozen=True, eq=False)
class Separation:
    """Clusters that samples tell apart."""

    clusters: list[Components]
    num_proposed: int
    """How many clusters the points form"""
    confusion: FloatArray
    """(K, K) row: of the samples of a cluster's points, the share told as each cluster"""
    worst: float
    """Largest share of wrongly told samples among the clusters that were joined for it; 0 where none was"""


def separate(points: FloatArray, samples: FloatArray, *, seed: int = 0) -> Separation:
    """The clusters of `points` (N, D) that `samples` (N, D) of them tell apart: `told_apart` of what `propose` gives.

    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat([[-4.0, 0.0], [4.0, 0.0]], 50, axis=0) + rng.standard_normal((100, 2))
    >>> separate(points, points + rng.standard_normal((100, 2))).confusion.tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    return told_apart(propose(points, seed=seed), points, samples)


def everything(points: FloatArray) -> Separation:
    """A single cluster that holds all of `points` (N, D): a Gaussian with their mean and covariance."""
    away = points - points.mean(0)
    covariance = away.T @ away / len(points) + _FLOOR * np.eye(points.shape[1])
    whole = Components(np.ones(1), points.mean(0)[None], covariance[None])
    return Separation([whole], 1, np.ones((1, 1)), 0.0)


def propose(points: FloatArray, *, seed: int = 0) -> list[Components]:
    """The clusters of `points` (N, D), each a group of mixture components.

    A split has to show in every plausible mixture at about the same place: two clusters of the best one are joined
    where a cluster of another holds at least a quarter of each. Clusters of less than 2 % of the points, or of
    fewer than 5, are left out; their points fall to the others.

    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat([[-4.0, 0.0], [4.0, 0.0]], 50, axis=0) + rng.standard_normal((100, 2))
    >>> len(propose(points))
    2
    """
    few = points[np.random.default_rng(seed).permutation(len(points))[:_MOST_FITTED]]
    best, *others = (
        _without_small([mixture.select(cluster) for cluster in clusters(points, mixture)], points)
        for mixture in plausible_mixtures(few, floor=_FLOOR, seed=seed)
    )
    for other in others:
        theirs = np.eye(len(other))[assign(other, points)[0]]
        while len(best) > 1:
            ours = np.eye(len(best))[assign(best, points)[0]]
            held = ours.T @ theirs / np.maximum(ours.sum(0), 1)[:, None]
            both = np.minimum(held[:, None], held).max(2)
            i, j = _largest(both)
            if both[i, j] < _HELD:
                break
            best = _join(best, i, j)
    return best


def told_apart(proposed: list[Components], points: FloatArray, samples: FloatArray) -> Separation:
    """Those clusters that samples tell apart; the others are joined.

    `samples` (N, D) are `points` (N, D) plus noise of variance 1. A sample is told as the cluster under which it is
    most likely, as if all were equally frequent. The two most confused clusters are joined while, of their samples
    or of all clusters' samples, more than a quarter are told wrongly.

    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat([[-0.5], [0.5]], 500, axis=0) + 0.05 * rng.standard_normal((1000, 1))
    >>> separation = told_apart(propose(points), points, points + rng.standard_normal((1000, 1)))
    >>> len(separation.clusters), round(separation.worst, 1)  # P(N(0, 1) > 0.5) = 0.31
    (1, 0.3)
    """
    found, worst = proposed, 0.0
    while True:
        confusion = _confusion(found, points, samples)
        told = np.diag(confusion)
        between = confusion + confusion.T
        pairs = between / np.maximum(between + told + told[:, None], 1e-12)
        i, j = _largest(pairs)
        wrong = float(max(pairs[i, j], 1 - told.mean())) if len(found) > 1 else 0.0
        if wrong <= _MOST_WRONG:
            return Separation(found, len(proposed), confusion, worst)
        found, worst = _join(found, i, j), max(worst, wrong)


def _largest(table: FloatArray) -> tuple[int, int]:
    """Row and column, the row first, of the largest number above the diagonal of `table` (K, K); 0, 0 if K = 1."""
    above = np.where(np.triu(np.ones(table.shape, dtype=bool), 1), table, -1.0)
    row, column = np.unravel_index(above.argmax(), above.shape)
    return int(row), int(column)


def _join(found: list[Components], i: int, j: int) -> list[Components]:
    """`found` with two of them made one."""
    return [*(each for index, each in enumerate(found) if index not in {i, j}), joined(found[i], found[j])]


def _without_small(found: list[Components], points: FloatArray) -> list[Components]:
    """`found` without the smallest, one after another, while they are too small."""
    while True:
        counts = np.bincount(assign(found, points)[0], minlength=len(found))
        smallest = int(counts.argmin())
        if len(found) == 1 or counts[smallest] >= max(FEWEST_POINTS, _SMALLEST_SHARE * len(points)):
            return found
        found = found[:smallest] + found[smallest + 1 :]


def _confusion(found: list[Components], points: FloatArray, samples: FloatArray) -> FloatArray:
    noise = np.ones(points.shape[1])
    told, _ = assign([each.normalised().blurred(noise) for each in found], samples)
    counts = np.zeros((len(found), len(found)))
    np.add.at(counts, (assign(found, points)[0], told), 1.0)
    shares: FloatArray = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    return shares
