"""The people whose demonstrations are learnt from, in their own recordings: the most that imitation can reach.

They cannot be asked to play again: what is measured is what they did, beside the people who are held out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.baselines.contract import Bots, Lesson
from tvae.data.demonstrations import Demonstrations
from tvae.experiments.benchmark.tasks import TASKS
from tvae.spaces import FloatArray


@dataclass(frozen=True)
class People:
    """The people of a task."""

    task: str

    def learn(self, lesson: Lesson) -> Bots:
        """Their recordings, no step of them twice."""
        return Bots(Recorded(TASKS[self.task].apart(lesson.demonstrations)))


class Recorded:
    """A `Policy` that does in each episode what was done in one of these, whatever it sees; behind its end, the last
    action again. The benchmark measures `episodes` themselves, and does not play.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(2).select([0])
    >>> policy = Recorded(demonstrations)
    >>> policy.reset(1, seed=0)
    >>> [bool((policy.act(np.zeros((1, 4)))[0] == action).all()) for action in demonstrations[0].actions[:2]]
    [True, True]
    """

    def __init__(self, episodes: Demonstrations) -> None:
        self.episodes = episodes

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes, each with a recording drawn for it."""
        drawn = np.random.default_rng(seed).integers(len(self.episodes), size=num_episodes)
        self._starts, self._last = self.episodes.action_starts[drawn], self.episodes.lengths[drawn] - 1
        self._step = 0

    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) the recorded actions of this step."""
        at = self._starts + np.minimum(self._step, self._last)
        self._step += 1
        return self.episodes.actions[at]
