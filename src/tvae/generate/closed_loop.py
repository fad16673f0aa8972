"""Bots: the policy decoder acting on what an environment returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from copy import copy
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from torch import Tensor

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.gymnasium_spaces import by_name, flatten, unflatten
from tvae.model.decoding import (
    Choice,
    EventMemory,
    Fixed,
    LatentSource,
    Recurrence,
    latent_of,
    narrower,
    sampled,
    tensor_of,
)
from tvae.model.tvae import TrajectoryVAE
from tvae.multiplayer import Parallel, check_players
from tvae.multiplayer import rollout as play_episodes
from tvae.rollouts import as_vector, check_spaces
from tvae.rollouts import rollout as run_episodes
from tvae.spaces import FloatArray


class LatentPolicy:
    """pi(a_t | s_1:t, z) in many episodes at once, z drawn afresh for each from `latents`.

    A `Policy` for `tvae.rollouts.rollout`. `window` is the rolling window W; by default the model's `bot_window`, and
    never a longer one than that of its training. What the window forgets are states: the bot still knows which events
    it has used.
    """

    def __init__(
        self,
        model: TrajectoryVAE,
        latents: LatentSource,
        *,
        choice: Choice = sampled,
        window: int | None = None,
    ) -> None:
        self.model = model
        self.latents = latents
        self.choice = choice
        self.window = model.bot_window if window is None else narrower(model.window, window)

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes, each with a z of its own."""
        rng = np.random.default_rng(seed)
        self.z = self.latents.sample(num_episodes, rng)
        self._seeds = rng
        latent = latent_of(self.model, self.z, num_episodes)
        self._recurrence = Recurrence(self.model.policy_decoder.trunk, latent, self.window)
        with torch.inference_mode(), self._next_seed():
            self._events = EventMemory(self.model, latent, self.choice)

    def _next_seed(self) -> AbstractContextManager[None]:
        return seeded(int(self._seeds.integers(2**62)), self.model.device)

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """Actions (N, A) for the present observations (N, O); `DataError` for one that the space does not allow."""
        model = self.model
        problem = model.observation_space.first_problem(observations)
        if problem is not None:
            raise DataError(f"episode {problem.row}, column observation.{problem.column}: {problem.message}")
        inputs = model.policy_decoder_inputs(tensor_of(model, observations), self._events.done)
        law = self._events.law(model.policy_decoder.law(self._recurrence.step(inputs)))
        with self._next_seed():
            actions = self.choose(law, observations)
        self._events.note(law, actions)
        return model.action_normalizer.raw(actions).cpu().double().numpy()

    def choose(self, law: RowDistribution, observations: FloatArray) -> Tensor:
        """Values of the next actions (N, A), given their law and the present observations (N, O)."""
        return self.choice(law)


