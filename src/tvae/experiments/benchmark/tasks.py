"""The tasks: who demonstrates, which style an episode shows, what success is.

The paper's three are here, the two with real people in `tvae.experiments.benchmark.human`.

The style that an episode shows is a fact about what was done in it, and no model is asked:

| task       | an episode shows                             | it succeeds in a style                               |
|------------|----------------------------------------------|------------------------------------------------------|
| navigation | the goal that its last place is nearest to   | within 13 of the goal at the end                     |
| circle     | the circle nearest to its first 63 steps     | mean of abs(r - R) at most R / 10, 0.95 of the turn  |
| zombie     | `attack` if it attacked at all, else `avoid` | `tvae.envs.zombie.success`                           |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tvae.baselines.contract import Envs, World
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.envs import zombie
from tvae.envs.circle import (
    RADII,
    CircleExpert,
    CircleVectorEnv,
    angles_walked,
    circle_steps,
    radius_errors,
)
from tvae.envs.navigation import GOAL_BEARINGS, NavigationExpert, NavigationVectorEnv, jittered
from tvae.envs.plane import length
from tvae.experiments.arenas import column_per_episode
from tvae.experiments.benchmark.human import OVERCOOKED, PUSHT
from tvae.experiments.benchmark.task import Task
from tvae.experiments.reproduction.navigation import GOALS, REACHED
from tvae.experiments.reproduction.studies import STUDIES
from tvae.rollouts import Policy
from tvae.spaces import FloatArray, IntArray

_OFF = 0.1
_TURN = 0.95


def _of_the_paper(study: str, **facts: Any) -> Task:
    """A task whose demonstrations and configuration are those of the reproduction's study."""
    return Task(
        demonstrations=lambda data, seed: STUDIES[study].demonstrations(seed),
        test=lambda data, seed: STUDIES[study].test_demonstrations(),
        config=STUDIES[study].presets["default"],
        **facts,
    )


class _OwnGoals:
    """Heads for goals that it draws for itself, about the bearing of its style."""

    def __init__(self, towards: float) -> None:
        self.towards = towards

    def reset(self, num_episodes: int, seed: int) -> None:
        goals = jittered(np.full(num_episodes, self.towards), np.random.default_rng(seed))
        self._expert = NavigationExpert(goals)
        self._expert.reset(num_episodes, seed)

    def act(self, observations: FloatArray) -> FloatArray:
        return self._expert.act(observations)


def _navigation_lessons(label: str, count: int, seed: int) -> tuple[Envs, Policy]:
    goals = jittered(np.full(count, GOAL_BEARINGS[label]), np.random.default_rng(seed))
    return NavigationVectorEnv(count, goals=lambda num, random: goals), NavigationExpert(goals)


def _from_goals(episodes: Demonstrations) -> FloatArray:
    """(E, K) distance of each last place from where each goal lies before it is jittered."""
    last = episodes.observation_starts + episodes.lengths + episodes.final_observed - 1
    return length(episodes.observations[last, None, :2] - GOALS)


def _navigation_numbers(episodes: Demonstrations, label: str) -> dict[str, float]:
    return {"end_distance": float(_from_goals(episodes)[:, list(GOAL_BEARINGS).index(label)].mean())}


def _circle_lessons(label: str, count: int, seed: int) -> tuple[Envs, Policy]:
    return CircleVectorEnv(count, num_steps=circle_steps(RADII[label])), CircleExpert(RADII[label])


_SHORTEST = min(circle_steps(radius) for radius in RADII.values())


def _nearest_circle(episodes: Demonstrations) -> IntArray:
    radii = np.array(list(RADII.values()))
    centres = np.stack([np.zeros(len(radii)), radii], axis=1)
    off = [
        np.abs(length(episode.observations[1 : _SHORTEST + 1, None] - centres) - np.abs(radii)).mean(0)
        for episode in episodes
    ]
    nearest: IntArray = np.stack(off).argmin(1)
    return nearest


