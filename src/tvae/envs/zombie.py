"""Zombie attack: reach the goal, past a zombie that comes for you. Kill it, or avoid it: two styles.

Observation: distance and absolute bearing (radians) of the goal and of the zombie. Action: the `heading` of a
move of 0.5, and whether to `attack`. `zombie_dynamics` has the law of the world, `zombie_experts` the
demonstrators.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.envs.batched import TaskEnv, TaskVectorEnv
from tvae.envs.mixing import mixed
from tvae.envs.zombie_dynamics import (
    ACTION,
    OBSERVATION,
    RANGE,
    ZOMBIE_SPEED,
    Behaviour,
    ZombieAttack,
    ZombieState,
    chases,
    leads,
    stops,
    zigzags,
)
from tvae.envs.zombie_experts import (
    AttackExpert,
    AvoidExpert,
    StraightWalk,
    StraightWalkAttacking,
    TwoStepAttacker,
)
from tvae.rollouts import Policy, rollout

__all__ = [
    "BEHAVIOURS",
    "HELD_OUT_WORLDS",
    "AttackExpert",
    "AvoidExpert",
    "StraightWalk",
    "StraightWalkAttacking",
    "TwoStepAttacker",
    "ZombieAttackEnv",
    "ZombieAttackVectorEnv",
    "success",
    "zombie_demonstrations",
]

BEHAVIOURS: dict[str, Behaviour] = {"chases": chases, "stops": stops, "leads": leads, "zigzags": zigzags}
"""What a zombie may do, by the name that the environments take."""

HELD_OUT_WORLDS: dict[str, dict[str, Any]] = {
    "speed_0.2": {"zombie_speed": 0.2},
    "speed_0.4": {"zombie_speed": 0.4},
    "start_0_5": {"start_low": 0.0, "start_high": 5.0},
    "start_-5_5": {"start_low": -5.0, "start_high": 5.0},
    "stops": {"behaviour": "stops"},
    "leads": {"behaviour": "leads"},
    "zigzag": {"behaviour": "zigzags"},
}
"""Worlds that no demonstration was recorded in, as options of the environments."""

_SIGNAL_NAMES = {"observation": OBSERVATION, "action": ACTION}


def _task(zombie_speed: float, start_low: float, start_high: float, behaviour: str) -> ZombieAttack:
    if behaviour not in BEHAVIOURS:
        raise ValueError(f"behaviour must be one of {', '.join(BEHAVIOURS)}, got {behaviour!r}")
    return ZombieAttack(zombie_speed, start_low, start_high, BEHAVIOURS[behaviour])


class ZombieAttackEnv(TaskEnv[ZombieState]):
    """The task as a Gymnasium environment, `tvae/ZombieAttack-v0`.

    Reward 1 for reaching the goal, else 0. The info of every reset and step has `attacks` (how many so far),
    `zombie_dead` and `goal_reached` (0 or 1), `closest_zombie` (least distance so far to the living zombie)
    and `closest_goal`. Options: the zombie's speed (distance in a step), the square in which it starts, and
    its `behaviour` (`chases`, `stops`, `leads`, `zigzags`).

    Raises `ValueError` for an unknown behaviour, a negative speed, or a start region without room.

    >>> env = ZombieAttackEnv()
    >>> observation, info = env.reset(seed=0)
    >>> observation[:2].round(3).tolist(), info["attacks"]
    ([7.071, 0.785], 0)
    >>> _, _, terminated, truncated, info = env.step({"attack": np.array([1]), "heading": np.array(0.8)})
    >>> terminated, truncated, info["attacks"], info["zombie_dead"]
    (False, False, 1, 0)
    """

    metadata = {**TaskEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        *,
        zombie_speed: float = ZOMBIE_SPEED,
        start_low: float = -2.5,
        start_high: float = 5.0,
        behaviour: str = "chases",
        render_mode: str | None = None,
    ) -> None:
        super().__init__(_task(zombie_speed, start_low, start_high, behaviour), render_mode)


class ZombieAttackVectorEnv(TaskVectorEnv[ZombieState]):
    """Many copies of `ZombieAttackEnv` in one step, with the same options.

    >>> envs = ZombieAttackVectorEnv(num_envs=1000)
    >>> observations, info = envs.reset(seed=0)
    >>> observations.shape, bool((info["closest_zombie"] >= 2).all())
    ((1000, 4), True)
    """

    metadata = {**TaskVectorEnv.metadata, "signal_names": _SIGNAL_NAMES}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        num_envs: int = 1,
        *,
        zombie_speed: float = ZOMBIE_SPEED,
        start_low: float = -2.5,
        start_high: float = 5.0,
        behaviour: str = "chases",
        render_mode: str | None = None,
    ) -> None:
        super().__init__(_task(zombie_speed, start_low, start_high, behaviour), num_envs, render_mode)


def zombie_demonstrations(num_episodes: int = 2000, seed: int = 0) -> Demonstrations:
    """Episodes of both demonstrators, half of each, in random order.

    Attributes: `episode`, and `label`, `attack` or `avoid`. Step columns: `reward`, `terminated`, `truncated`
    and the environment's info, `info.attacks` and so on.

    Raises `ValueError` for fewer than 2 episodes.

    >>> demonstrations = zombie_demonstrations(num_episodes=4)
    >>> sorted(demonstrations.attribute("label").tolist())
    ['attack', 'attack', 'avoid', 'avoid']
    """
    styles = {"attack": partial(_episodes, AttackExpert()), "avoid": partial(_episodes, AvoidExpert())}
    return mixed(styles, num_episodes, seed)


def _episodes(expert: Policy, num_episodes: int, seed: int) -> Demonstrations:
    return rollout(ZombieAttackVectorEnv(min(num_episodes, 1000)), expert, num_episodes, seed=seed)


def success(demonstrations: Demonstrations) -> dict[str, NDArray[np.bool_]]:
    """(E,) whether each episode succeeded, as an attacker and as an avoider.

    `attack`: the zombie is dead and the goal reached. `avoid`: the goal is reached and a living zombie never
    was nearer than 1. Both are read off the last step's info, so episodes must come from these environments.

    >>> from tvae.rollouts import rollout
    >>> episodes = rollout(ZombieAttackVectorEnv(100), AttackExpert(), 100)
    >>> outcome = success(episodes)
    >>> float(outcome["attack"].mean()), float(outcome["avoid"].mean())
    (1.0, 0.0)
    """
    last = demonstrations.action_starts + demonstrations.lengths - 1
    steps = demonstrations.steps
    reached = steps["info.goal_reached"][last] == 1
    return {
        "attack": reached & (steps["info.zombie_dead"][last] == 1),
        "avoid": reached & (steps["info.closest_zombie"][last] >= RANGE),
    }
