"""Who walks in the zombie world: the demonstrators of both styles, and simple walkers to compare with.

Each is a `Policy`: observations are rows (distance_to_goal, bearing_of_goal, distance_to_zombie,
bearing_of_zombie), actions are rows (attack, heading).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tvae.envs.plane import direction, length
from tvae.envs.zombie_dynamics import AGENT_STEP, RANGE, ZOMBIE_SPEED
from tvae.gymnasium_spaces import wrap
from tvae.spaces import FloatArray

HEADING_NOISE = 0.05
"""Standard deviation of a demonstrator's heading, radians."""
SAFE_DISTANCE = 1.25

_UNMOVED = 1e-6


def _actions(attack: NDArray[np.bool_], heading: FloatArray) -> FloatArray:
    return np.stack((attack.astype(np.float64), wrap(heading)), axis=1)


class AttackExpert:
    """Walks to the zombie, attacks once when it is in range, then walks to the goal.

    >>> expert = AttackExpert()
    >>> expert.reset(num_episodes=1, seed=0)
    >>> far, near = np.array([[7.0, 0.8, 1.2, 2.0]]), np.array([[6.9, 0.8, 0.6, 2.0]])
    >>> [int(expert.act(observation)[0, 0]) for observation in (far, near, near)]
    [0, 1, 0]
    """

    def reset(self, num_episodes: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._attacked = np.zeros(num_episodes, dtype=np.bool_)

    def act(self, observations: FloatArray) -> FloatArray:
        _, to_goal, zombie_distance, to_zombie = observations.T
        attack = (zombie_distance < RANGE) & ~self._attacked
        self._attacked |= attack
        heading = np.where(self._attacked, to_goal, to_zombie)
        return _actions(attack, heading + self._random.normal(0.0, HEADING_NOISE, len(heading)))


class AvoidExpert:
    """Walks to the goal around the zombie, and never attacks.

    Its heading is that of the goal turned by 0, +-5, +-10, ... degrees: the first whose predicted distance to
    the zombie, after the zombie's own step of 0.3, is at least 1.25. Of equal turns the side that the episode
    prefers, drawn at random, comes first. Where no turn will do, it takes the one with the largest predicted
    distance.

    >>> expert = AvoidExpert()
    >>> expert.reset(num_episodes=2, seed=0)
    >>> clear, blocked = [7.0, 0.8, 3.0, 2.0], [7.0, 0.8, 1.6, 0.8]
    >>> np.abs(expert.act(np.array([clear, blocked]))[:, 1] - 0.8) > 0.3
    array([False,  True])
    """

    def reset(self, num_episodes: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._side = self._random.choice((-1.0, 1.0), num_episodes)

    def act(self, observations: FloatArray) -> FloatArray:
        _, to_goal, zombie_distance, to_zombie = observations.T
        headings = to_goal[:, None] + self._side[:, None] * _TURNS
        zombie = zombie_distance[:, None] * direction(to_zombie)
        distances = length(zombie[:, None] - AGENT_STEP * direction(headings))
        predicted = np.maximum(distances - ZOMBIE_SPEED, 0.0)
        safe = predicted >= SAFE_DISTANCE
        best = np.where(safe.any(axis=1), safe.argmax(axis=1), predicted.argmax(axis=1))
        heading = headings[np.arange(len(best)), best] + self._random.normal(0.0, HEADING_NOISE, len(best))
        return _actions(np.zeros(len(best), dtype=np.bool_), heading)


_TURNS: FloatArray = np.radians([0, *(side * turn for turn in range(5, 180, 5) for side in (1, -1)), 180])
"""(72,) the turns that an `AvoidExpert` considers, in its order, its preferred side positive."""


class StraightWalk:
    """Walks straight to the goal and never attacks."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Nothing is remembered, and nothing is drawn."""

    def act(self, observations: FloatArray) -> FloatArray:
        return _actions(np.zeros(len(observations), dtype=np.bool_), observations[:, 1])


class StraightWalkAttacking:
    """Walks straight to the goal and attacks whenever the zombie, dead or not, is in range."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Nothing is remembered, and nothing is drawn."""

    def act(self, observations: FloatArray) -> FloatArray:
        return _actions(observations[:, 2] < RANGE, observations[:, 1])


class TwoStepAttacker:
    """Attacks as the expert does, from its last two observations alone (a window W = 2).

    The goal tells where the agent stands, so each observation tells where the zombie stands. A zombie that
    did not move from one to the next is dead; then the way is free to the goal. So two observations hold all
    that an attacker must know of the past, as long as a living zombie never stands still.
    """

    def reset(self, num_episodes: int, seed: int) -> None:
        self._last_zombie = np.full((num_episodes, 2), np.inf)

    def act(self, observations: FloatArray) -> FloatArray:
        goal_distance, to_goal, zombie_distance, to_zombie = observations.T
        zombie = zombie_distance[:, None] * direction(to_zombie) - goal_distance[:, None] * direction(to_goal)
        dead = length(zombie - self._last_zombie) < _UNMOVED
        self._last_zombie = zombie
        attack = ~dead & (zombie_distance < RANGE)
        return _actions(attack, np.where(dead | attack, to_goal, to_zombie))
