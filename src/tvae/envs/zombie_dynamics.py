"""The world of the zombie attack: how agent and zombie move, and what is seen of it.

In each step: the agent sees distance and bearing of goal and zombie; if it attacks and the zombie lives and
is nearer than 1, the zombie dies; the agent moves by 0.5; a living zombie moves towards where its behaviour
wants to be, without overshooting. A dead zombie stays where it fell, and stays in sight: nothing in an
observation says that it is dead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces as gym
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from tvae.envs.batched import State
from tvae.envs.plane import bearing, direction, length
from tvae.spaces import FloatArray

GOAL: FloatArray = np.array([5.0, 5.0])
GOAL_RADIUS = 0.5
AGENT_STEP = 0.5
ZOMBIE_SPEED = 0.3
RANGE = 1.0
"""Below this distance an attack kills the zombie, and the zombie has caught the agent."""
FREE_RADIUS = 2.0
"""No zombie starts nearer to the agent."""
NUM_STEPS = 30

OBSERVATION = ("distance_to_goal", "bearing_of_goal", "distance_to_zombie", "bearing_of_zombie")
ACTION = ("attack", "heading")


@dataclass(frozen=True, eq=False)
class ZombieState(State):
    """Agent, zombie, and what happened so far."""

    agent: FloatArray
    """(N, 2)"""
    heading: FloatArray
    """(N,) of the agent's last move, radians."""
    zombie: FloatArray
    """(N, 2)"""
    zombie_start: FloatArray
    """(N, 2)"""
    alive: NDArray[np.bool_]
    """(N,) whether the zombie lives."""
    attacks: NDArray[np.int64]
    """(N,) number of attacks so far, hits or not."""
    closest_zombie: FloatArray
    """(N,) least distance to the living zombie so far, at the start and after whole steps."""
    closest_goal: FloatArray
    """(N,) least distance to the goal so far."""

    @property
    def goal_distance(self) -> FloatArray:
        return length(GOAL - self.agent)

    @property
    def zombie_distance(self) -> FloatArray:
        return length(self.zombie - self.agent)


Behaviour: TypeAlias = Callable[[ZombieState], FloatArray]
"""Where the zombie wants to be, (N, 2), once the agent has moved."""


def chases(state: ZombieState) -> FloatArray:
    """Straight to the agent."""
    return state.agent


def stops(state: ZombieState) -> FloatArray:
    """To the agent, until their distance is half of what it was at the start. There it stays."""
    arrived = state.closest_zombie <= length(state.zombie_start) / 2
    return np.where(arrived[:, None], state.zombie, state.agent)


def leads(state: ZombieState) -> FloatArray:
    """To a point ahead of the agent, on its present heading, by half of the distance between them."""
    return state.agent + state.zombie_distance[:, None] / 2 * direction(state.heading)


def zigzags(state: ZombieState) -> FloatArray:
    """To the agent, but 45 degrees to the left and to the right of it by turns, two steps each."""
    vector = state.agent - state.zombie
    side = np.where(state.time % 4 < 2, 1.0, -1.0)
    return state.zombie + length(vector)[:, None] * direction(bearing(vector) + side * np.pi / 4)


