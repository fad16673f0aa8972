"""Imagined trajectories: the state decoder feeds on its own states, the policy decoder acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch.distributions import Bernoulli

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.device import seeded
from tvae.distributions import Columns, Joint
from tvae.generate.decoding import Choice, EventMemory, Recurrence, latent_of, narrower, sampled, tensor_of
from tvae.gymnasium_spaces import wrap
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray


@torch.inference_mode()
def imagine(
    model: TrajectoryVAE,
    starts: FloatArray,
    z: FloatArray,
    *,
    num_steps: int,
    choice: Choice = sampled,
    window: int | None = None,
    seed: int = 0,
) -> Demonstrations:
    """Trajectories from the first observations `starts` (N, O) and `z` (N, Z), without an environment.

    Row i of the result holds the states that the state decoder imagines and the actions that the policy decoder
    takes on them; for a model with `dynamics` each action is taken into account in the next state. Where the model
    has a stop term an episode ends by itself, at most after `num_steps`.

    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)), stop=False)
    >>> len(imagine(model, np.zeros((3, 1)), np.zeros((3, 2)), num_steps=5)[0])
    5
    """
    if num_steps < 1:
        raise ValueError(f"num_steps must be at least 1, got {num_steps}")
    normalizer, states, policy = model.observation_normalizer, model.state_decoder, model.policy_decoder
    latent = latent_of(model, z, len(starts))
    state_memory = Recurrence(states.trunk, latent, narrower(model.window, window))
    policy_memory = Recurrence(
        policy.trunk, latent, model.bot_window if window is None else narrower(model.window, window)
    )
    values = normalizer.values(tensor_of(model, starts))
    observations, actions = [np.asarray(starts, dtype=np.float64)], []
    lengths = np.full(len(starts), num_steps, dtype=np.int64)
    angular = model.observation_space.angular
    with seeded(seed, model.device):
        events = EventMemory(model, latent, choice)
        for step in range(1, num_steps + 1):
            features = normalizer.features(values)
            inputs = model.policy_decoder_inputs(normalizer.raw(values), events.done)
            law = events.law(policy.law(policy_memory.step(inputs)))
            action = choice(law)
            events.note(law, action)
            actions.append(_rows(model.action_normalizer.raw(action)))
            remembered = state_memory.step(model.state_decoder_inputs(features, action))
            values = choice(states.head(remembered, values))
            values[:, angular] = torch.remainder(values[:, angular] + torch.pi, 2 * torch.pi) - torch.pi
            if not values.isfinite().all():
                raise ValueError(f"imagined states grow beyond all numbers at step {step}; imagine fewer steps")
            observations.append(_rows(normalizer.raw(values)))
            if model.stop:
                ends = _rows(choice(_stop_law(states.stop(remembered))))[:, 0] > 0
                lengths = np.minimum(lengths, np.where(ends, step, num_steps))
                if (lengths <= step).all():
                    break
    actions_, observations_ = np.stack(actions, 1), np.stack(observations, 1)
    actions_[..., model.action_space.angular] = wrap(actions_[..., model.action_space.angular])

    def episodes() -> Iterator[Trajectory]:
        for index, length in enumerate(lengths):
            yield Trajectory(observations_[index, : length + 1], actions_[index, :length])

    return Demonstrations.from_trajectories(episodes(), model.observation_space, model.action_space)


def _rows(values: torch.Tensor) -> FloatArray:
    return values.double().cpu().numpy()


def _stop_law(log_odds: torch.Tensor) -> Joint:
    column = torch.zeros(1, dtype=torch.int64, device=log_odds.device)
    return Joint(1, (Columns(column, Bernoulli(logits=log_odds, validate_args=False)),))
