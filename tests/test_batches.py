"""Padded batches, and which episodes a step of training takes."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from toys import ACTIONS, OBSERVATIONS, noise
from tvae.data.batches import BucketedSampler, batch_of, ordered_batches

sizes = st.integers(1, 40)
lengths = st.lists(st.integers(1, 50), min_size=1, max_size=200).map(np.array)


@given(episodes=st.lists(st.tuples(st.integers(1, 6), st.booleans()), min_size=1, max_size=6), data=st.data())
def test_a_batch_holds_its_episodes_and_zeros(episodes: list[tuple[int, bool]], data: st.DataObject):
    demonstrations = noise(*zip(*episodes, strict=True))
    chosen = np.array(data.draw(st.lists(st.integers(0, len(episodes) - 1), min_size=1, max_size=4)))
    batch = batch_of(demonstrations, chosen)
    longest = max(episodes[index][0] for index in chosen)
    assert len(batch) == len(chosen)
    assert batch.observations.shape == batch.next_observations.shape == (len(chosen), longest, OBSERVATIONS.num_columns)
    assert batch.actions.shape == (len(chosen), longest, ACTIONS.num_columns)
    for row, index in enumerate(chosen):
        episode, length = demonstrations[int(index)], len(demonstrations[int(index)])
        after = episode.observations[1:].astype(np.float32)
        assert batch.lengths[row] == length
        assert batch.mask[row].tolist() == [step < length for step in range(longest)]
        assert batch.next_known[row].tolist() == [step < len(after) for step in range(longest)]
        np.testing.assert_array_equal(
            batch.observations[row, :length], episode.observations[:length].astype(np.float32)
        )
        np.testing.assert_array_equal(batch.actions[row, :length], episode.actions.astype(np.float32))
        np.testing.assert_array_equal(batch.next_observations[row, : len(after)], after)
        assert (batch.observations[row, length:] == 0).all()
        assert (batch.actions[row, length:] == 0).all()
        assert (batch.next_observations[row, len(after) :] == 0).all()


def test_batches_leave_the_recording_alone():
    demonstrations = noise([3, 5])
    demonstrations.observations.flags.writeable = False
    demonstrations.actions.flags.writeable = False
    batch = batch_of(demonstrations, np.array([1, 0]))
    assert batch.observations.dtype == batch.actions.dtype == torch.float32
    assert batch.lengths.dtype == torch.int64
    assert batch.next_known.dtype == torch.bool


@given(lengths=lengths, size=sizes, seed=st.integers(0, 2**32))
def test_an_epoch_visits_each_episode_at_most_once_and_leaves_out_less_than_a_group(
    lengths: np.ndarray, size: int, seed: int
):
    sampler = BucketedSampler(lengths, size, seed)
    for epoch in range(2):
        steps = range(epoch * sampler.steps_per_epoch, (epoch + 1) * sampler.steps_per_epoch)
        groups = [sampler.episodes(step) for step in steps]
        visited = np.concatenate(groups)
        assert len(np.unique(visited)) == len(visited)
        assert all(len(group) == min(size, len(lengths)) for group in groups)
        assert len(lengths) - len(visited) < size


def test_what_an_epoch_leaves_out_comes_in_others():
    sampler = BucketedSampler(np.ones(10, dtype=np.int64), size=4, seed=0)
    assert {int(index) for step in range(10) for index in sampler.episodes(step)} == set(range(10))


@given(lengths=lengths, size=sizes, seed=st.integers(0, 2**32), data=st.data())
def test_a_step_depends_on_seed_and_number_alone(lengths: np.ndarray, size: int, seed: int, data: st.DataObject):
    steps = data.draw(st.lists(st.integers(0, 100), min_size=1, max_size=5))
    sampler = BucketedSampler(lengths, size, seed)
    once = [sampler.episodes(step) for step in steps]
    for step, episodes in reversed(list(zip(steps, once, strict=True))):
        np.testing.assert_array_equal(BucketedSampler(lengths, size, seed).episodes(step), episodes)
        np.testing.assert_array_equal(sampler.episodes(step), episodes)


def test_seeds_and_epochs_differ():
    many = np.ones(1_000, dtype=np.int64)
    sampler = BucketedSampler(many, 100, seed=0)
    assert not np.array_equal(sampler.episodes(0), BucketedSampler(many, 100, seed=1).episodes(0))
    assert not np.array_equal(sampler.episodes(0), sampler.episodes(10))


def test_groups_are_of_similar_lengths_and_in_any_order():
    lengths = np.random.default_rng(0).integers(1, 200, 3_000)
    sampler = BucketedSampler(lengths, 30, seed=0)
    longest = np.array([lengths[sampler.episodes(step)].max() for step in range(sampler.steps_per_epoch)])
    padded = longest.sum() * 30
    assert lengths.sum() / padded > 0.9
    assert abs(np.corrcoef(np.arange(len(longest)), longest)[0, 1]) < 0.3


@pytest.mark.parametrize("size", [1, 3, 100])
def test_evaluation_visits_each_episode_once_shortest_first(size: int):
    demonstrations = noise([3, 5, 1, 4, 4, 2])
    groups = list(ordered_batches(demonstrations, size))
    order = np.concatenate(groups)
    assert sorted(order) == list(range(6))
    assert (np.diff(demonstrations.lengths[order]) >= 0).all()
    assert max(map(len, groups)) <= size
