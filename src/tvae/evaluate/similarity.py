"""How far apart two episodes are, by what the encoder says of each.

The distance of q_i = N(mu_i, diag sigma_i^2) and q_j is Bhattacharyya's, in nats:

    D(i, j) = -log integral sqrt(q_i(z) q_j(z)) dz
            = sum_d [ (mu_id - mu_jd)^2 / (4 (sigma_id^2 + sigma_jd^2))
                      + 1/2 log( (sigma_id^2 + sigma_jd^2) / (2 sigma_id sigma_jd) ) ]

and exp(-D) in [0, 1] is their overlap. The best guess, given one draw z, of which of the two episodes it came from errs
with a probability of at most half the overlap: two episodes are near where draws from them are alike, which is also
what makes a style here. Compared with others:

- the distance between means alone takes every feature of z for as sharp as any other. Here a difference counts in
  units of how well it is known, and a feature that the model does not use (mean 0, scale 1 for all) counts nothing;
- Mahalanobis' distance in the scales of one episode is not symmetric, and does not see that one episode is known well
  and the other hardly;
- the symmetric Kullback-Leibler divergence grows like the square of the ratio of the scales, so that a short episode,
  whose z is known less well, is far from everything. Here the ratio enters by its logarithm.

It changes with no rescaling of a feature of z. It obeys no triangle inequality; sqrt(1 - exp(-D)) does.
"""

from __future__ import annotations

import numpy as np

from tvae.evaluate.encoding import Posteriors
from tvae.spaces import FloatArray, IntArray


def distances(posteriors: Posteriors, to: int) -> FloatArray:
    """(N,) D(i, to) of each of N episodes and the one at position `to`, in nats; 0 for itself.

    Raises `IndexError` for a position that is none.

    >>> two = Posteriors(means=np.array([[0.0], [2.0]]), scales=np.ones((2, 1)))
    >>> distances(two, 0).tolist()  # 2^2 / (4 * 2)
    [0.0, 0.5]
    """
    if not 0 <= to < len(posteriors):
        raise IndexError(f"needs a position from 0 to {len(posteriors) - 1}, got {to}")
    variances = posteriors.scales**2 + posteriors.scales[to] ** 2
    apart = (posteriors.means - posteriors.means[to]) ** 2 / (4 * variances)
    spread = 0.5 * np.log(variances / (2 * posteriors.scales * posteriors.scales[to]))
    total: FloatArray = np.maximum(apart + spread, 0.0).sum(1)
    return total


def overlap(distance: FloatArray) -> FloatArray:
    """exp(-D), from 0 (draws from the two never meet) to 1 (one and the same posterior)."""
    shared: FloatArray = np.exp(-distance)
    return shared


def nearest(posteriors: Posteriors, to: int, count: int) -> tuple[IntArray, FloatArray]:
    """Positions of the `count` episodes nearest to the one at `to`, nearest first, and D of each; without itself.

    Fewer where there are fewer. Raises `IndexError` for a position that is none, `ValueError` for a count below 1.

    >>> three = Posteriors(means=np.array([[0.0], [2.0], [1.0]]), scales=np.ones((3, 1)))
    >>> positions, found = nearest(three, to=0, count=5)
    >>> positions.tolist(), found.tolist()
    ([2, 1], [0.125, 0.5])
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    apart = distances(posteriors, to)
    order = np.argsort(apart, kind="stable")
    chosen = order[order != to][:count]
    return chosen, apart[chosen]
