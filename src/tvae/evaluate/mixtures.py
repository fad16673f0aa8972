"""Gaussian mixtures that explain a cloud of points about equally well.

Their components are pieces, not yet clusters: a bent or flat cluster takes several. `tvae.evaluate.valleys` says
which pieces belong together.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from tvae.spaces import FloatArray, IntArray

_MOST_COMPONENTS = 15
_STARTED_POINTS = 1_000
_FEWEST_STARTS = 2
_MOST_STARTS = 10
"""A mixture is fitted from 1,000 / N starts, 2 at least and 10 at most: few points hold many ways to fit them badly."""
_PATIENCE = 3
"""How many component counts in a row may fail to improve BIC before the search ends."""
_VERY_STRONG = 10.0
"""A difference in BIC beyond which the evidence is called very strong (Kass and Raftery, 1995)."""
_AS_GOOD = 0.02
"""A difference in BIC per point that makes no practical difference: 0.01 nats of log-likelihood."""
_MOST_PLAUSIBLE = 6
_BLOCK_POINTS = 1 << 16
"""Points whose densities are in memory at once."""
_POINTS_PER_COMPONENT = 3


@dataclass(frozen=True, eq=False)
class Components:
    """sum_c w_c N(m_c, S_c), by its C components in D dimensions.

    >>> two = Components(np.array([0.5, 0.5]), np.array([[0.0], [2.0]]), np.ones((2, 1, 1)))
    >>> two.log_densities(np.array([[1.0]])).round(3).tolist()  # ln(1/2) - ln(2 pi)/2 - 1/2, twice
    [[-2.112, -2.112]]
    """

    weights: FloatArray
    """(C,)"""
    means: FloatArray
    """(C, D)"""
    covariances: FloatArray
    """(C, D, D)"""

    def __len__(self) -> int:
        return len(self.weights)

    def select(self, components: Sequence[int]) -> Components:
        """The components at these positions, with the weights they have."""
        at = np.asarray(components, dtype=np.int64)
        return Components(self.weights[at], self.means[at], self.covariances[at])

    def normalised(self) -> Components:
        """The same components with weights that sum to 1."""
        return Components(self.weights / self.weights.sum(), self.means, self.covariances)

    def scaled(self, units: FloatArray) -> Components:
        """The same components where points are multiplied by `units` (D,)."""
        return Components(self.weights, self.means * units, self.covariances * np.outer(units, units))

    def blurred(self, variances: FloatArray) -> Components:
        """The components of points to which independent noise of these `variances` (D,) is added."""
        return Components(self.weights, self.means, self.covariances + np.diag(variances))

    def log_densities(self, points: FloatArray) -> FloatArray:
        """(N, C) log w_c N(x; m_c, S_c) of `points` (N, D)."""
        result = np.empty((len(points), len(self)))
        for index in range(len(self)):
            root = np.linalg.cholesky(self.covariances[index])
            white = np.linalg.solve(root, (points - self.means[index]).T)
            size = math.log(self.weights[index]) - float(np.log(np.diag(root)).sum())
            result[:, index] = size - 0.5 * (white**2).sum(0) - 0.5 * points.shape[1] * math.log(2 * math.pi)
        return result

    def log_density(self, points: FloatArray) -> FloatArray:
        """(N,) log of the sum of all components' densities at `points` (N, D)."""
        total: FloatArray = logsumexp(self.log_densities(points), axis=1)
        return total


def joined(first: Components, second: Components) -> Components:
    """The components of both."""
    return Components(
        np.concatenate([first.weights, second.weights]),
        np.concatenate([first.means, second.means]),
        np.concatenate([first.covariances, second.covariances]),
    )


def assign(clusters: Sequence[Components], points: FloatArray) -> tuple[IntArray, FloatArray]:
    """The most likely of K clusters (N,) for each of `points` (N, D), and its posterior probability (N,).

    A cluster's density is the sum of its components', weights included.

    >>> left = Components(np.array([0.5]), np.array([[0.0]]), np.ones((1, 1, 1)))
    >>> right = Components(np.array([0.5]), np.array([[2.0]]), np.ones((1, 1, 1)))
    >>> cluster, probability = assign([left, right], np.array([[2.0]]))
    >>> cluster.tolist(), probability.round(3).tolist()  # 1 / (1 + exp(-2))
    ([1], [0.881])
    """
    cluster, probability = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    for first in range(0, len(points), _BLOCK_POINTS):
        block = slice(first, first + _BLOCK_POINTS)
        joint = np.stack([components.log_density(points[block]) for components in clusters], axis=1)
        cluster[block] = joint.argmax(1)
        probability[block] = np.exp(joint.max(1) - logsumexp(joint, axis=1))
    return cluster, probability


def plausible_mixtures(points: FloatArray, *, floor: float, seed: int = 0) -> list[Components]:
    """The Gaussian mixtures of `points` (N, D) that are about as good as the best by BIC, best first, at most 6.

    Searched are full, shared, diagonal and spherical covariances, each with 1, 2, ... components until BIC has
    risen three times in a row; the likeliest of several starts counts. `floor` is added to every variance.

    BIC = -2 log-likelihood + parameters ln N. About as good means within 10 + 0.02 N: 10 is very strong evidence
    (Kass and Raftery, "Bayes factors", 1995), 0.01 nats a point no practical difference.

    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat([[-5.0], [5.0]], 50, axis=0) + rng.standard_normal((100, 1))
    >>> len(plausible_mixtures(points, floor=0.01)[0])
    2
    """
    kinds = ("full", "tied", "diag", "spherical") if points.shape[1] > 1 else ("full", "tied")
    fits = [fit for kind in kinds for fit in _fits(points, kind, floor, seed)]
    fits.sort(key=lambda fit: fit[0])
    most = fits[0][0] + _VERY_STRONG + _AS_GOOD * len(points)
    return [components for score, components in fits if score <= most][:_MOST_PLAUSIBLE]


def _fits(points: FloatArray, kind: str, floor: float, seed: int) -> Iterator[tuple[float, Components]]:
    """BIC and components for 1, 2, ... components of one kind of covariance; a fit that diverges is left out."""
    distinct = len(np.unique(points, axis=0))
    most = min(_MOST_COMPONENTS, len(points) // _POINTS_PER_COMPONENT, distinct)
    starts = min(max(_STARTED_POINTS // len(points), _FEWEST_STARTS), _MOST_STARTS)
    best, stale = math.inf, 0
    for count in range(1, max(most, 1) + 1):
        mixture = GaussianMixture(
            count,
            covariance_type=kind,
            reg_covar=floor,
            max_iter=500,
            n_init=1 if count == 1 else starts,
            random_state=seed,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # `converged_` is looked at instead
            mixture.fit(points)
        score = float(mixture.bic(points)) if mixture.converged_ else math.inf
        if mixture.converged_:
            yield score, _components(mixture)
        stale = 0 if score < best else stale + 1
        best = min(best, score)
        if stale == _PATIENCE:
            break


def _components(mixture: GaussianMixture) -> Components:
    count, width = mixture.means_.shape
    spread = mixture.covariances_
    match mixture.covariance_type:
        case "full":
            covariances = spread
        case "tied":
            covariances = np.broadcast_to(spread, (count, width, width))
        case "diag":
            covariances = spread[:, :, None] * np.eye(width)
        case _:
            covariances = spread[:, None, None] * np.eye(width)
    return Components(mixture.weights_, mixture.means_, np.array(covariances))
