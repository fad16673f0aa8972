"""Thousands of copies of a small world in one step, or a single copy, from the same dynamics.

A `Task` is the law of a world, p(state_1) and state_{t+1} = f(state_t, action_t), written as pure functions
on N copies at once. `TaskVectorEnv` and `TaskEnv` make Gymnasium environments of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tvae.envs.drawing import Frame, Window, picture
from tvae.gymnasium_spaces import flatten
from tvae.spaces import FloatArray, IntArray

FRAMES_PER_SECOND = 10


@dataclass(frozen=True, eq=False)
class State:
    """The state of N copies: arrays with one row a copy."""

    time: IntArray
    """(N,) number of actions taken."""


S = TypeVar("S", bound=State)


@runtime_checkable
class Task(Protocol[S]):
    """The law of a world, for N independent copies at once.

    A first state ends no episode and has reward 0, so that a restarted copy needs no special treatment.
    """

    @property
    def observation_space(self) -> gymnasium.Space[Any]: ...
    @property
    def action_space(self) -> gymnasium.Space[Any]: ...
    @property
    def num_steps(self) -> int:
        """The longest episode; it is truncated there."""
        ...

    def start(self, num_copies: int, random: np.random.Generator) -> S:
        """First states."""
        ...

    def step(self, state: S, actions: FloatArray) -> S:
        """The states after actions (N, A), one column per signal of the action space."""
        ...

    def observe(self, state: S) -> FloatArray:
        """(N, O) what is seen of the states."""
        ...

    def reward(self, state: S) -> FloatArray:
        """(N,) reward of arriving in the states."""
        ...

    def terminated(self, state: S) -> NDArray[np.bool_]:
        """(N,) whether the episode ends in the states."""
        ...

    def info(self, state: S) -> dict[str, NDArray[Any]]:
        """Facts by name, (N,) each."""
        ...

    def draw(self, axes: Axes, states: Sequence[S], copy: int) -> None:
        """Draw one copy: the last of `states`, and the way there from the first."""
        ...


Step = tuple[FloatArray, FloatArray, NDArray[np.bool_], NDArray[np.bool_], dict[str, NDArray[Any]]]


def _outcome(task: Task[S], state: S) -> Step:
    """What Gymnasium returns for a step, for all copies: observation, reward, terminated, truncated, info."""
    terminated = task.terminated(state)
    truncated = ~terminated & (state.time >= task.num_steps)
    return task.observe(state), task.reward(state), terminated, truncated, task.info(state)


def _rows(space: gymnasium.Space[Any], actions: Any) -> FloatArray:
    rows = flatten(space, actions)
    if not np.isfinite(rows).all():
        raise ValueError(f"actions need finite numbers, got {actions}")
    return rows


def _with_copies(state: S, copies: NDArray[np.bool_], fresh: S) -> S:
    """`state`, in which the `copies` (N,) are those of `fresh`."""
    columns = {}
    for field in fields(state):
        values = getattr(state, field.name).copy()
        values[copies] = getattr(fresh, field.name)
        columns[field.name] = values
    return replace(state, **columns)


class _Past(Generic[S]):
    """The present states and, where pictures are wanted, those of the whole episode so far."""

    def __init__(self, task: Task[S], render_mode: str | None) -> None:
        self._task = task
        self._states: deque[S] = deque(maxlen=1 if render_mode is None else task.num_steps + 1)

    @property
    def present(self) -> S:
        if not self._states:
            raise ResetNeeded("an environment must be reset before its first step")
        return self._states[-1]

    def append(self, state: S) -> None:
        self._states.append(state)

    def draw(self, axes: Axes, copy: int) -> None:
        length = int(self.present.time[copy]) + 1
        self._task.draw(axes, list(self._states)[-length:], copy)


class TaskEnv(gymnasium.Env[FloatArray, Any], Generic[S]):
    """One copy of a task as a Gymnasium environment."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["human", "rgb_array"],
        "render_fps": FRAMES_PER_SECOND,
    }

    def __init__(self, task: Task[S], render_mode: str | None) -> None:
        self.task = task
        self.observation_space = task.observation_space
        self.action_space = task.action_space
        self.render_mode = render_mode
        self._past = _Past(task, render_mode)
        self._window = Window(FRAMES_PER_SECOND)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        super().reset(seed=seed)
        observation, _, _, _, info = self._enter(self.task.start(1, self.np_random))
        return observation, info

    def step(self, action: Any) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        return self._enter(self.task.step(self._past.present, _rows(self.action_space, action)[None]))

    def _enter(self, state: S) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        self._past.append(state)
        if self.render_mode == "human":
            self.render()
        observation, reward, terminated, truncated, info = _outcome(self.task, state)
        facts = {name: values[0].item() for name, values in info.items()}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), facts

    def render(self) -> Frame | None:
        """A picture (height, width, 3) in the mode `rgb_array`; in `human` it goes to a window instead."""
        if self.render_mode == "rgb_array":
            return picture(lambda axes: self._past.draw(axes, 0))
        if self.render_mode == "human":
            self._window.show(lambda axes: self._past.draw(axes, 0))
        return None

    def close(self) -> None:
        self._window.close()


class TaskVectorEnv(VectorEnv[FloatArray, Any, NDArray[Any]], Generic[S]):
    """Many copies of a task in one step. A copy whose episode ended restarts in the next step (`NEXT_STEP`).

    All copies draw from the one generator `np_random`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": FRAMES_PER_SECOND,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(self, task: Task[S], num_envs: int, render_mode: str | None) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        self.task = task
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._past = _Past(task, render_mode)
        self._ended = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        super().reset(seed=seed)
        observations, _, _, _, info = self._enter(self.task.start(self.num_envs, self.np_random))
        return observations, info

    def step(self, actions: Any) -> Step:
        state = self.task.step(self._past.present, _rows(self.single_action_space, actions))
        if self._ended.any():
            fresh = self.task.start(int(self._ended.sum()), self.np_random)
            state = _with_copies(state, self._ended, fresh)
        return self._enter(state)

    def _enter(self, state: S) -> Step:
        self._past.append(state)
        observations, rewards, terminated, truncated, info = _outcome(self.task, state)
        self._ended = terminated | truncated
        everywhere = {f"_{name}": np.ones(self.num_envs, dtype=np.bool_) for name in info}
        return observations, rewards, terminated, truncated, info | everywhere

    def render(self) -> tuple[Frame, ...] | None:
        """A picture (height, width, 3) of each copy in the mode `rgb_array`, else None."""
        if self.render_mode != "rgb_array":
            return None
        return tuple(picture(partial(self._past.draw, copy=copy)) for copy in range(self.num_envs))
