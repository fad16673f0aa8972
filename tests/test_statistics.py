"""Statistics of episodes against each episode by itself, in plain Python."""

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.evaluate import statistics
from tvae.evaluate.statistics import MOST_CATEGORIES, EpisodeStatistics
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

MOVES = ("left", "right", "{stay}")
OBSERVATIONS = Space((Continuous("x"), Angular("facing"), Categorical("room", tuple(range(MOST_CATEGORIES + 1)))))
ACTIONS = Space((Binary("jump"), Categorical("move", MOVES), Angular("heading"), Continuous("x")))
LENGTHS = (4, 1, 7, 3, 1, 12)


def episode(random, length, final):
    rows = length + final
    observations = np.stack(
        [random.normal(size=rows), random.uniform(-9, 9, rows), random.integers(0, MOST_CATEGORIES + 1, rows)], axis=1
    )
    actions = np.stack(
        [
            random.integers(0, 2, length),
            random.integers(0, 3, length),
            random.uniform(-np.pi, np.pi, length),
            random.normal(size=length),
        ],
        axis=1,
    )
    steps = {
        "reward": random.normal(size=length),
        "info.coins": random.integers(0, 9, length),
        "info.won": random.integers(0, 2, length) == 1,
        "info.x": random.normal(size=length),
        "info.place": np.array(["here"] * length),
        "info.unknown": np.full(length, np.nan),
        "pressure": random.normal(size=length),
    }
    return Trajectory(observations, actions.astype(np.float64), steps)


@pytest.fixture(scope="module")
def demonstrations():
    random = np.random.default_rng(0)
    episodes = [episode(random, length, index % 2) for index, length in enumerate(LENGTHS)]
    return Demonstrations.from_trajectories(episodes, OBSERVATIONS, ACTIONS)


def by_hand(tau):
    """What the table of the module says, of one episode."""
    told = {}
    for kind, space, rows in (("observation", OBSERVATIONS, tau.observations), ("action", ACTIONS, tau.actions)):
        for signal, column in zip(space.signals, rows.T.tolist(), strict=True):
            name = f"{kind}.x" if signal.name == "x" else signal.name
            match signal:
                case Continuous():
                    told[f"{name}.mean"] = sum(column) / len(column)
                    told[f"{name}.lowest"] = min(column)
                    told[f"{name}.highest"] = max(column)
                    told[f"{name}.last"] = column[-1]
                    told[f"{name}.travelled"] = sum(abs(b - a) for a, b in pairwise(column))
                case Angular():
                    told[f"{name}.concentration"] = abs(sum(cmath.exp(1j * x) for x in column)) / len(column)
                    turns = [abs(math.remainder(b - a, 2 * math.pi)) for a, b in pairwise(column)]
                    told[f"{name}.turn"] = sum(turns) / len(turns) if turns else 0.0
                    told[f"{name}.net turn"] = sum(math.remainder(b - a, 2 * math.pi) for a, b in pairwise(column))
                    told[f"{name}.positive"] = sum(math.sin(x) > 0 for x in column) / len(column)
                case Binary():
                    told[f"{name}.count"] = column.count(1)
                case Categorical():
                    if name == "move":
                        for code, move in enumerate(MOVES):
                            told[f"{name}.share of {move}"] = column.count(code) / len(column)
                    told[f"{name}.switches"] = sum(a != b for a, b in pairwise(column))
    told["steps"] = len(tau)
    told["return"] = sum(tau.steps["reward"])
    told["info.coins"] = tau.steps["info.coins"][-1]
    told["info.won"] = tau.steps["info.won"][-1]
    return told


@pytest.mark.parametrize("chosen", [range(6), [5, 2, 2, 0], [1], [4, 1, 3]])
def test_each_episode_by_hand(demonstrations, chosen):
    selected = demonstrations.select(chosen)
    found = EpisodeStatistics.of(selected)
    expected = [by_hand(tau) for tau in selected]
    assert found.names == tuple(expected[0])
    np.testing.assert_allclose(found.values, [list(told.values()) for told in expected], rtol=1e-9, atol=1e-12)