def _off_and_turn(episodes: Demonstrations, radius: float) -> tuple[FloatArray, FloatArray]:
    """(E,) |r - R| / |R|, and (E,) share of the turn, between 0 and 1."""
    radii = np.full(len(episodes), radius)
    turns = np.clip(angles_walked(episodes, radii) / (2 * np.pi), 0, 1)
    return radius_errors(episodes, radii) / abs(radius), turns


def _circle_success(episodes: Demonstrations) -> NDArray[np.bool_]:
    found = [_off_and_turn(episodes, radius) for radius in RADII.values()]
    return np.stack([(off <= _OFF) & (turns >= _TURN) for off, turns in found], axis=1)


def _circle_numbers(episodes: Demonstrations, label: str) -> dict[str, float]:
    off, turns = _off_and_turn(episodes, RADII[label])
    return {"radial_error": float(off.mean()), "turn_completed": float(turns.mean())}


def _once_around(episodes: Demonstrations, test: Demonstrations) -> Demonstrations:
    """Each episode up to where the demonstrator of the circle that it shows would have ended."""
    steps = np.array([circle_steps(radius) for radius in RADII.values()])[_nearest_circle(episodes)]

    def cut(episode: Trajectory, most: int) -> Trajectory:
        return Trajectory(episode.observations[: most + 1], episode.actions[:most])

    return Demonstrations.from_trajectories(
        (cut(episode, int(most)) for episode, most in zip(episodes, steps, strict=True)),
        episodes.observation_space,
        episodes.action_space,
    )


def _zombie_lessons(label: str, count: int, seed: int) -> tuple[Envs, Policy]:
    # Whoever acts, the attacker must know whether the zombie is dead: two observations tell.
    demonstrators: dict[str, Callable[[], Policy]] = {"attack": zombie.TwoStepAttacker, "avoid": zombie.AvoidExpert}
    return zombie.ZombieAttackVectorEnv(count), demonstrators[label]()


def _attacks(episodes: Demonstrations) -> FloatArray:
    return column_per_episode(episodes, "info.attacks", lambda values: values[-1])


def _zombie_success(episodes: Demonstrations) -> NDArray[np.bool_]:
    outcome = zombie.success(episodes)
    return np.stack([outcome["attack"], outcome["avoid"]], axis=1)


TASKS: Mapping[str, Task] = {
    "navigation": _of_the_paper(
        "navigation",
        env="tvae/Navigation-v0",
        labels=tuple(GOAL_BEARINGS),
        world=World(
            NavigationVectorEnv,
            {label: partial(_OwnGoals, towards) for label, towards in GOAL_BEARINGS.items()},
            _navigation_lessons,
        ),
        shown=lambda episodes: _from_goals(episodes).argmin(1),
        succeeded=lambda episodes: _from_goals(episodes) <= REACHED,
        numbers=_navigation_numbers,
    ),
    "circle": _of_the_paper(
        "circle",
        env="tvae/Circle-v0",
        labels=tuple(RADII),
        world=World(
            CircleVectorEnv,
            {label: partial(CircleExpert, radius) for label, radius in RADII.items()},
            _circle_lessons,
        ),
        shown=_nearest_circle,
        succeeded=_circle_success,
        numbers=_circle_numbers,
        as_demonstrated=_once_around,
    ),
    "zombie": _of_the_paper(
        "zombie",
        env="tvae/ZombieAttack-v0",
        labels=("attack", "avoid"),
        world=World(
            zombie.ZombieAttackVectorEnv,
            {"attack": zombie.AttackExpert, "avoid": zombie.AvoidExpert},
            _zombie_lessons,
        ),
        shown=lambda episodes: np.where(_attacks(episodes) > 0, 0, 1),
        succeeded=_zombie_success,
        numbers=lambda episodes, label: {"attacks_per_episode": float(_attacks(episodes).mean())},
    ),
    "pusht": PUSHT,
    "overcooked": OVERCOOKED,
}
PAPER = ("navigation", "circle", "zombie")
"""The paper's own."""
