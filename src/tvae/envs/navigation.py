"""Navigation: 100 steps towards one of three goals that nobody sees. Three styles.

Observation: the position (x, y), at first (0, 0). Action: the angle of a move of length 1, radians. The goals
lie at distance 100, bearings 150, 90 and 30 degrees, each jittered per episode by N(0, 5^2 I). The goal is in
no observation: where an episode was heading is a fact about the whole of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces as gym
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.envs.batched import State, TaskEnv, TaskVectorEnv
from tvae.envs.mixing import mixed
from tvae.envs.plane import bearing, direction, length
from tvae.gymnasium_spaces import wrap
from tvae.rollouts import rollout
from tvae.spaces import FloatArray

NUM_STEPS = 100
GOAL_DISTANCE = 100.0
GOAL_BEARINGS = {"left": np.radians(150), "ahead": np.radians(90), "right": np.radians(30)}
"""Radians, by the label of the style that heads there."""
GOAL_JITTER = 5.0
"""Standard deviation of a goal's place, in x and in y."""
NOISE = 0.3
"""Standard deviation of the expert's heading about the bearing of its goal, radians."""
NOISE_CORRELATION = 0.8
"""Correlation of that noise from one step to the next."""

Goals: TypeAlias = Callable[[int, np.random.Generator], FloatArray]
"""Draws goals, (N, 2), for N episodes."""


def jittered(bearings: FloatArray, random: np.random.Generator) -> FloatArray:
    """(N, 2) goals about these bearings (N,)."""
    return GOAL_DISTANCE * direction(bearings) + random.normal(0.0, GOAL_JITTER, (len(bearings), 2))


def any_goal(num_episodes: int, random: np.random.Generator) -> FloatArray:
    """(N, 2) goals of all three kinds, equally likely."""
    return jittered(random.choice(list(GOAL_BEARINGS.values()), num_episodes), random)


@dataclass(frozen=True, eq=False)
class NavigationState(State):
    """Where the walker is, and what its goal is."""

    position: FloatArray
    """(N, 2)"""
    goal: FloatArray
    """(N, 2)"""

    @property
    def goal_distance(self) -> FloatArray:
        return length(self.goal - self.position)


@dataclass(frozen=True)
class Navigation:
    """The task: 100 moves of length 1 from (0, 0)."""

    goals: Goals = any_goal

    @property
    def observation_space(self) -> gym.Box:
        far = NUM_STEPS + 1.0  # one step more than an episode has, against rounding
        return gym.Box(-far, far, shape=(2,), dtype=np.float64)

    @property
    def action_space(self) -> gym.Box:
        return gym.Box(-np.pi, np.pi, shape=(), dtype=np.float64)

    @property
    def num_steps(self) -> int:
        return NUM_STEPS

    def start(self, num_copies: int, random: np.random.Generator) -> NavigationState:
        return NavigationState(
            time=np.zeros(num_copies, dtype=np.int64),
            position=np.zeros((num_copies, 2)),
            goal=self.goals(num_copies, random),
        )

    def step(self, state: NavigationState, actions: FloatArray) -> NavigationState:
        return replace(state, time=state.time + 1, position=state.position + direction(actions[:, 0]))

    def observe(self, state: NavigationState) -> FloatArray:
        return state.position

    def reward(self, state: NavigationState) -> FloatArray:
        return np.where(state.time == NUM_STEPS, -state.goal_distance, 0.0)

    def terminated(self, state: NavigationState) -> NDArray[np.bool_]:
        return np.zeros(len(state.time), dtype=np.bool_)

    def info(self, state: NavigationState) -> dict[str, NDArray[Any]]:
        return {
            "goal_x": state.goal[:, 0],
            "goal_y": state.goal[:, 1],
            "goal_distance": state.goal_distance,
        }

    def draw(self, axes: Axes, states: Sequence[NavigationState], copy: int) -> None:
        axes.plot(*states[-1].goal[copy], marker="*", markersize=16, color="tab:green")
        axes.plot(*np.array([state.position[copy] for state in states]).T, color="tab:blue")
        axes.plot(*states[-1].position[copy], marker="o", color="tab:blue")
        axes.set_xlim(-120, 120)
        axes.set_ylim(-100, 140)


