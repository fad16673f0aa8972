"""How likely trajectories are under a model, with z paid for.

The importance-weighted bound (Burda, Grosse, Salakhutdinov 2016, arXiv 1509.00519):

    log p(tau) >= E[ log 1/K sum_k p(tau | z_k) p(z_k) / q(z_k | tau) ],   z_1 .. z_K ~ q(z | tau)

It grows with K towards log p(tau); K = 1 is the evidence lower bound. A model without a latent has no z to sum
over, and the bound is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.stats import bootstrap
from torch import Tensor

from tvae.data.batches import TrajectoryBatch, batch_of, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.device import seeded
from tvae.model.elbo import policy_log_likelihood, state_log_likelihood
from tvae.model.inference import inferring
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import policy_windows, state_windows
from tvae.spaces import FloatArray

_RESAMPLED_AT_ONCE = 10_000_000
"""Numbers in memory at a time, for an interval."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Log-likelihoods of E trajectories, in nats each."""

    total: FloatArray
    """(E,) importance-weighted bound on log p(s_2, a_1, ..., s_T, a_T | s_1)."""
    actions: FloatArray
    """(E,) the same of the actions given the states: state and stop terms left out of p(tau | z)."""


def importance_weighted_bound(
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    *,
    num_samples: int = 64,
    seed: int = 0,
    batch_size: int = 64,
) -> Bound:
    """The bound of each trajectory with `num_samples` K, one sample after another so that memory stays small.

    The state decoder sees windows as in training, cut from the first step on, and the policy what a bot sees.
    """
    if num_samples < 1:
        raise ValueError(f"num_samples must be at least 1, got {num_samples}")
    total, actions = np.zeros(len(demonstrations)), np.zeros(len(demonstrations))
    with inferring(model), seeded(seed, model.device):
        for episodes in ordered_batches(demonstrations, batch_size):
            batch = batch_of(demonstrations, episodes, model.device)
            whole_weights, action_weights = _log_weights(model, batch, num_samples)
            for values, weights in ((total, whole_weights), (actions, action_weights)):
                mean = torch.logsumexp(weights.cpu().double(), dim=0) - math.log(num_samples)
                values[episodes] = mean.cpu().numpy()
    return Bound(total, actions)


def _log_weights(
    model: TrajectoryVAE, batch: TrajectoryBatch, num_samples: int
) -> tuple[Float[Tensor, "K B"], Float[Tensor, "K B"]]:
    """log p(tau | z) p(z) / q(z | tau) at each sample, of everything and of the actions alone."""
    posterior = model.posterior(batch)
    for_policy = policy_windows(model, batch)
    for_state = state_windows(model, batch)
    everything, actions = [], []
    for _ in range(num_samples):
        z = posterior.sample()
        policy = policy_log_likelihood(model, batch, z, for_policy)
        state, _, stop = state_log_likelihood(model, batch, z, for_state)
        cost = posterior.log_prob(z).sum(-1) - model.prior.log_prob(z)
        everything.append(policy + state + stop - cost)
        actions.append(policy - cost)
    return torch.stack(everything), torch.stack(actions)


@dataclass(frozen=True)
class Difference:
    """A mean of paired differences."""

    mean: float
    interval: tuple[float, float]
    """95 %."""


def paired_difference(
    first: FloatArray, second: FloatArray, groups: NDArray[Any] | None = None, *, seed: int = 0
) -> Difference:
    """Mean of `first - second` (E,) with a 95 % bootstrap interval (percentile, 9,999 resamples).

    With `groups` (E,), whole groups are resampled by their mean differences, since episodes of one group (a pair
    of players) are no independent evidence; the mean is then that of the group means.

    >>> paired_difference(np.array([2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0]))
    Difference(mean=1.0, interval=(1.0, 1.0))
    """
    values = np.asarray(first - second, dtype=np.float64)
    if groups is not None:
        _, member = np.unique(groups, return_inverse=True)
        values = np.bincount(member, weights=values) / np.bincount(member)
    return Difference(float(values.mean()), mean_interval(values, seed=seed))


def mean_interval(values: FloatArray, *, seed: int = 0) -> tuple[float, float]:
    """95 % bootstrap interval of a mean; of a single value, or of equal ones, that value twice.

    >>> mean_interval(np.array([3.0, 3.0]))
    (3.0, 3.0)
    """
    if len(values) < 2 or np.ptp(values) == 0:
        return (float(values.mean()), float(values.mean()))
    rng = np.random.default_rng(seed)
    batch = max(1, _RESAMPLED_AT_ONCE // len(values))
    found = bootstrap((values,), np.mean, method="percentile", batch=batch, rng=rng).confidence_interval
    return (float(found.low), float(found.high))
