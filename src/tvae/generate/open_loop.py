"""Imagined trajectories: the state decoder feeds on its own states, the policy decoder acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError, Trajectory
from tvae.device import seeded
from tvae.gymnasium_spaces import wrap
from tvae.model.decoding import Choice, latent_of, sampled, tensor_of
from tvae.model.imagination import Imagination
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

    Raises `DataError` for a start that the space does not allow.

    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)), stop=False)
    >>> len(imagine(model, np.zeros((3, 1)), np.zeros((3, 2)), num_steps=5)[0])
    5
    """
    if num_steps < 1:
        raise ValueError(f"num_steps must be at least 1, got {num_steps}")
    normalizer, starts = model.observation_normalizer, np.asarray(starts, dtype=np.float64)
    if starts.ndim != 2 or starts.shape[1] != normalizer.space.num_columns:
        raise DataError(f"starts need the shape (episodes, {normalizer.space.num_columns}), got {starts.shape}")
    problem = normalizer.space.first_problem(starts)
    if problem is not None:
        raise DataError(f"start {problem.row}, column observation.{problem.column}: {problem.message}")
    latent = latent_of(model, z, len(starts))
    values = normalizer.values(tensor_of(model, starts))
    observations, actions = [starts], []
    lengths = np.full(len(starts), num_steps, dtype=np.int64)
    with seeded(seed, model.device):
        imagination = Imagination(model, latent, choice, window=window)
        for step in range(1, num_steps + 1):
            imagined = imagination.step(values)
            values = imagined.following
            actions.append(_rows(model.action_normalizer.raw(imagined.actions)))
            observations.append(_rows(normalizer.raw(values)))
            lengths = np.minimum(lengths, np.where(imagined.ends.cpu().numpy(), step, num_steps))
            if (lengths <= step).all():
                break
    actions_, observations_ = np.stack(actions, 1), np.stack(observations, 1)
    actions_[..., model.action_space.angular] = wrap(actions_[..., model.action_space.angular])

    def episodes() -> Iterator[Trajectory]:
        for index, length in enumerate(lengths):
            yield Trajectory(observations_[index, : length + 1], actions_[index, :length])

    return Demonstrations.from_trajectories(episodes(), model.observation_space, model.action_space)


def _rows(values: torch.Tensor) -> FloatArray:
    return values.cpu().double().numpy()
