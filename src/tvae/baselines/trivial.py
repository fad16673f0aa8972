"""What any method must beat on the zombie task: straight walks to the goal, with or without attacks on the way.

Source: the task itself (`tvae.envs.zombie_experts`). Nothing is learnt, and nothing can be asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

from tvae.baselines.contract import Bots, Lesson
from tvae.envs.zombie_experts import StraightWalk, StraightWalkAttacking


@dataclass(frozen=True)
class Walking:
    """a_t = (heading of the goal, no attack)."""

    def learn(self, lesson: Lesson) -> Bots:
        """The walker, whatever the lesson."""
        return Bots(StraightWalk())


@dataclass(frozen=True)
class WalkingAttacking:
    """a_t = (heading of the goal, attack whenever the zombie is in range, dead or not)."""

    def learn(self, lesson: Lesson) -> Bots:
        """The walker, whatever the lesson."""
        return Bots(StraightWalkAttacking())
