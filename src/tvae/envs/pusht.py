"""PushT: push a T-shaped block onto its goal with a disc that follows the mouse, and recorded people doing it.

The simulator is the package `gym-pusht` (Apache-2.0), the demonstrations are those of Chi et al. 2023, "Diffusion
Policy" (arXiv 2303.04137). The dynamics here are the simulator's own; its coverage is computed faster.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces as gym
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError, Trajectory
from tvae.gymnasium_spaces import space_from_gymnasium, wrap
from tvae.spaces import FloatArray

try:
    import shapely
    from gym_pusht.envs.pusht import PushTEnv as Simulator
except ImportError as error:
    raise ImportError(f"PushT needs its simulator: pip install 'tvae[pusht]' ({error})") from error

SIZE = 512.0
"""Width and height of the table, in pixels."""
SUCCESS_COVERAGE = 0.95
_APART = (50.0, 50.0, 256.0, 256.0, 0.0)
"""A state in which disc and block do not touch: `gym-pusht` ends a reset with a step of physics."""
_NAMES = {
    "observation": ("agent_x", "agent_y", "block_x", "block_y", "block_angle"),
    "action": ("target_x", "target_y"),
}


class PushTEnv(gymnasium.Env[FloatArray, FloatArray]):
    """A game until the block covers 95 % of its goal; registered with at most 300 steps of 0.1 s.

    Observation: the disc's position, the block's position (pixels, y down) and its angle in [-pi, pi]. Action: the
    point that the disc is drawn to. Reward: coverage / 0.95, at most 1, as in `gym-pusht`. Info: `coverage`, the
    share of the goal's area that the block covers, `best_coverage` of the episode so far, and `is_success`,
    whether it exceeded 0.95.

    >>> env = PushTEnv()
    >>> observation, info = env.reset(options={"state": [222.0, 97.0, 256.0, 256.0, 0.6]})
    >>> observation.round(2).tolist(), round(info["coverage"], 2)
    ([222.0, 97.0, 256.0, 256.0, 0.6], 0.7)
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "signal_names": _NAMES,
    }

    def __init__(self, *, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.observation_space = gym.Box(
            np.array([0, 0, 0, 0, -np.pi]), np.array([SIZE, SIZE, SIZE, SIZE, np.pi]), dtype=np.float64
        )
        self.action_space = gym.Box(0.0, SIZE, (2,), dtype=np.float64)
        self._simulator = Simulator(obs_type="state")
        self._simulator.reset()
        shapes = [shapely.Polygon(shape.get_vertices()) for shape in self._simulator.block.shapes]
        self._outline = np.array(shapely.union_all(shapes).exterior.coords)
        self._goal = self._block_at(*self._simulator.goal_pose)
        self._started = False
        self._best = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """A random start as in `gym-pusht`, or exactly `options["state"]`, a row of observations, at rest."""
        super().reset(seed=seed)
        state = (options or {}).get("state")
        if state is None:
            self._simulator.reset(seed=seed)
        else:
            self._place(np.asarray(state, dtype=np.float64), seed)
        self._started, self._best = True, 0.0
        return self._observation(), self._info()

    def _place(self, state: FloatArray, seed: int | None) -> None:
        """Disc and block exactly at `state`, at rest and not yet touching."""
        if state.shape != (5,) or not np.isfinite(state).all():
            raise ValueError(f"state needs 5 finite numbers ({', '.join(_NAMES['observation'])}), got {state}")
        x, y, block_x, block_y, angle = state.tolist()
        simulator = self._simulator
        simulator.reset(seed=seed, options={"reset_to_state": _APART})
        simulator.agent.position = x, y
        simulator.block.angle = angle  # first, because turning moves the block about its centre of mass
        simulator.block.position = block_x, block_y

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """The disc is drawn to `action` for 0.1 s."""
        if not self._started:
            raise ResetNeeded("an environment must be reset before its first step")
        simulator = self._simulator
        agent, k_p, k_v, dt = simulator.agent, simulator.k_p, simulator.k_v, simulator.dt
        target_x, target_y = float(action[0]), float(action[1])
        if not math.isfinite(target_x + target_y):
            raise ValueError(f"an action needs finite numbers, got {action}")
        for _ in range(int(1 / (dt * simulator.control_hz))):
            (x, y), (v_x, v_y) = agent.position, agent.velocity
            pull_x, pull_y = k_p * (target_x - x) - k_v * v_x, k_p * (target_y - y) - k_v * v_y
            agent.velocity = v_x + pull_x * dt, v_y + pull_y * dt
            simulator.space.step(dt)
        info = self._info()
        reward = min(info["coverage"] / SUCCESS_COVERAGE, 1.0)
        return self._observation(), reward, info["is_success"], False, info

    def _observation(self) -> FloatArray:
        agent, block = self._simulator.agent.position, self._simulator.block
        return np.array([*agent, *block.position, math.remainder(block.angle, 2 * math.pi)])

    def _info(self) -> dict[str, Any]:
        block = self._simulator.block
        x, y = block.position
        both = shapely.intersection(self._goal, self._block_at(x, y, block.angle))
        coverage = float(both.area / self._goal.area)
        self._best = max(self._best, coverage)
        return {"coverage": coverage, "best_coverage": self._best, "is_success": coverage > SUCCESS_COVERAGE}

    def _block_at(self, x: float, y: float, angle: float) -> Any:
        """The block's outline on the table."""
        cos, sin = np.cos(angle), np.sin(angle)
        return shapely.polygons(self._outline @ np.array([[cos, sin], [-sin, cos]]) + (x, y))

    def render(self) -> NDArray[np.uint8]:
        """The table as an RGB picture, 680 pixels wide."""
        picture: NDArray[np.uint8] = self._simulator.render()
        return picture


def pusht_demonstrations(path: Path) -> Demonstrations:
    """The recorded demonstrations of real people: state and action before each of its steps.

    A recorded state is the one that its action was chosen in, so T actions have T observations: where the last
    action led was not recorded. From the recorded start the environment repeats 182 of the 206 demonstrations to
    0.001 pixels; of the others, 22 start in contact, with forces that were not recorded, and differ by up to a
    pixel (one by 9). Attribute: `episode`.

    Raises `DataError` where arrays are missing or do not fit together.
    """
    with np.load(path, allow_pickle=False) as file:
        missing = {"state", "action", "episode_ends"} - set(file.files)
        if missing:
            raise DataError(
                f"{path} needs the arrays state, action, episode_ends; {', '.join(sorted(missing))} missing"
            )
        states, actions = file["state"].astype(np.float64), file["action"].astype(np.float64)
        ends = file["episode_ends"].tolist()
    if not len(states) == len(actions) == ends[-1]:
        raise DataError(
            f"{path} needs as many states and actions as the last episode's end {ends[-1]}, "
            f"got {len(states)} and {len(actions)}"
        )
    states[:, 4] = wrap(states[:, 4])
    env = PushTEnv()
    return Demonstrations.from_trajectories(
        (
            Trajectory(states[start:end], actions[start:end], attributes={"episode": episode})
            for episode, (start, end) in enumerate(pairwise([0, *ends]))
        ),
        space_from_gymnasium(env.observation_space, _NAMES["observation"]),
        space_from_gymnasium(env.action_space, _NAMES["action"]),
    )


class Replay(NamedTuple):
    """What came of recorded actions, played again from the recorded start."""

    deviation: float
    """Largest difference, in pixels, between the disc's and block's positions and the recorded ones."""
    best_coverage: float
    final_coverage: float


def replay(demonstration: Trajectory, env: PushTEnv) -> Replay:
    """Play a demonstration's actions again, open loop, on beyond a success.

    >>> still = np.array([[222.0, 97.0, 256.0, 256.0, 0.6]])
    >>> outcome = replay(Trajectory(still, actions=still[:, :2]), PushTEnv())
    >>> round(outcome.deviation, 6), round(outcome.best_coverage, 2)
    (0.0, 0.7)
    """
    observation, info = env.reset(options={"state": demonstration.observations[0]})
    deviation = 0.0
    for recorded, action in zip(demonstration.observations, demonstration.actions, strict=False):
        deviation = max(deviation, float(np.abs(observation - recorded)[:4].max()))
        observation, _, _, _, info = env.step(action)
    return Replay(deviation, info["best_coverage"], info["coverage"])
