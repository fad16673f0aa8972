"""Bots that do not wait, or go to and fro, longer than people did."""

import numpy as np
import pytest
import torch
from torch.distributions import Categorical

from tvae.data.arrays import from_arrays
from tvae.data.trajectory import DataError
from tvae.device import seeded
from tvae.distributions import Columns, Joint
from tvae.generate.restless import Restless
from tvae.model.decoding import Fixed
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import Categorical as Choices
from tvae.spaces import Continuous, Space


def law(copies: int, favourite: float) -> Joint:
    logits = torch.tensor([favourite, 0.0, 0.0]).expand(copies, 1, 3)
    return Joint(1, (Columns(torch.tensor([0]), Categorical(logits=logits)),))


def walks(*places):
    return from_arrays(
        [np.array(path, dtype=np.float64)[:, None] for path in places],
        [np.arange(1.0, len(path))[:, None] for path in places],
    )


def bot(demonstrations, **options) -> Restless:
    model = TrajectoryVAE(Space((Continuous("x"),)), Space((Choices("move", ("a", "b", "c")),)), hidden_features=4)
    return Restless(model, Fixed(np.zeros(2)), demonstrations, **options)


def chosen(policy: Restless, seen: np.ndarray, favourite: float, seed: int = 5) -> np.ndarray:
    """(T, N) actions for what is seen (T, N)."""
    policy.reset(seen.shape[1], seed)
    with seeded(seed, torch.device("cpu")):
        steps = [policy.choose(law(seen.shape[1], favourite), observations[:, None]) for observations in seen]
    return torch.stack(steps)[..., 0].numpy()


RESTS = walks([0, 0, 0, 1, 1, 1, 2])


def test_a_rest_that_lasts_too_long_is_ended_by_what_was_not_tried_in_it_and_each_episode_is_its_own():
    policy = bot(RESTS)
    assert policy.longest_rest == 2
    seen = np.array([[9.0, 1], [9, 2], [9, 3], [9, 4], [9, 5]])
    acted = chosen(policy, seen, favourite=5.0)
    assert acted[:3, 0].tolist() == [0, 0, 0]
    assert set(acted[3:, 0].tolist()) == {1, 2}
    assert not acted[:, 1].any()


def test_where_something_new_is_seen_nothing_counts_as_tried():
    seen = np.repeat([[9.0], [8.0]], 3, axis=0)
    assert not chosen(bot(RESTS), seen, favourite=30.0).any()


def test_to_and_fro_is_a_rest_too_and_what_was_tried_is_told_apart_by_where():
    policy = bot(walks([0, 1, 0, 1, 2]))
    assert policy.longest_rest == 2
    acted = chosen(policy, np.array([[8.0], [9], [8], [9], [8], [9]]), favourite=5.0)[:, 0].tolist()
    assert acted[:4] == [0, 0, 0, 0]
    assert acted[4] in (1, 2)
    assert acted[5] in (1, 2)


def test_what_was_seen_long_ago_is_new():
    seen = np.r_[0.0, np.arange(1.0, 17.0), 0.0][:, None]
    policy = bot(walks([0, *range(1, 17), 0, 0, 1, 1, 2]))
    assert policy.longest_rest == 1
    assert not chosen(policy, np.repeat(seen, 3, axis=1), favourite=30.0).any()
    assert bot(walks([0, *range(1, 16), 0, 0, 18])).longest_rest == 2


def test_after_too_long_a_rest_it_is_hotter_for_as_long_as_a_rest_may_last():
    seen = np.repeat(np.array([[9.0], [9], [9], [9], [1], [2], [3], [4]]), 4000, axis=1)
    first = (chosen(bot(RESTS), seen, favourite=3.0) == 0).mean(axis=1)
    usual, hot = (torch.tensor([3.0, 0, 0]).div(t).softmax(0)[0].item() for t in (1.0, 1.5))
    np.testing.assert_allclose(first[[0, 1, 2, 6, 7]], usual, atol=0.03)
    np.testing.assert_allclose(first[[4, 5]], hot, atol=0.03)


def test_a_temperature_counts_everywhere():
    seen = np.arange(4000.0)[None]
    first = (chosen(bot(RESTS, temperature=0.5), seen, favourite=1.0) == 0).mean()
    assert first == pytest.approx(torch.tensor([2.0, 0, 0]).softmax(0)[0].item(), abs=0.03)


def test_the_same_seed_gives_the_same_episodes():
    policy, seen = bot(RESTS), np.zeros((9, 3))
    assert (chosen(policy, seen, 0.0) == chosen(policy, seen, 0.0)).all()


def test_it_plays_as_any_policy_does():
    policy = bot(RESTS)
    policy.reset(2, seed=0)
    acted = [policy.act(np.zeros((2, 1))) for _ in range(6)]
    assert np.shape(acted) == (6, 2, 1)
    assert set(np.unique(acted)) <= {0.0, 1.0, 2.0}


def test_people_who_never_do_anything_tell_of_no_rest():
    with pytest.raises(DataError, match="demonstrations in which something changes"):
        bot(walks([0, 0, 0]))
