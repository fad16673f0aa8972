"""Those who gave the demonstrations, in fresh worlds: the most that imitation can reach.

Source: the scripted demonstrators of the tasks (`tvae.envs`). Nothing is learnt; the label says who acts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.baselines.contract import Bots, Lesson
from tvae.rollouts import Policy
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True)
class Demonstrators:
    """The demonstrator of each label; at will, one drawn for each episode as often as in the demonstrations."""

    def learn(self, lesson: Lesson) -> Bots:
        """The demonstrators, whatever the demonstrations."""
        by_style = {label: lesson.world.demonstrators[label]() for label in lesson.labels}
        shares = np.bincount(lesson.label_index) / len(lesson.demonstrations)
        return Bots(OneOf([lesson.world.demonstrators[label]() for label in lesson.labels], shares), by_style)


class OneOf:
    """A `Policy` that lets one of several act in each episode, drawn with their shares.

    >>> from tvae.envs.zombie_experts import StraightWalk, StraightWalkAttacking
    >>> policy = OneOf([StraightWalk(), StraightWalkAttacking()], np.array([0.0, 1.0]))
    >>> policy.reset(2, seed=0)
    >>> policy.act(np.array([[7.0, 0.8, 0.5, 2.0], [7.0, 0.8, 3.0, 2.0]]))[:, 0].tolist()
    [1.0, 0.0]
    """

    def __init__(self, policies: list[Policy], shares: FloatArray) -> None:
        self.policies = policies
        self.shares = shares

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        random = np.random.default_rng(seed)
        self._who: IntArray = random.choice(len(self.policies), num_episodes, p=self.shares)
        for policy in self.policies:
            policy.reset(num_episodes, int(random.integers(2**31)))

    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) actions of whoever acts in each."""
        actions = np.stack([policy.act(observations) for policy in self.policies])
        return actions[self._who, np.arange(len(observations))]
