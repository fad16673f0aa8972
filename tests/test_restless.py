"""Bots that do not wait longer than people did."""

import numpy as np
import pytest

from tvae.data.arrays import from_arrays
from tvae.data.trajectory import DataError
from tvae.generate.restless import Restless


class Waiting:
    """Does nothing, and remembers when it began."""

    def reset(self, num_episodes, seed):
        self.begun = (num_episodes, seed)

    def act(self, observations):
        return np.zeros((len(observations), 1))


def walks(*places):
    return from_arrays(
        [np.array(path, dtype=np.float64)[:, None] for path in places],
        [np.arange(1.0, len(path))[:, None] for path in places],
    )


def test_each_episode_is_freed_on_its_own_and_rests_again_once_something_changed():
    demonstrations = walks([0, 0, 0, 1, 1, 1, 2])
    bot = Restless(Waiting(), demonstrations)
    assert bot.longest_rest == 2
    bot.reset(2, seed=5)
    assert bot.policy.begun == (2, 5)
    seen = np.array([[[9, 1], [9, 2], [9, 3], [9, 4], [8, 4], [8, 4]]]).reshape(6, 2, 1).astype(float)
    acted = np.array([bot.act(observations)[:, 0] for observations in seen])
    freed = acted != 0
    assert freed[:, 0].tolist() == [False, False, False, True, False, False]
    assert not freed[:, 1].any()
    assert acted[3, 0] in {3.0, 6.0}  # what was done when something changed


def test_the_same_seed_frees_in_the_same_way():
    bot = Restless(Waiting(), walks([0, 0, 1, 2, 3, 4, 4, 5]))
    still, found = np.zeros((1, 1)), []
    for _ in range(2):
        bot.reset(1, seed=3)
        found.append([bot.act(still).item() for _ in range(9)])
    assert found[0] == found[1]
    assert len(set(found[0])) > 2


def test_people_who_never_do_anything_free_nobody():
    with pytest.raises(DataError, match="demonstrations in which something changes"):
        Restless(Waiting(), walks([0, 0, 0]))
