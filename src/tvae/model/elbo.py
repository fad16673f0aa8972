"""The evidence lower bound, its terms kept apart, in nats per trajectory.

    ELBO(tau) = E_q[ sum_t log pi(a_t | s_1:t, z) + sum_t log p(s_t+1 | s_1:t, z) + sum_t log p(end_t | s_1:t, z) ]
                - beta KL(q(z | tau) || p(z))

For a model with `dynamics` the state and stop terms are given a_1:t too, and for one without `encode_actions` the
posterior is q(z | s_1:T).

The first state belongs to the world, not to the style, and has no term. Densities are of standardised values (and
of angles in radians), so that they do not depend on the units of the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from tvae.data.batches import TrajectoryBatch
from tvae.model.tvae import TrajectoryVAE


@dataclass(frozen=True, eq=False)
class Elbo:
    """The terms for each of B trajectories, in nats."""

    policy: Float[Tensor, " B"]
    """sum_t log pi(a_t | s_1:t, z)"""
    state: Float[Tensor, " B"]
    """sum_t log p(s_t+1 | s_1:t, z), over the next states that were recorded"""
    stop: Float[Tensor, " B"]
    """sum_t log p(end_t | s_1:t, z); 0 for a model without the stop term"""
    kl: Float[Tensor, " B"]
    """KL(q(z | tau) || p(z))"""

    def value(self, beta: float = 1.0, state_weight: float = 1.0) -> Float[Tensor, " B"]:
        """The bound, with the divergence weighted by `beta` and the state term by `state_weight`."""
        return self.policy + state_weight * self.state + self.stop - beta * self.kl


@dataclass(frozen=True, eq=False)
class Windows:
    """Where to cut trajectories into windows: rows (trajectory, first step) and the steps that each holds."""

    trajectory: Int[Tensor, " R"]
    steps: Int[Tensor, "R W"]
    valid: Bool[Tensor, "R W"]


def cut(lengths: Int[Tensor, " B"], window: int, offset: int) -> Windows:
    """Windows of `window` steps that together hold every step once; the first one ends after `offset` steps.

    >>> windows = cut(torch.tensor([5, 2]), window=3, offset=1)
    >>> [steps[valid].tolist() for steps, valid in zip(windows.steps, windows.valid)]
    [[0], [1, 2, 3], [4], [0], [1]]
    """
    longest = int(lengths.max())
    starts = torch.tensor([0, *range(offset or window, longest, window)], device=lengths.device)
    ends = torch.cat([starts[1:], starts.new_tensor([longest])])
    steps = starts[:, None] + torch.arange(min(window, longest), device=lengths.device)
    valid = (steps < ends[:, None]) & (steps < lengths[:, None, None])
    trajectory, piece = torch.nonzero(valid[..., 0], as_tuple=True)
    return Windows(trajectory, steps[piece].clamp_max(longest - 1), valid[trajectory, piece])


def whole(batch: TrajectoryBatch) -> Windows:
    """Every trajectory as one window."""
    steps = torch.arange(batch.actions.shape[1], device=batch.lengths.device)
    everyone = torch.arange(len(batch), device=batch.lengths.device)
    return Windows(everyone, steps.expand(len(batch), -1), batch.mask)


def log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> tuple[Float[Tensor, " B"], Float[Tensor, " B"], Float[Tensor, " B"]]:
    """Policy, state and stop terms of each trajectory at `z`; in each window the decoders start without memory."""
    at = (windows.trajectory[:, None], windows.steps)
    values = model.observation_normalizer.values(batch.observations[at])
    states = model.observation_normalizer.features(values)
    latent = z[windows.trajectory]
    actions = model.action_normalizer.values(batch.actions[at])
    policy = model.policy_decoder(states, latent).log_prob(actions)
    following, log_odds = model.state_decoder(model.state_decoder_inputs(states, actions), values, latent)
    state = following.log_prob(model.observation_normalizer.values(batch.next_observations[at]))
    last = (windows.steps == batch.lengths[windows.trajectory, None] - 1).to(log_odds.dtype)
    stop = -binary_cross_entropy_with_logits(log_odds, last, reduction="none")

    def total(terms: Tensor, where: Tensor) -> Tensor:
        rows = torch.where(where, terms, torch.zeros_like(terms)).sum(1)
        return torch.zeros_like(batch.lengths, dtype=rows.dtype).index_add(0, windows.trajectory, rows)

    return (
        total(policy, windows.valid),
        total(state, windows.valid & batch.next_known[at]),
        total(stop, windows.valid) if model.stop else torch.zeros_like(batch.lengths, dtype=z.dtype),
    )


def elbo(model: TrajectoryVAE, batch: TrajectoryBatch, windows: Windows) -> Elbo:
    """One-sample estimate of the bound's terms; the decoders see each of `windows` on its own."""
    posterior = model.posterior(batch)
    z = posterior.rsample()
    policy, state, stop = log_likelihood(model, batch, z, windows)
    return Elbo(policy, state, stop, model.prior.kl(posterior, z))