_SIGNAL_NAMES = {"observation": ("x", "y"), "action": ("heading",)}


class NavigationEnv(TaskEnv[NavigationState]):
    """The task as a Gymnasium environment, `tvae/Navigation-v0`.

    The reward of the last step, the 100th, is minus the distance to the goal; the others have 0. The info of
    every reset and step has `goal_x`, `goal_y` and `goal_distance`. The option `goals` draws the goals.

    >>> env = NavigationEnv()
    >>> env.reset(seed=0)[0].tolist()
    [0.0, 0.0]
    >>> env.step(np.array(0.0))[0].tolist()
    [1.0, 0.0]
    """

    metadata = {**TaskEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, *, goals: Goals = any_goal, render_mode: str | None = None) -> None:
        super().__init__(Navigation(goals), render_mode)


class NavigationVectorEnv(TaskVectorEnv[NavigationState]):
    """Many copies of `NavigationEnv` in one step.

    >>> envs = NavigationVectorEnv(num_envs=1000)
    >>> _, info = envs.reset(seed=0)
    >>> info["goal_x"].shape
    (1000,)
    """

    metadata = {**TaskVectorEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, num_envs: int = 1, *, goals: Goals = any_goal, render_mode: str | None = None) -> None:
        super().__init__(Navigation(goals), num_envs, render_mode)


class NavigationExpert:
    """Heads for a goal of its own in each episode: h_t = bearing of the goal + n_t.

    n_t = 0.8 n_{t-1} + e_t is a stationary AR(1) noise of standard deviation 0.3 radians.

    >>> expert = NavigationExpert(goals=np.array([[0.0, 100.0], [-100.0, 0.0]]))
    >>> expert.reset(num_episodes=2, seed=0)
    >>> expert.act(np.zeros((2, 2))).shape
    (2, 1)
    """

    def __init__(self, goals: FloatArray) -> None:
        """`goals` has shape (N, 2), one for each of the N episodes."""
        self.goals = goals

    def reset(self, num_episodes: int, seed: int) -> None:
        if num_episodes != len(self.goals):
            raise ValueError(f"{num_episodes} episodes need as many goals, got {len(self.goals)}")
        self._random = np.random.default_rng(seed)
        self._noise = self._random.normal(0.0, NOISE, num_episodes)

    def act(self, observations: FloatArray) -> FloatArray:
        heading = bearing(self.goals - observations) + self._noise
        fresh = self._random.normal(0.0, NOISE * np.sqrt(1 - NOISE_CORRELATION**2), len(self._noise))
        self._noise = NOISE_CORRELATION * self._noise + fresh
        return wrap(heading)[:, None]


def navigation_demonstrations(num_episodes: int = 1500, seed: int = 0) -> Demonstrations:
    """Episodes of the expert, equally many to each of the three goals, in random order.

    Attributes: `episode`, `label` (`left`, `ahead` or `right`), and the goal, `goal_x` and `goal_y`. Step
    columns: `reward`, `terminated`, `truncated` and the environment's info, `info.goal_distance` and so on.

    Raises `ValueError` for fewer than 3 episodes.

    >>> demonstrations = navigation_demonstrations(num_episodes=3)
    >>> sorted(demonstrations.attribute("label").tolist()), demonstrations.lengths.tolist()
    (['ahead', 'left', 'right'], [100, 100, 100])
    """
    styles = {label: partial(_episodes, towards) for label, towards in GOAL_BEARINGS.items()}
    return mixed(styles, num_episodes, seed)


def _episodes(towards: float, num_episodes: int, seed: int) -> Demonstrations:
    goals = jittered(np.full(num_episodes, towards), np.random.default_rng(seed))
    envs = NavigationVectorEnv(num_episodes, goals=lambda num, random: goals)
    episodes = rollout(envs, NavigationExpert(goals), num_episodes, seed=seed)
    return episodes.with_attributes({"goal_x": goals[:, 0], "goal_y": goals[:, 1]})
