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
from jaxtyping import Bool, Float, Int
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
    """The law that a decoder gives rows before they come, and the rows that came, at each valid step of windows."""

    law: RowDistribution
    """Batch shape (N,)"""
    values: Float[Tensor, "N C"]
    """What came, as `tvae.data.normalizer` calls values"""
    known: Bool[Tensor, " N"]
    """Whether it was recorded; where not, there is no term"""


@dataclass(frozen=True, eq=False)
class PredictedStates:
    """What the state decoder gives before it comes, at each valid step of windows."""

    following: Predicted
    """s_t+1"""
    ends: Float[Tensor, " N"]
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
    at, counted = (windows.trajectory[:, None], windows.steps), windows.counted
    used, done = used_events(model, batch), model.events.done(_recorded(batch))
    inputs = model.policy_decoder_inputs(batch.observations[at], done[at])
    law = model.policy_decoder(inputs, z[windows.trajectory], windows.places)
    values = model.action_normalizer.values(batch.actions[counted])
    everything = torch.ones_like(counted[0], dtype=torch.bool)
    return Predicted(model.events.given(law, used[counted[0]]), values, everything)


def predicted_states(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> PredictedStates:
    """What the state decoder says at `z`; in each window it starts without memory."""
    at, counted = (windows.trajectory[:, None], windows.steps), windows.counted
    values = model.observation_normalizer.values(batch.observations[at])
    states = model.observation_normalizer.features(values)
    actions = model.action_normalizer.values(batch.actions[at])
    foretold = model.state_decoder(
        model.state_decoder_inputs(states, actions), values, z[windows.trajectory], windows.places
    )
    following = model.observation_normalizer.values(batch.next_observations[counted])
    ends = torch.zeros_like(foretold.log_odds)
    if model.stop:
        trajectory, step = counted
        last = (step == batch.lengths[trajectory] - 1).to(ends.dtype)
        ends = -binary_cross_entropy_with_logits(foretold.log_odds, last, reduction="none")
    return PredictedStates(
        Predicted(foretold.following, following, batch.next_known[counted]),
        ends,
        None if foretold.ahead is None else _ahead(model, batch, foretold.ahead, *counted),
    )


def _ahead(
    model: TrajectoryVAE,
    batch: TrajectoryBatch,
    law: RowDistribution,
    trajectory: Int[Tensor, " N"],
    step: Int[Tensor, " N"],
) -> Predicted:
    """The states that `law` foretells: s_t+h follows a_t+h-1."""
    step = step + model.state_decoder.horizon - 1
    within = step < batch.lengths[trajectory]
    at = (trajectory, step.clamp_max(batch.actions.shape[1] - 1))
    rows = model.observation_normalizer.values(batch.next_observations[at])
    return Predicted(law, rows, within & batch.next_known[at])


def policy_log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> Float[Tensor, " B"]:
    """The policy term of each trajectory at `z`; in each window the decoder starts without memory."""
    actions, events = policy_terms(model, batch, z, windows)
    return actions + events


def policy_terms(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> tuple[Float[Tensor, " B"], Float[Tensor, " B"]]:
    """Its two parts: sum_t log pi(a_t | s_1:t, z) over the steps that count in `windows`, and log p(E | z)."""
    actions = _log_likelihood(predicted_actions(model, batch, z, windows), windows, batch)
    return actions, model.events.log_prob(z, used_events(model, batch))


def state_log_likelihood(
    model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"], windows: Windows
) -> tuple[Float[Tensor, " B"], Float[Tensor, " B"], Float[Tensor, " B"]]:
    """The state, ahead and stop terms of each trajectory at `z`; in each window the decoder starts without memory."""
    states = predicted_states(model, batch, z, windows)
    following = _log_likelihood(states.following, windows, batch)
    ahead = torch.zeros_like(following) if states.ahead is None else _log_likelihood(states.ahead, windows, batch)
    return following, ahead, _total(states.ends, windows, batch)


def _log_likelihood(predicted: Predicted, windows: Windows, batch: TrajectoryBatch) -> Float[Tensor, " B"]:
    terms = predicted.law.log_prob(predicted.values)
    return _total(torch.where(predicted.known, terms, torch.zeros_like(terms)), windows, batch)


def _total(terms: Float[Tensor, " N"], windows: Windows, batch: TrajectoryBatch) -> Float[Tensor, " B"]:
    """The sum over the valid steps of each trajectory."""
    trajectory, _ = windows.counted
    return torch.zeros_like(batch.lengths, dtype=terms.dtype).index_add(0, trajectory, terms)


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
