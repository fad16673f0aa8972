"""Circle: walk once around a circle, of which nothing is shown. Three styles: two radii, two senses.

Observation: the position (x, y), at first (0, 0). Action: `turn`, the angle relative to the present heading,
radians, of a move of length 1; the first heading is 0. The heading is in no observation, so a policy without
memory cannot walk in circles. The circles touch the x axis at the start: their centre is (0, R), R signed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

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

RADII = {"left_10": 10.0, "right_10": -10.0, "left_20": 20.0}
"""Signed radius by label: positive is counterclockwise, a left turn."""
TURN_NOISE = 0.05
"""Standard deviation of the expert's turn, radians."""


def circle_steps(radius: float) -> int:
    """The number of steps around a circle of this signed radius, ceil(2 pi abs(R)).

    >>> [circle_steps(radius) for radius in RADII.values()]
    [63, 63, 126]
    """
    return math.ceil(2 * math.pi * abs(radius))


LONGEST = max(circle_steps(radius) for radius in RADII.values())


@dataclass(frozen=True, eq=False)
class CircleState(State):
    """Where the walker is, and where it faces."""

    position: FloatArray
    """(N, 2)"""
    heading: FloatArray
    """(N,) radians in [-pi, pi)"""


@dataclass(frozen=True)
class Circle:
    """The task: moves of length 1 from (0, 0), each turned from the last.

    Raises `ValueError` for fewer than 1 step.
    """

    num_steps: int = LONGEST

    def __post_init__(self) -> None:
        if self.num_steps < 1:
            raise ValueError(f"num_steps must be at least 1, got {self.num_steps}")

    @property
    def observation_space(self) -> gym.Box:
        far = self.num_steps + 1.0  # one step more than an episode has, against rounding
        return gym.Box(-far, far, shape=(2,), dtype=np.float64)

    @property
    def action_space(self) -> gym.Box:
        return gym.Box(-np.pi, np.pi, shape=(), dtype=np.float64)

    def start(self, num_copies: int, random: np.random.Generator) -> CircleState:
        return CircleState(
            time=np.zeros(num_copies, dtype=np.int64),
            position=np.zeros((num_copies, 2)),
            heading=np.zeros(num_copies),
        )

    def step(self, state: CircleState, actions: FloatArray) -> CircleState:
        heading = wrap(state.heading + actions[:, 0])
        position = state.position + direction(heading)
        return replace(state, time=state.time + 1, position=position, heading=heading)

    def observe(self, state: CircleState) -> FloatArray:
        return state.position

    def reward(self, state: CircleState) -> FloatArray:
        return np.zeros(len(state.time))

    def terminated(self, state: CircleState) -> NDArray[np.bool_]:
        return np.zeros(len(state.time), dtype=np.bool_)

    def info(self, state: CircleState) -> dict[str, NDArray[Any]]:
        return {"heading": state.heading}

    def draw(self, axes: Axes, states: Sequence[CircleState], copy: int) -> None:
        axes.plot(*np.array([state.position[copy] for state in states]).T, color="tab:blue")
        axes.plot(*states[-1].position[copy], marker="o", color="tab:blue")
        axes.set_xlim(-35, 35)
        axes.set_ylim(-25, 45)


_SIGNAL_NAMES = {"observation": ("x", "y"), "action": ("turn",)}


class CircleEnv(TaskEnv[CircleState]):
    """The task as a Gymnasium environment, `tvae/Circle-v0`, truncated after `num_steps`.

    There is nothing to be won: the reward is always 0. The info of every reset and step has the hidden
    `heading`.

    >>> env = CircleEnv()
    >>> _ = env.reset(seed=0)
    >>> for _ in range(2):
    ...     position, *_, info = env.step(np.array(np.pi / 2))
    >>> position.round(3).tolist(), info["heading"] == -np.pi
    ([-1.0, 1.0], True)
    """

    metadata = {**TaskEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, *, num_steps: int = LONGEST, render_mode: str | None = None) -> None:
        super().__init__(Circle(num_steps), render_mode)


class CircleVectorEnv(TaskVectorEnv[CircleState]):
    """Many copies of `CircleEnv` in one step.

    >>> CircleVectorEnv(num_envs=1000).reset(seed=0)[0].shape
    (1000, 2)
    """

    metadata = {**TaskVectorEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self, num_envs: int = 1, *, num_steps: int = LONGEST, render_mode: str | None = None
    ) -> None:
        super().__init__(Circle(num_steps), num_envs, render_mode)