class Agent:
    """A bot for one episode at a time.

    `z` is a latent (Z,), or anything that `sample`s one per episode, such as a style. With `env`, `act` takes and
    gives the environment's own observations and actions; without it, dictionaries by the names of the signals: takes
    numbers, and gives the number of a category and an array (1,) of any other signal (`tvae.gymnasium_spaces.by_name`).

    Raises `SpaceMismatchError` if the environment has other signals than the model, and `ValueError` for a `z` that is
    neither.

    >>> import gymnasium, tvae
    >>> from tvae.gymnasium_spaces import spaces_of
    >>> env = gymnasium.make("tvae/ZombieAttack-v0")
    >>> model = TrajectoryVAE(*spaces_of(as_vector(env)))
    >>> agent = Agent(model, np.zeros(2), env)
    >>> observation, _ = env.reset(seed=0)
    >>> env.action_space.contains(agent.act(observation))
    True
    """

    def __init__(
        self,
        model: TrajectoryVAE,
        z: Sequence[float] | FloatArray | Tensor | LatentSource,
        env: gymnasium.Env[Any, Any] | None = None,
        *,
        choice: Choice = sampled,
        window: int | None = None,
        seed: int = 0,
    ) -> None:
        latents = z if isinstance(z, LatentSource) else _fixed(z)
        self.policy = LatentPolicy(model, latents, choice=choice, window=window)
        if isinstance(env, VectorEnv):
            raise ValueError(
                "an agent acts in one environment, got a vector environment; leave `env` out and let `tvae.rollout` "
                "play in it"
            )
        if env is None:
            self._observation_space: gymnasium.Space[Any] = by_name(model.observation_space)
            self._action_space: gymnasium.Space[Any] = by_name(model.action_space)
        else:
            check_spaces(as_vector(env), model.observation_space, model.action_space)
            self._observation_space, self._action_space = env.observation_space, env.action_space
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget the past and draw a new z: a new episode begins."""
        self.policy.reset(1, self._seed)
        self._seed += 1

    def act(self, observation: Any) -> Any:
        """The action for this observation; `DataError` for what is none, such as those of a vector environment."""
        try:
            row = flatten(self._observation_space, observation)
        except (TypeError, LookupError) as error:
            there = f"{observation!r:.200}"
            raise DataError(f"an observation has to be of {self._observation_space}, got {there}") from error
        if row.ndim != 1:
            raise DataError(
                f"an agent plays one episode and takes one observation, got {row.shape[:-1]} of them; "
                "`tvae.rollout` plays many at once"
            )
        return unflatten(self._action_space, self.policy.act(row[None])[0])


def _fixed(z: object) -> Fixed:
    """The same z in every episode; `ValueError` for what is no numbers."""
    try:
        return Fixed(np.asarray(z, dtype=np.float64))
    except (ValueError, TypeError):
        raise ValueError(
            f"an agent needs a z, or something that samples one such as `playstyles.styles[0]`, got {type(z).__name__}"
        ) from None


def rollout(
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any], agent: Agent, episodes: int, *, seed: int = 0
) -> Demonstrations:
    """Episodes of an agent in an environment, as demonstrations; its z is drawn afresh for each.

    The episode that the agent is in the middle of is not disturbed.
    A vector environment runs as many episodes at once as it has copies.

    >>> import gymnasium, tvae
    >>> from tvae.gymnasium_spaces import spaces_of
    >>> envs = gymnasium.make_vec("tvae/ZombieAttack-v0", num_envs=10)
    >>> model = TrajectoryVAE(*spaces_of(envs))
    >>> len(rollout(envs, Agent(model, np.zeros(2)), episodes=20))
    20
    """
    envs = env if isinstance(env, VectorEnv) else as_vector(env)
    model = agent.policy.model
    check_spaces(envs, model.observation_space, model.action_space)
    return run_episodes(envs, copy(agent.policy), episodes, seed=seed)


def rollout_parallel(
    env: Parallel, agents: Mapping[str, Agent], episodes: int, *, seed: int = 0
) -> dict[str, Demonstrations]:
    """Episodes in a parallel environment of PettingZoo with an agent for each player; the demonstrations of each.

    Players may have different models and spaces. Each draws a z of its own, afresh in each episode; one agent may be
    given for several players. The attribute `episode` says which of one player's episodes belong to which of
    another's. The episodes that the agents are in the middle of are not disturbed.

    Raises `PlayersError` unless there is one agent for each of `env.possible_agents`, and `SpaceMismatchError`, with
    both sides, for one whose model has other signals than the player.

    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)))
    >>> rollout_parallel(gymnasium.make("CartPole-v1"), {"first": Agent(model, np.zeros(2))}, 1)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    tvae.multiplayer.PlayersError: several players need a parallel environment of PettingZoo, got ...
    """
    models = {player: agent.policy.model for player, agent in agents.items()}
    check_players(env, {player: (model.observation_space, model.action_space) for player, model in models.items()})
    return play_episodes(env, {player: copy(agent.policy) for player, agent in agents.items()}, episodes, seed=seed)
