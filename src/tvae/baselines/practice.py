"""Learning by acting: a policy that seeks a learnt reward in the environment, by PPO.

Source: Schulman et al., "Proximal policy optimization algorithms" (2017, arXiv 1707.06347), as Stable-Baselines3 has
it. The policy is pi(b_t | x_t, c): a Gaussian over what is added to a start b_0(x_t, c), a point of a Box
(`tvae.baselines.boxes`), where x_t is the present state with its last change (`tvae.baselines.moments`) and c the code
of the episode, or nothing. Nothing is seen of the environment's own reward. An episode that is cut off at its longest
counts as one that has ended.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from gymnasium import spaces as gym
from jaxtyping import Float
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor

from tvae.baselines.contract import Codes, Envs, Lesson
from tvae.baselines.descending import CPU
from tvae.baselines.moments import Moments, Sight
from tvae.device import seeded
from tvae.gymnasium_spaces import flatten, unflatten
from tvae.spaces import FloatArray


@runtime_checkable
class LearntReward(Protocol):
    """What a policy seeks, learnt while it seeks it."""

    def of(self, moments: Moments) -> Float[Tensor, " N"]:
        """The reward of each moment."""
        ...

    def improve(self, own: Moments, num_steps: int) -> None:
        """Learn from the policy's own moments of a round, in so many gradient steps."""
        ...


@runtime_checkable
class Start(Protocol):
    """Where in the Box a policy begins: it learns what to add."""

    def points(self, states: Float[Tensor, "N X"], codes: Float[Tensor, "N Z"]) -> FloatArray:
        """(N, B), or (1, B) for all alike."""
        ...


class Middle:
    """The middle of the Box: a typical action of the demonstrations.

    >>> Middle().points(torch.zeros(3, 4), torch.zeros(3, 0)).tolist()
    [[0.0]]
    """

    def points(self, states: Float[Tensor, "N X"], codes: Float[Tensor, "N Z"]) -> FloatArray:
        """(1, 1)"""
        return np.zeros((1, 1))


_MIDDLE = Middle()


@dataclass(frozen=True)
class Practice:
    """How long, and by which PPO.

    Raises `ValueError` where the moments of a round cannot be split into its batches evenly.

    >>> Practice(num_rounds=10, num_epochs=5, num_batches=16, reward_steps=32).gradient_steps
    1120
    """

    num_rounds: int = 300
    num_copies: int = 64
    """Of the environment."""
    num_steps: int = 128
    """Of each copy in a round."""
    num_epochs: int = 5
    """Passes of PPO over the moments of a round."""
    num_batches: int = 16
    """Gradient steps of a pass."""
    reward_steps: int = 32
    """Gradient steps of the reward in a round."""
    learning_rate: float = 1e-3
    """At first; it falls to nothing along a line."""
    discount: float = 0.9
    log_std: float = -1.0
    """Logarithm of the policy's standard deviation at first, in units of the demonstrations'; 0 where it chooses."""
    hidden_features: int = 64

    def __post_init__(self) -> None:
        if self.num_copies * self.num_steps % self.num_batches:
            raise ValueError(
                f"{self.num_copies} copies of {self.num_steps} steps cannot be split into {self.num_batches} batches"
            )

    @property
    def gradient_steps(self) -> int:
        """Of policy and reward together."""
        return self.num_rounds * (self.num_epochs * self.num_batches + self.reward_steps)

    def within(self, lesson: Lesson) -> Practice:
        """As many rounds as the lesson allows, or one of a single gradient step of policy and reward each."""
        allowed = lesson.limited(self.gradient_steps)
        rounds = self.num_rounds * allowed // self.gradient_steps
        if rounds:
            return replace(self, num_rounds=rounds)
        return replace(self, num_rounds=1, num_epochs=1, num_batches=1, reward_steps=1)

    def learn(
        self, lesson: Lesson, sight: Sight, codes: Codes, reward: LearntReward, start: Start = _MIDDLE
    ) -> ActorCriticPolicy:
        """The policy, after all rounds: act, improve the reward, improve the policy. Counts the lesson's steps."""
        envs = lesson.steps.of(lesson.world.envs(self.num_copies))
        ground = PracticeGround(envs, sight, codes, reward, lesson.seed, start)
        with _own_randomness(lesson.seed):
            learner = PPO(
                ActorCriticPolicy,
                ground,
                n_steps=self.num_steps,
                n_epochs=self.num_epochs,
                batch_size=self.num_copies * self.num_steps // self.num_batches,
                learning_rate=lambda left: self.learning_rate * left,
                gamma=self.discount,
                policy_kwargs={"net_arch": [self.hidden_features] * 2, "log_std_init": self.log_std},
                device=CPU,
            )
            learner.policy.log_std.data[sight.box.choices] = 0.0  # as often as in the demonstrations
            learner.set_logger(Logger(None, []))
            learner.learn(
                self.num_rounds * self.num_copies * self.num_steps, _Improving(ground, reward, self.reward_steps)
            )
        envs.close()
        return learner.policy