class CircleExpert:
    """Walks around the circle of a signed radius R, correcting itself.

    With s the sign of R and r its distance to the centre, it wants the heading of the tangent, plus
    s asin(1 / 2 abs(R)) for half a step ahead, plus s clip(0.1 (r - abs(R)), -0.5, 0.5) back to the circle. Its turn
    is the difference to its present heading, where it went in the last step, plus noise of 0.05 radians.

    >>> expert = CircleExpert(radius=10.0)
    >>> expert.reset(num_episodes=3, seed=0)
    >>> expert.act(np.zeros((3, 2))).shape
    (3, 1)
    """

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def reset(self, num_episodes: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._last = np.tile([-1.0, 0.0], (num_episodes, 1))  # as if it had come along the x axis

    def act(self, observations: FloatArray) -> FloatArray:
        side, size = math.copysign(1.0, self.radius), abs(self.radius)
        outwards = observations - [0.0, self.radius]
        tangent = bearing(outwards) + side * np.pi / 2
        back = np.clip(0.1 * (length(outwards) - size), -0.5, 0.5)
        wanted = tangent + side * (np.arcsin(1 / (2 * size)) + back)
        heading = bearing(observations - self._last)
        self._last = observations
        turn = wanted - heading + self._random.normal(0.0, TURN_NOISE, len(heading))
        return wrap(turn)[:, None]


class ConstantTurn:
    """Turns by the angle of its circle, 2 asin(1 / 2R), with the expert's noise, and looks at nothing.

    It drifts off the circle, which shows that the task needs feedback.
    """

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def reset(self, num_episodes: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._turn = np.arcsin(1 / (2 * self.radius))  # half of it before the first step

    def act(self, observations: FloatArray) -> FloatArray:
        turn = self._turn + self._random.normal(0.0, TURN_NOISE, (len(observations), 1))
        self._turn = 2 * np.arcsin(1 / (2 * self.radius))
        return wrap(turn)


def circle_demonstrations(num_episodes: int = 1500, seed: int = 0) -> Demonstrations:
    """Episodes of the expert, equally many of each of the three circles, once around, in random order.

    Attributes: `episode`, and `label` (`left_10`, `right_10` or `left_20`: `RADII`). Step columns: `reward`,
    `terminated`, `truncated` and `info.heading`.

    Raises `ValueError` for fewer than 3 episodes.

    >>> demonstrations = circle_demonstrations(num_episodes=3)
    >>> sorted(demonstrations.lengths.tolist())
    [63, 63, 126]
    """
    return mixed({label: partial(_episodes, radius) for label, radius in RADII.items()}, num_episodes, seed)


def _episodes(radius: float, num_episodes: int, seed: int) -> Demonstrations:
    envs = CircleVectorEnv(num_episodes, num_steps=circle_steps(radius))
    return rollout(envs, CircleExpert(radius), num_episodes, seed=seed)


def radius_errors(demonstrations: Demonstrations, radii: FloatArray) -> FloatArray:
    """(E,) mean of abs(r - abs(R)) over the first ceil(2 pi abs(R)) steps, r the distance to the centre.

    `radii` (E,) are signed.

    >>> demonstrations = circle_demonstrations(num_episodes=3)
    >>> radii = np.array([RADII[label] for label in demonstrations.attribute("label")])
    >>> bool((radius_errors(demonstrations, radii) < 0.5).all())
    True
    """
    return np.array(
        [
            np.abs(length(path[1:] - [0.0, radius]) - abs(radius)).mean()
            for path, radius in _paths(demonstrations, radii)
        ]
    )


def angles_walked(demonstrations: Demonstrations, radii: FloatArray) -> FloatArray:
    """(E,) radians walked around the centre in the first ceil(2 pi abs(R)) steps; 2 pi is once around.

    `radii` (E,) are signed; walking in the other sense counts as negative.
    """
    angles = (
        np.sign(radius) * wrap(np.diff(bearing(path - [0.0, radius]))).sum()
        for path, radius in _paths(demonstrations, radii)
    )
    return np.array(list(angles))


def _paths(demonstrations: Demonstrations, radii: FloatArray) -> list[tuple[FloatArray, float]]:
    """The start and the first ceil(2 pi abs(R)) positions of each episode, and its R."""
    return [
        (episode.observations[: circle_steps(radius) + 1], radius)
        for episode, radius in zip(demonstrations, radii.tolist(), strict=True)
    ]
