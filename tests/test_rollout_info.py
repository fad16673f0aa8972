"""Which facts of an environment's info become step columns."""

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv

from tvae.rollouts import rollout


class Counter(gymnasium.Env):
    """Three steps; says the time at each, and `now_and_then` not in the second."""

    observation_space = gymnasium.spaces.Box(0.0, 3.0, shape=(1,), dtype=np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time = 0
        return np.zeros(1), {}

    def step(self, action):
        self.time += 1
        info = {"time": self.time} | ({} if self.time == 2 else {"now_and_then": 1.0})
        return np.full(1, float(self.time)), 0.0, self.time == 3, False, info


class Zeros:
    def reset(self, num_episodes, seed):
        pass

    def act(self, observations):
        return np.zeros((len(observations), 1))


def test_only_what_is_said_at_each_step_becomes_a_column():
    episodes = rollout(SyncVectorEnv([Counter, Counter]), Zeros(), 3)
    assert set(episodes.steps) == {"reward", "terminated", "truncated", "info.time"}
    assert [episode.steps["info.time"].tolist() for episode in episodes] == [[1, 2, 3]] * 3
