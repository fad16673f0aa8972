"""Which components of a mixture are one cluster: those between which the points show no clear valley.

A Gaussian mixture cuts a bent, flat or heavy-tailed cluster into several components. Whether two components are
really apart is therefore asked of the points themselves, along the line from one middle to the other in the
discriminant projection of the two.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from tvae.evaluate.mixtures import Components
from tvae.spaces import FloatArray

_CLEAR = 0.5
"""A valley counts as clear where it holds less than this share of the lower of its two peaks.

There is no allowance for chance: with two standard deviations of the count in the valley, groups of forty episodes were
made one that twice as many would have shown to be two. Against chance there is BIC, which seldom cuts few points up.
"""
_BANDWIDTH = 0.9
"""Silverman's: h = 0.9 sd n^(-1/5)."""
_TUBE = 0.95
_PLACES = 41
_NOTHING = 1e-9


def clusters(points: FloatArray, components: Components) -> list[list[int]]:
    """The components of each cluster of `points` (N, D).

    Components are gathered, the best connected first: two gatherings become one where the highest pass between
    them is at least half of the lower one's peak (the rule of ToMATo: Chazal, Guibas, Oudot, Skraba,
    "Persistence-based clustering in Riemannian manifolds", 2013). Peaks and passes are densities: a peak that of
    the mixture in a component's middle, a pass as `passes` has it. A component that is then as well connected to
    another cluster as to its own, such as one that holds the outliers of both, is left out.

    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(-1, 1, (400, 1))  # one flat cluster, cut in two
    >>> halves = Components(np.array([0.5, 0.5]), np.array([[-0.5], [0.5]]), np.full((2, 1, 1), 0.08))
    >>> clusters(points, halves)
    [[0, 1]]
    """
    peaks = np.exp(components.log_density(components.means))
    heights = passes(points, components, peaks)
    gathered = [[index] for index in range(len(components))]
    while len(gathered) > 1:
        height, i, j = max(
            (heights[np.ix_(a, b)].max() / min(peaks[a].max(), peaks[b].max()), i, j)
            for i, a in enumerate(gathered)
            for j, b in enumerate(gathered[:i])
        )
        if height < _CLEAR:
            break
        gathered[j] = gathered[j] + gathered.pop(i)
    return [_without_bridges(cluster, gathered, heights / peaks[:, None]) for cluster in gathered]


def _without_bridges(cluster: list[int], gathered: list[list[int]], relative: FloatArray) -> list[int]:
    """The components of a cluster that a clear valley separates from every other cluster; at least the clearest."""
    others = [index for other in gathered if other is not cluster for index in other]
    bridged = relative[np.ix_(cluster, others)].max(axis=1, initial=0.0)
    kept = [index for index, height in zip(cluster, bridged, strict=True) if height < _CLEAR]
    return kept or [cluster[int(bridged.argmin())]]


def passes(points: FloatArray, components: Components, peaks: FloatArray) -> FloatArray:
    """(C, C) the density in the pass between every two components: the lowest on the line between their middles.

    It is measured twice, and the higher one counts: among the points of the two components alone, relative to
    their own density in their middles, and among all points in a tube around the line, relative to `peaks` (C,),
    the whole mixture's density in the middles. Other pieces of a cluster fill gaps that two pieces alone would
    show, and two pieces fill gaps where a bent cluster leaves the tube.
    """
    joint = components.log_densities(points)
    shares = np.exp(joint - logsumexp(joint, axis=1, keepdims=True))
    result = np.zeros((len(components), len(components)))
    for i in range(len(components)):
        for j in range(i):
            pair = components.select([j, i])
            own, all_ = pass_heights(points, pair, shares[:, i] + shares[:, j])
            own_peak = np.exp(pair.log_density(pair.means)).min()
            result[i, j] = result[j, i] = max(own * own_peak, all_ * min(peaks[i], peaks[j]))
    return result


def pass_heights(points: FloatArray, pair: Components, shares: FloatArray) -> FloatArray:
    """(2,) density in the deepest valley between two components, over the lower of the peaks beside it.

    In (0, 1]; 1 means no valley. The first is that of `points` (N, D) weighted by `shares` (N,), how much of each
    belongs to the two components; the second that of all points in a tube that would hold 95 % of the two.

    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat([[-3.0], [3.0]], 100, axis=0) + rng.standard_normal((200, 1))
    >>> pair = Components(np.array([0.5, 0.5]), np.array([[-3.0], [3.0]]), np.ones((2, 1, 1)))
    >>> bool((pass_heights(points, pair, np.ones(200)) < 0.3).all())
    True
    """
    root = np.linalg.cholesky(pair.covariances.mean(0))
    white = np.linalg.solve(root, (points - pair.means[0]).T)
    towards = np.linalg.solve(root, pair.means[1] - pair.means[0])
    distance = float(np.linalg.norm(towards))
    if distance < _NOTHING:
        return np.ones(2)
    towards /= distance
    along = towards @ white
    aside = (white**2).sum(0) - along**2
    tube = aside <= (chi2.ppf(_TUBE, len(root) - 1) if len(root) > 1 else math.inf)
    direction = np.linalg.solve(root.T, towards)
    spreads = np.sqrt(np.einsum("d,cde,e->c", direction, pair.covariances, direction))
    bandwidths = _BANDWIDTH * spreads * (pair.weights * len(points)) ** -0.2
    return _valleys(along, np.stack([shares, tube], axis=1), distance, bandwidths)


def _valleys(positions: FloatArray, weights: FloatArray, distance: float, bandwidths: FloatArray) -> FloatArray:
    """(M,) lowest density of `positions` (N,) between 0 and `distance`, over the lower of the peaks beside it.

    Once for each column of `weights` (N, M). The kernel estimate's width goes from one of the two `bandwidths` to
    the other.
    """
    places = np.linspace(0, 1, _PLACES)
    widths = (bandwidths[0] + places * (bandwidths[1] - bandwidths[0]))[:, None]
    kernels = np.exp(-0.5 * ((places[:, None] * distance - positions) / widths) ** 2)
    density = kernels @ weights / widths
    peaks = np.minimum(np.maximum.accumulate(density), np.maximum.accumulate(density[::-1])[::-1])
    lowest: FloatArray = (density / np.maximum(peaks, _NOTHING)).min(0)
    return np.minimum(lowest, 1.0)
