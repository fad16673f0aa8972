"""The evidence lower bound, its terms kept apart, in nats per trajectory.

    ELBO(tau) = E_q[ sum_t log pi(a_t | s_1:t, z) + sum_t log p(s_t+1 | s_1:t, z) + sum_t log p(end_t | s_1:t, z) ]
                - beta KL(q(z | tau) || p(z))

For a model with a `horizon` h > 1 the bound is that of a composite likelihood (Lindsay 1988; Varin, Reid & Firth 2011),
which counts where things are h steps ahead too, sum_t log p(s_t+h | s_1:t, z). Where the next state nearly follows from
the present one, little of what z tells shows in it, and much in where one is going.

For a model with `dynamics` the state and stop terms are given a_1:t too, and for one without `encode_actions` the
posterior is q(z | s_1:T).

The first state belongs to the world, not to the style, and has no term. Densities are of standardised values (and
of angles in radians), so that they do not depend on the units of the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.distributions import Normal
from torch.nn.functional import binary_cross_entropy_with_logits

from tvae.data.batches import TrajectoryBatch
from tvae.distributions import RowDistribution
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import Windows


@dataclass(frozen=True, eq=False)
class Elbo:
    """The terms for each of B trajectories, in nats, and the latent at which they were estimated."""

    policy: Float[Tensor, " B"]
    """sum_t log pi(a_t | s_1:t, z), and log p(E | z) of the model's events (`tvae.model.events`)"""
    state: Float[Tensor, " B"]
    """sum_t log p(s_t+1 | s_1:t, z), over the next states that were recorded"""
    ahead: Float[Tensor, " B"]
    """sum_t log p(s_t+h | s_1:t, z), over those that were recorded; 0 for a horizon h = 1"""
    stop: Float[Tensor, " B"]
    """sum_t log p(end_t | s_1:t, z); 0 for a model without the stop term"""
    kl: Float[Tensor, " B"]
    """KL(q(z | tau) || p(z))"""
    posterior: Normal
    """q(z | tau), batch shape (B, Z)"""
    z: Float[Tensor, "B Z"]
    """The draw from it at which the terms were estimated"""

    def value(self, beta: float = 1.0, state_weight: float = 1.0) -> Float[Tensor, " B"]:
        """The bound, with the divergence weighted by `beta` and the state term by `state_weight`."""
        return self.policy + state_weight * self.state + self.ahead + self.stop - beta * self.kl


@dataclass(frozen=True, eq=False)
class Predicted:
    """The law that a decoder gives the rows in windows before they come, and the rows that came."""

    law: RowDistribution
    """Batch shape (R, W)"""
    values: Float[Tensor, "R W C"]
    """What came, as `tvae.data.normalizer` calls values"""
    counts: Bool[Tensor, "R W"]
    """Where a row has a term: once for each step that has one"""


@dataclass(frozen=True, eq=False)
class PredictedStates:
    """What the state decoder gives before it comes."""

    following: Predicted
    """s_t+1"""
    ends: Float[Tensor, "R W"]
    """log p(end_t | s_1:t, z) of what came; 0 for a model without the stop term"""
    ahead: Predicted | None
    """s_t+h; None for a horizon h = 1"""


def used_events(model: TrajectoryVAE, batch: TrajectoryBatch) -> Bool[Tensor, "B N"]:
    """E: which events occur in each trajectory."""
    return model.events.used(_recorded(batch))


def _recorded(batch: TrajectoryBatch) -> Float[Tensor, "B T A"]:
    return torch.where(batch.mask[..., None], batch.actions, torch.zeros_like(batch.actions))