@contextmanager
def _own_randomness(seed: int) -> Iterator[None]:
    """As `seeded`, for NumPy's global generator too: Stable-Baselines3 shuffles with it."""
    before = np.random.get_state()  # noqa: NPY002 - Stable-Baselines3 draws from it
    np.random.seed(seed)  # noqa: NPY002 - Stable-Baselines3 draws from it
    try:
        with seeded(seed, CPU):
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002 - Stable-Baselines3 draws from it


class PracticeGround(VecEnv):
    """Copies of an environment as Stable-Baselines3 wants them, with a learnt reward and a code in each episode.

    Observations are [x_t; c], actions points of a Box. A copy whose episode has ended starts anew in the next step:
    before it, its observation is 0, and what is done there changes nothing and is rewarded with 0.
    """

    def __init__(
        self, envs: Envs, sight: Sight, codes: Codes, reward: LearntReward, seed: int, start: Start = _MIDDLE
    ) -> None:
        self._envs, self._sight, self._codes, self._reward, self._start = envs, sight, codes, reward, start
        self._random = np.random.default_rng(seed)
        self._infos: list[dict[str, Any]] = [{} for _ in range(envs.num_envs)]
        self._own: list[Moments] = []
        width = sight.num_state_features + codes.sample(1, np.random.default_rng(seed)).shape[1]
        observations = gym.Box(-np.inf, np.inf, shape=(width,), dtype=np.float32)
        super().__init__(envs.num_envs, observations, sight.box.space)

    def reset(self) -> NDArray[np.float32]:
        """First observations (N, X + Z)."""
        value, _ = self._envs.reset(seed=int(self._random.integers(2**31)))
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._code = self._fresh_codes(self.num_envs)
        features = self._features(value)
        return self._observed(features, features)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take these points (N, B) of the Box as actions."""
        self._points = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations (N, X + Z), rewards (N,), whether the episodes ended (N,), and nothing more about each."""
        points = self._points.astype(np.float64) + self._start.points(self._state, self._code)
        action = unflatten(self._envs.single_action_space, self._sight.box.raw(points))
        value, _, terminated, truncated, _ = self._envs.step(action)
        rows = flatten(self._envs.single_action_space, action)
        moments = Moments(self._state, self._sight.action(rows), self._code)
        restarted = self._ended
        rewards = np.where(restarted, 0.0, self._reward.of(moments).numpy()).astype(np.float32)
        self._own.append(moments.at(torch.from_numpy(~restarted)))
        self._ended = terminated | truncated
        features, new = self._features(value), torch.from_numpy(restarted)[:, None]
        if restarted.any():
            self._code = torch.where(new, self._fresh_codes(self.num_envs), self._code)
        observed = self._observed(features, torch.where(new, features, self._last))
        return observed, rewards, self._ended, self._infos

    def taken(self) -> Moments:
        """All moments since this was asked last, without restarts."""
        moments, self._own = Moments.joined(self._own), []
        return moments

    def _fresh_codes(self, count: int) -> Tensor:
        return torch.from_numpy(self._codes.sample(count, self._random)).float()

    def _features(self, value: Any) -> Tensor:
        rows = flatten(self._envs.single_observation_space, value)
        return self._sight.senses(torch.from_numpy(rows).float())

    def _observed(self, features: Tensor, last: Tensor) -> NDArray[np.float32]:
        self._state, self._last = self._sight.state(features, last), features
        seen = torch.cat([self._state, self._code], dim=-1)
        seen[torch.from_numpy(self._ended)] = 0
        observed: NDArray[np.float32] = seen.numpy()
        return observed

    def close(self) -> None:
        """Close the environment."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of each copy: how it is drawn, which is not at all; there is no other."""
        if attr_name != "render_mode":
            raise AttributeError(f"copies show nothing but render_mode, got {attr_name!r}")
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Copies cannot be changed."""
        raise AttributeError(f"copies cannot be changed, got {attr_name!r}")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Copies have no further methods."""
        raise AttributeError(f"copies have no further methods, got {method_name!r}")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """None is wrapped in one of Stable-Baselines3's."""
        return [False] * self.num_envs


class _Improving(BaseCallback):
    """Improves the reward after each round of acting, before PPO learns from that round."""

    def __init__(self, ground: PracticeGround, reward: LearntReward, num_steps: int) -> None:
        super().__init__()
        self._ground, self._reward, self._num_steps = ground, reward, num_steps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._reward.improve(self._ground.taken(), self._num_steps)


class PracticedPolicy:
    """A `Policy`: actions drawn from pi(b_t | x_t, c), and a code of its own in each episode."""

    def __init__(self, network: ActorCriticPolicy, sight: Sight, codes: Codes, start: Start = _MIDDLE) -> None:
        self.network, self.sight, self.codes, self.start = network, sight, codes, start

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self._random = np.random.default_rng(seed)
        self._code = torch.from_numpy(self.codes.sample(num_episodes, self._random)).float()
        self._last: Tensor | None = None

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) actions."""
        features = self.sight.senses(torch.from_numpy(observations).float())
        state = self.sight.state(features, features if self._last is None else self._last)
        self._last = features
        with seeded(int(self._random.integers(2**62)), CPU):
            points = self.network.get_distribution(torch.cat([state, self._code], dim=-1)).sample()
        return self.sight.box.raw(points.double().numpy() + self.start.points(state, self._code))
