"""Bots at work: test episodes of each style in an environment, z drawn afresh for each episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv

from tvae.data.demonstrations import Demonstrations
from tvae.generate.closed_loop import LatentPolicy
from tvae.generate.decoding import Choice, LatentSource
from tvae.model.tvae import TrajectoryVAE
from tvae.rollout import check_spaces, rollout

_MOST_COPIES = 1000
_COPIES_OF_SLOW_ENVIRONMENTS = 20


def vector_env(env: str, options: Mapping[str, Any], num_episodes: int) -> VectorEnv[Any, Any, Any]:
    """Copies of an environment: a thousand where it steps them together, else a handful one after another."""
    spec = gymnasium.spec(env)
    copies = _MOST_COPIES if spec.vector_entry_point is not None else _COPIES_OF_SLOW_ENVIRONMENTS
    return gymnasium.make_vec(env, num_envs=min(copies, num_episodes), **options)


def bot_episodes(
    model: TrajectoryVAE,
    latents: LatentSource,
    *,
    env: str,
    options: Mapping[str, Any],
    num_episodes: int,
    choice: Choice,
    window: int | None,
    seed: int,
    on_step: Callable[[int], None] = lambda finished: None,
) -> Demonstrations:
    """Episodes of the bot whose z comes from `latents`.

    Raises `SpaceMismatchError` if the environment has other signals than the model.
    """
    envs = vector_env(env, options, num_episodes)
    try:
        check_spaces(envs, model.observation_space, model.action_space)
        policy = LatentPolicy(model, latents, choice=choice, window=window)
        return rollout(envs, policy, num_episodes, seed=seed, on_step=on_step)
    finally:
        envs.close()