def predicted_actions(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> Predicted:
    """pi(a_t | s_1:t, z) at `z`, given which events occur; in each window the decoder starts without memory."""
    at = (windows.trajectory[:, None], windows.steps)
    used, done = used_events(model, batch), model.events.done(_recorded(batch))
    inputs = model.policy_decoder_inputs(batch.observations[at], done[at])
    law = model.events.given(
        model.policy_decoder(inputs, z[windows.trajectory]), used[windows.trajectory][:, None]
    )
    return Predicted(law, model.action_normalizer.values(batch.actions[at]), windows.valid)


def predicted_states(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> PredictedStates:
    """What the state decoder says at `z`; in each window it starts without memory."""
    at = (windows.trajectory[:, None], windows.steps)
    values = model.observation_normalizer.values(batch.observations[at])
    states = model.observation_normalizer.features(values)
    actions = model.action_normalizer.values(batch.actions[at])
    foretold = model.state_decoder(
        model.state_decoder_inputs(states, actions), values, z[windows.trajectory]
    )
    following = model.observation_normalizer.values(batch.next_observations[at])
    ends = torch.zeros_like(foretold.log_odds)
    if model.stop:
        last = (windows.steps == batch.lengths[windows.trajectory, None] - 1).to(ends.dtype)
        ends = -binary_cross_entropy_with_logits(foretold.log_odds, last, reduction="none")
    return PredictedStates(
        Predicted(foretold.following, following, windows.valid & batch.next_known[at]),
        ends,
        None if foretold.ahead is None else _ahead(model, batch, foretold.ahead, windows),
    )


def _ahead(model: TrajectoryVAE, batch: TrajectoryBatch, law: RowDistribution, windows: Windows) -> Predicted:
    """The states that `law` foretells: s_t+h follows a_t+h-1."""
    steps = windows.steps + model.state_decoder.horizon - 1
    within = steps < batch.lengths[windows.trajectory, None]
    at = (windows.trajectory[:, None], steps.clamp_max(batch.actions.shape[1] - 1))
    rows = model.observation_normalizer.values(batch.next_observations[at])
    return Predicted(law, rows, windows.valid & within & batch.next_known[at])


def policy_log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> Float[Tensor, " B"]:
    """The policy term of each trajectory at `z`; in each window the decoder starts without memory."""
    events = model.events.log_prob(z, used_events(model, batch))
    return _log_likelihood(predicted_actions(model, batch, z, windows), windows, batch) + events


def state_log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> tuple[Float[Tensor, " B"], Float[Tensor, " B"], Float[Tensor, " B"]]:
    """The state, ahead and stop terms of each trajectory at `z`; in each window the decoder starts without memory."""
    states = predicted_states(model, batch, z, windows)
    following = _log_likelihood(states.following, windows, batch)
    ahead = torch.zeros_like(following) if states.ahead is None else _log_likelihood(states.ahead, windows, batch)
    return following, ahead, _total(states.ends, windows.valid, windows, batch)


def _log_likelihood(predicted: Predicted, windows: Windows, batch: TrajectoryBatch) -> Float[Tensor, " B"]:
    return _total(predicted.law.log_prob(predicted.values), predicted.counts, windows, batch)


def _total(terms: Tensor, where: Tensor, windows: Windows, batch: TrajectoryBatch) -> Float[Tensor, " B"]:
    """The sum over the windows of each trajectory."""
    rows = torch.where(where, terms, torch.zeros_like(terms)).sum(1)
    return torch.zeros_like(batch.lengths, dtype=rows.dtype).index_add(0, windows.trajectory, rows)


def log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> tuple[Float[Tensor, " B"], Float[Tensor, " B"], Float[Tensor, " B"]]:
    """Policy, state and stop terms of each trajectory at `z`, with both decoders in the same windows."""
    state, _, stop = state_log_likelihood(model, batch, z, windows)
    return policy_log_likelihood(model, batch, z, windows), state, stop


def elbo(model: TrajectoryVAE, batch: TrajectoryBatch, *, policy: Windows, state: Windows) -> Elbo:
    """One-sample estimate of the bound's terms; each decoder sees each of its windows on its own."""
    posterior = model.posterior(batch)
    z = posterior.rsample()
    return Elbo(
        policy_log_likelihood(model, batch, z, policy),
        *state_log_likelihood(model, batch, z, state),
        model.prior.kl(posterior, z),
        posterior,
        z,
    )