@dataclass(frozen=True)
class ZombieAttack:
    """Reach the goal at (5, 5) from (0, 0) within 30 steps; contact with the zombie does not end the episode.

    The zombie starts uniformly in [start_low, start_high]^2, at least 2 away from the agent.

    Raises `ValueError` for a negative speed, or a start region without room.
    """

    zombie_speed: float = ZOMBIE_SPEED
    """Distance in a step."""
    start_low: float = -2.5
    start_high: float = 5.0
    behaviour: Behaviour = chases

    def __post_init__(self) -> None:
        if not 0 <= self.zombie_speed < np.inf:
            raise ValueError(f"zombie_speed must be finite and not negative, got {self.zombie_speed}")
        if not -np.inf < self.start_low < self.start_high < np.inf:
            raise ValueError(
                "start_low must be less than start_high, and both finite, "
                f"got {self.start_low} and {self.start_high}"
            )
        if self._farthest <= FREE_RADIUS:
            raise ValueError(
                f"the start region needs a coordinate beyond +-{FREE_RADIUS:g}, where the zombie may start, "
                f"got start_low {self.start_low}, start_high {self.start_high}"
            )

    @property
    def _farthest(self) -> float:
        return max(abs(self.start_low), abs(self.start_high))

    @property
    def observation_space(self) -> gym.Box:
        num_steps = NUM_STEPS + 1  # one more than an episode has, against rounding
        goal = length(GOAL) + num_steps * AGENT_STEP
        zombie = np.sqrt(2) * self._farthest + num_steps * (AGENT_STEP + self.zombie_speed)
        return gym.Box(
            low=np.array([0.0, -np.pi, 0.0, -np.pi]),
            high=np.array([goal, np.pi, zombie, np.pi]),
            dtype=np.float64,
        )

    @property
    def action_space(self) -> gym.Dict:
        heading = gym.Box(-np.pi, np.pi, shape=(), dtype=np.float64)
        return gym.Dict({"attack": gym.MultiBinary(1), "heading": heading})

    @property
    def num_steps(self) -> int:
        return NUM_STEPS

    def start(self, num_copies: int, random: np.random.Generator) -> ZombieState:
        zombie = random.uniform(self.start_low, self.start_high, size=(num_copies, 2))
        while (near := length(zombie) < FREE_RADIUS).any():
            zombie[near] = random.uniform(self.start_low, self.start_high, size=(int(near.sum()), 2))
        return ZombieState(
            time=np.zeros(num_copies, dtype=np.int64),
            agent=np.zeros((num_copies, 2)),
            heading=np.zeros(num_copies),
            zombie=zombie,
            zombie_start=zombie,
            alive=np.ones(num_copies, dtype=np.bool_),
            attacks=np.zeros(num_copies, dtype=np.int64),
            closest_zombie=length(zombie),
            closest_goal=np.full(num_copies, length(GOAL)),
        )

    def step(self, state: ZombieState, actions: FloatArray) -> ZombieState:
        attack, heading = actions[:, 0] == 1, actions[:, 1]
        moved = replace(
            state,
            time=state.time + 1,
            agent=state.agent + AGENT_STEP * direction(heading),
            heading=heading,
            alive=state.alive & ~(attack & (state.zombie_distance < RANGE)),
            attacks=state.attacks + attack,
        )
        speed = np.where(moved.alive, self.zombie_speed, 0.0)
        after = replace(moved, zombie=_towards(moved.zombie, self.behaviour(moved), speed))
        near = np.where(after.alive, after.zombie_distance, np.inf)
        return replace(
            after,
            closest_zombie=np.minimum(state.closest_zombie, near),
            closest_goal=np.minimum(state.closest_goal, after.goal_distance),
        )

    def observe(self, state: ZombieState) -> FloatArray:
        goal, zombie = GOAL - state.agent, state.zombie - state.agent
        return np.stack((length(goal), bearing(goal), length(zombie), bearing(zombie)), axis=1)

    def reward(self, state: ZombieState) -> FloatArray:
        return self.terminated(state).astype(np.float64)

    def terminated(self, state: ZombieState) -> NDArray[np.bool_]:
        return state.goal_distance < GOAL_RADIUS

    def info(self, state: ZombieState) -> dict[str, NDArray[Any]]:
        return {
            "attacks": state.attacks,
            "zombie_dead": (~state.alive).astype(np.int64),
            "closest_zombie": state.closest_zombie,
            "closest_goal": state.closest_goal,
            "goal_reached": self.terminated(state).astype(np.int64),
        }

    def draw(self, axes: Axes, states: Sequence[ZombieState], copy: int) -> None:
        present = states[-1]
        zombie = present.zombie[copy]
        axes.add_patch(Circle((GOAL[0], GOAL[1]), GOAL_RADIUS, color="tab:green", alpha=0.4))
        if present.alive[copy]:
            axes.add_patch(Circle((zombie[0], zombie[1]), RANGE, fill=False, linestyle=":", color="tab:red"))
            axes.plot(*zombie, marker="o", color="tab:red")
        else:
            axes.plot(*zombie, marker="X", markersize=10, color="tab:gray")
        axes.plot(*np.array([state.zombie[copy] for state in states]).T, color="tab:red", alpha=0.5)
        axes.plot(*np.array([state.agent[copy] for state in states]).T, color="tab:blue")
        axes.plot(*present.agent[copy], marker="o", color="tab:blue")
        axes.set_xlim(min(0.0, self.start_low) - 1, max(GOAL[0], self.start_high) + 1)
        axes.set_ylim(min(0.0, self.start_low) - 1, max(GOAL[1], self.start_high) + 1)


def _towards(position: FloatArray, target: FloatArray, distance: FloatArray) -> FloatArray:
    """Positions (N, 2) after walking `distance` (N,) straight to their targets, and no further."""
    vector = target - position
    left = length(vector)
    share = np.minimum(distance, left) / np.where(left > 0, left, 1.0)
    return position + share[:, None] * vector