def test_few_steps_at_a_time(demonstrations, monkeypatch):
    whole = EpisodeStatistics.of(demonstrations)
    monkeypatch.setattr(statistics, "_STEPS_AT_ONCE", 5)
    np.testing.assert_array_equal(EpisodeStatistics.of(demonstrations).values, whole.values)


def test_no_episodes(demonstrations):
    assert EpisodeStatistics.of(demonstrations.select([])).values.shape[0] == 0


def test_phrases_can_be_filled(demonstrations):
    found = EpisodeStatistics.of(demonstrations)
    said = [phrase.format(number="3", percent="3%") for phrase in found.phrases]
    assert len(set(found.names)) == len(set(said)) == len(said)
    assert "move is {stay} 3% of the time" in said
    outcomes = [statistic.name for statistic in found.statistics if statistic.is_outcome]
    assert outcomes == ["return", "info.coins", "info.won"]


def test_a_signal_called_as_a_statistic_of_ours_does_not_hide_it():
    walk = Trajectory(np.array([[0.0], [3.0], [1.0]]), np.array([[1.0], [0.0]]))
    spaces = Space((Continuous("steps"),)), Space((Continuous("return"),))
    told = EpisodeStatistics.of(Demonstrations.from_trajectories([walk], *spaces))
    assert told["steps"].tolist() == [2.0]
    assert told["observation.steps.highest"].tolist() == [3.0]
    assert told["action.return.mean"].tolist() == [0.5]


def test_directions_have_no_seam():
    """Just left and just right of pi is nearly one direction."""
    turning = Trajectory(np.zeros((4, 0)), np.array([[3.1], [-3.1], [3.1], [-3.1]]))
    space = Space((Angular("heading"),))
    found = EpisodeStatistics.of(Demonstrations.from_trajectories([turning], Space(()), space))
    assert found["heading.concentration"][0] == pytest.approx(math.cos(math.pi - 3.1))
    assert found["heading.turn"][0] == pytest.approx(2 * (math.pi - 3.1))


def turning(*columns):
    taus = [Trajectory(np.zeros((len(column), 0)), np.array(column)[:, None]) for column in columns]
    return EpisodeStatistics.of(Demonstrations.from_trajectories(taus, Space(()), Space((Angular("heading"),))))


def test_left_is_not_right():
    """A round and a quarter to either side, past the seam; and steering that is itself a turn."""
    left = np.linspace(0, 2.5 * np.pi, 21)
    found = turning(left, -left, [0.3] * 4, [-0.3] * 4)
    np.testing.assert_allclose(found["heading.net turn"], [2.5 * np.pi, -2.5 * np.pi, 0, 0], atol=1e-9)
    np.testing.assert_allclose(found["heading.turn"][:2], 0.125 * np.pi)
    np.testing.assert_allclose(found["heading.positive"][2:], [1, 0])


def test_about_turns_have_no_side():
    """There and back again, and directions on the line between left and right, rounded one way or the other."""
    pi = np.float64(np.float32(np.pi))
    found = turning([0.0, pi, 0.0, pi], [0.0, -pi, 0.0, -pi], [1e-9, -1e-9, pi, -pi])
    assert found["heading.net turn"][:2].tolist() == [0, 0]
    assert found["heading.positive"].tolist() == [0, 0, 0]
    np.testing.assert_allclose(found["heading.turn"][:2], np.pi)


def test_what_cancels_is_zero():
    steps = np.array([[0.1], [0.2], [-0.3]])
    assert steps.sum() != 0
    tau = Trajectory(np.zeros((3, 0)), steps)
    found = EpisodeStatistics.of(Demonstrations.from_trajectories([tau], Space(()), Space((Continuous("dx"),))))
    assert found["dx.mean"][0] == 0


def test_unknown_name(demonstrations):
    with pytest.raises(KeyError, match="no statistic 'speed'; there are observation\\.x\\.mean"):
        EpisodeStatistics.of(demonstrations)["speed"]
