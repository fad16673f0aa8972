"""Bots: the policy decoder acting on what an environment returns."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from tvae.generate.decoding import Choice, Fixed, LatentSource, Recurrence, sampled, tensor_of
from tvae.gymnasium_spaces import flatten, unflatten
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray


class LatentPolicy:
    """pi(a_t | s_1:t, z) in many episodes at once, z drawn afresh for each from `latents`.

    A `Policy` for `tvae.rollout.rollout`. `window` is the rolling window W; by default the one of the training.
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
        self.window = model.window if window is None else window

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes, each with a z of its own."""
        rng = np.random.default_rng(seed)
        self.z = self.latents.sample(num_episodes, rng)
        self._seeds = rng
        decoder = self.model.policy_decoder
        self._recurrence = Recurrence(decoder.trunk, tensor_of(self.model, self.z), self.window)

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """Actions (N, A) for the present observations (N, O)."""
        model = self.model
        values = model.observation_normalizer.values(tensor_of(model, observations))
        features = self._recurrence.step(model.observation_normalizer.features(values))
        with torch.random.fork_rng():
            torch.manual_seed(int(self._seeds.integers(2**62)))
            actions = self.choice(model.policy_decoder.law(features))
        return model.action_normalizer.raw(actions).double().cpu().numpy()


class Agent:
    """A bot for one episode at a time, in the environment's own observations and actions.

    >>> import gymnasium, numpy as np, tvae
    >>> from tvae.gymnasium_spaces import space_from_gymnasium
    >>> env = gymnasium.make("tvae/ZombieAttack-v0")
    >>> model = TrajectoryVAE(*(space_from_gymnasium(s) for s in (env.observation_space, env.action_space)))
    >>> agent = Agent(model, np.zeros(2), env.observation_space, env.action_space)
    >>> observation, _ = env.reset(seed=0)
    >>> env.action_space.contains(agent.act(observation))
    True
    """

    def __init__(
        self,
        model: TrajectoryVAE,
        z: NDArray[np.floating[Any]],
        observation_space: gymnasium.Space[Any],
        action_space: gymnasium.Space[Any],
        *,
        choice: Choice = sampled,
        window: int | None = None,
        seed: int = 0,
    ) -> None:
        self._policy = LatentPolicy(model, Fixed(np.asarray(z, dtype=np.float64)), choice=choice, window=window)
        self._observation_space = observation_space
        self._action_space = action_space
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Forget the past: a new episode begins."""
        self._policy.reset(1, self._seed)
        self._seed += 1

    def act(self, observation: Any) -> Any:
        """The action for this observation, a value that the action space contains."""
        rows = self._policy.act(flatten(self._observation_space, observation)[None])
        return unflatten(self._action_space, rows[0])
