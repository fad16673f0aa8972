"""Raw rows, values and features."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from toys import ACTIONS, OBSERVATIONS, noise, rows, untrained
from tvae.data.demonstrations import Demonstrations
from tvae.data.normalizer import Normalizer
from tvae.data.trajectory import Trajectory
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

PLANE = Space((Continuous("x"), Continuous("y")))


@pytest.mark.parametrize("space", [OBSERVATIONS, ACTIONS, PLANE])
def test_values_are_standardised_and_turn_back(space: Space):
    raw = rows(space, 500, np.random.default_rng(0))
    normalizer = Normalizer.fit(space, raw)
    recorded = torch.from_numpy(raw).float()
    values = normalizer.values(recorded)
    torch.testing.assert_close(normalizer.raw(values), recorded, rtol=1e-5, atol=1e-5)
    continuous = values[:, space.continuous]
    torch.testing.assert_close(continuous.mean(0), torch.zeros(len(space.continuous)), rtol=0, atol=1e-5)
    torch.testing.assert_close(continuous.std(0, correction=0), torch.ones(len(space.continuous)))
    for others in (space.angular, space.binary, space.categorical):
        assert torch.equal(values[:, others], recorded[:, others])


@given(scale=st.floats(1e-12, 1e12), offset=st.floats(-1e3, 1e3))
def test_any_unit_of_measurement_gives_the_same_values(scale: float, offset: float):
    raw = rows(PLANE, 100, np.random.default_rng(1))
    moved = (raw + offset) * scale
    values = Normalizer.fit(PLANE, raw).values(torch.from_numpy(raw).float())
    others = Normalizer.fit(PLANE, moved).values(torch.from_numpy(moved).float())
    torch.testing.assert_close(values, others, rtol=0, atol=1e-3)


def test_features_are_numbers_directions_signs_and_one_hot_categories():
    space = Space(
        (Categorical("a", ("p", "q", "r")), Binary("b"), Angular("c"), Continuous("d"), Categorical("e", (7, 8)))
    )
    features = Normalizer(space).features(torch.tensor([[2.0, 0.0, np.pi / 2, 1.5, 0.0], [0.0, 1.0, np.pi, -4.0, 1.0]]))
    expected = torch.tensor([[1.5, 0, 1, -1, 0, 0, 1, 1, 0], [-4, -1, 0, 1, 1, 0, 0, 0, 1]], dtype=torch.float32)
    torch.testing.assert_close(features, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", [Continuous, Angular, Binary])
@pytest.mark.parametrize("lead", [(), (3,), (2, 5)])
def test_width_is_that_of_the_space(kind: type, lead: tuple[int, ...]):
    for space in (OBSERVATIONS, ACTIONS, Space((kind("only"),)), Space((Categorical("only", (0, 1, 2)),))):
        normalizer = Normalizer(space)
        assert normalizer.num_features == space.num_features
        assert normalizer.features(torch.zeros(*lead, space.num_columns)).shape == (*lead, space.num_features)


def test_angles_are_the_same_across_the_seam():
    normalizer = Normalizer(Space((Angular("heading"),)))
    seam = normalizer.features(torch.tensor([[-np.pi], [np.pi], [3 * np.pi]]))
    torch.testing.assert_close(seam, seam[:1].expand(3, -1), rtol=0, atol=1e-6)


@pytest.mark.parametrize("constant", [0.0, 0.1, -7e6, 1e-9])
def test_a_constant_column_keeps_its_unit(constant: float):
    raw = np.stack([np.full(50, constant), np.arange(50.0)], axis=1)
    normalizer = Normalizer.fit(PLANE, raw)
    assert normalizer.std[0] == 1
    values = normalizer.values(torch.from_numpy(raw).float())
    assert (values[:, 0].abs() <= 1e-6 * max(1, abs(constant))).all()
    assert normalizer.values(torch.tensor([[constant + 2.0, 0.0]]))[0, 0].item() == pytest.approx(2, abs=1)


def test_rounding_to_single_precision_is_not_taken_for_a_signal():
    """1e6 +- 0.01 is 1e6 in single precision: what is left of its changes must not be blown up."""
    raw = np.stack([1e6 + 0.01 * np.sin(np.arange(100.0)), np.arange(100.0)], axis=1)
    normalizer = Normalizer.fit(PLANE, raw)
    values = normalizer.values(torch.from_numpy(raw).float())
    assert (values.abs() < 2).all()


def test_one_row_is_enough():
    normalizer = Normalizer.fit(PLANE, np.array([[3.0, -4.0]]))
    assert normalizer.mean.tolist() == [3, -4]
    assert normalizer.std.tolist() == [1, 1]


def test_calibration_measures_the_episodes_at_hand_only():
    """Parts of a split share their arrays; the other part must not be looked at."""
    everything = noise([5, 3, 6, 4], [True, False, True, False])
    part = everything.select([2, 1])
    alone = Demonstrations.from_trajectories(part, part.observation_space, part.action_space)
    models = [untrained(demonstrations) for demonstrations in (everything, part, alone)]
    states = [dict(model.named_buffers()) for model in models]
    assert all(torch.equal(states[1][name], states[2][name]) for name in states[0])
    assert not torch.equal(states[0]["observation_normalizer.mean"], states[1]["observation_normalizer.mean"])
    assert not torch.equal(states[0]["action_normalizer.std"], states[1]["action_normalizer.std"])
    rows_at_hand = np.concatenate([episode.observations for episode in part])
    fitted = Normalizer.fit(part.observation_space, rows_at_hand)
    torch.testing.assert_close(states[1]["observation_normalizer.mean"], fitted.mean)
    torch.testing.assert_close(states[1]["observation_normalizer.std"], fitted.std)


def test_unit_of_the_state_decoder_is_the_typical_change():
    demonstrations = noise([9, 4, 1, 1], [True, False, True, False])
    model = untrained(demonstrations)
    changes = np.concatenate([np.diff(episode.observations, axis=0) for episode in demonstrations])
    angular = OBSERVATIONS.angular
    changes[:, angular] = (changes[:, angular] + np.pi) % (2 * np.pi) - np.pi
    expected = np.sqrt((changes**2).mean(0)) / model.observation_normalizer.std.numpy()
    np.testing.assert_allclose(model.state_decoder.head.unit, expected, rtol=1e-5)


def test_without_any_change_the_unit_is_1():
    still = Demonstrations.from_trajectories([Trajectory(np.zeros((1, 2)), np.zeros((1, 2)))], PLANE, PLANE)
    assert untrained(still).state_decoder.head.unit.tolist() == [1, 1]


def test_many_steps_are_thinned_out_evenly(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tvae.model.calibration.MOST_ROWS", 1_000)
    demonstrations = noise([700] * 10, observation_space=PLANE, action_space=PLANE)
    exact = Normalizer.fit(PLANE, demonstrations.observations)
    model = untrained(demonstrations)
    torch.testing.assert_close(model.observation_normalizer.mean, exact.mean, rtol=0, atol=0.3)
    torch.testing.assert_close(model.observation_normalizer.std, exact.std, rtol=0.1, atol=0)
    assert not torch.equal(model.observation_normalizer.mean, exact.mean)
