"""PushT: the simulator's own dynamics, faster, and the recorded demonstrations replayed."""

import sys
from importlib import import_module
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gym_pusht.envs.pusht import PushTEnv as Simulator
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from tvae.data.trajectory import DataError
from tvae.envs.pusht import SUCCESS_COVERAGE, PushTEnv, pusht_demonstrations, replay
from tvae.rollouts import rollout
from tvae.spaces import Angular, Continuous

RECORDED = Path(__file__).parent.parent / "data" / "pusht_human_206.npz"
AT_GOAL = [100.0, 100.0, 256.0, 256.0, np.pi / 4]


@pytest.fixture(scope="module")
def demonstrations():
    return pusht_demonstrations(RECORDED)


class Wander:
    """Random targets near the block."""

    def reset(self, num_episodes, seed):
        self._random = np.random.default_rng(seed)

    def act(self, observations):
        return observations[:, 2:4] + self._random.normal(scale=60, size=(len(observations), 2))


@pytest.mark.filterwarnings("ignore:.*we recommend using a symmetric and normalized space")
def test_environment_is_one():
    check_env(gymnasium.make("tvae/PushT-v0", render_mode="rgb_array").unwrapped)


def test_kinds_and_names(demonstrations):
    signals = demonstrations.observation_space.signals
    assert signals[:4] == tuple(Continuous(name) for name in ("agent_x", "agent_y", "block_x", "block_y"))
    assert signals[4] == Angular("block_angle")
    assert demonstrations.action_space.signals == (Continuous("target_x"), Continuous("target_y"))


@pytest.mark.parametrize("seed", [0, 1])
def test_dynamics_are_those_of_the_simulator(seed):
    env, reference = PushTEnv(), Simulator(obs_type="state")
    observation, _ = env.reset(seed=seed)
    expected, _ = reference.reset(seed=seed)
    random = np.random.default_rng(seed)
    for _ in range(100):
        assert observation[:4].tolist() == expected[:4].tolist()
        assert np.cos(observation[4] - expected[4]) == pytest.approx(1, abs=1e-15)
        assert -np.pi <= observation[4] <= np.pi
        target = np.clip(observation[2:4] + random.normal(scale=60, size=2), 0, 512)
        observation, reward, terminated, _, info = env.step(target)
        expected, expected_reward, expected_end, _, expected_info = reference.step(target)
        assert info["coverage"] == pytest.approx(expected_info["coverage"], abs=1e-12)
        assert reward == pytest.approx(expected_reward, abs=1e-12)
        assert terminated == expected_end == info["is_success"]


def test_recorded_arrays(demonstrations):
    assert len(demonstrations) == 206
    assert demonstrations.num_steps == 25_650
    assert (demonstrations.lengths.min(), demonstrations.lengths.max()) == (49, 246)
    assert not demonstrations.final_observed.any()
    assert np.abs(demonstrations.observations[:, 4]).max() <= np.pi
    assert demonstrations.attributes["episode"].tolist() == list(range(206))


def test_replays_follow_the_recordings(demonstrations):
    env = PushTEnv()
    outcomes = [replay(demonstration, env) for demonstration in demonstrations[::4]]
    close = [outcome.deviation < 1e-3 for outcome in outcomes]
    best = np.array([outcome.best_coverage for outcome in outcomes])
    assert np.mean(close) > 0.85
    assert best.mean() == pytest.approx(0.898, abs=5e-4)
    assert (best > SUCCESS_COVERAGE).sum() == 4
    again = [replay(demonstration, env) for demonstration in demonstrations[:8:4]]
    assert again == outcomes[:2]


def test_start_from_a_state_at_its_goal():
    env = PushTEnv()
    observation, info = env.reset(options={"state": AT_GOAL})
    assert observation == pytest.approx(AT_GOAL)
    assert info == {"coverage": pytest.approx(1), "best_coverage": pytest.approx(1), "is_success": True}
    _, reward, terminated, truncated, info = env.step(np.array([100.0, 100.0]))
    assert (reward, terminated, truncated, info["is_success"]) == (1.0, True, False, True)


def test_rollouts_repeat_with_their_seed():
    envs = gymnasium.make_vec("tvae/PushT-v0", num_envs=3)
    first, again, other = (rollout(envs, Wander(), 3, seed=seed) for seed in (5, 5, 6))
    assert np.array_equal(first.observations, again.observations)
    assert not np.array_equal(first[0].observations[0], other[0].observations[0])
    assert first.lengths.max() <= 300
    for episode in first:
        coverage, best = episode.steps["info.coverage"], episode.steps["info.best_coverage"]
        assert (best >= np.maximum.accumulate(coverage)).all()
        assert episode.steps["truncated"][-1] != episode.steps["terminated"][-1]
        assert episode.steps["info.is_success"].dtype == bool


def test_picture():
    env = PushTEnv(render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (680, 680, 3)


def test_wrong_input_is_refused_in_words(tmp_path):
    with pytest.raises(ResetNeeded, match="must be reset"):
        PushTEnv().step(np.zeros(2))
    with pytest.raises(ValueError, match=r"state needs 5 finite numbers \(agent_x, .*got \[1. 2.\]"):
        PushTEnv().reset(options={"state": [1.0, 2.0]})
    env = PushTEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="needs finite numbers, got"):
        env.step(np.array([np.nan, 0.0]))
    np.savez(tmp_path / "part.npz", state=np.zeros((3, 5)))
    with pytest.raises(DataError, match="action, episode_ends missing"):
        pusht_demonstrations(tmp_path / "part.npz")
    np.savez(tmp_path / "short.npz", state=np.zeros((3, 5)), action=np.zeros((2, 2)), episode_ends=np.array([3]))
    with pytest.raises(DataError, match="episode's end 3, got 3 and 2"):
        pusht_demonstrations(tmp_path / "short.npz")


def test_missing_simulator_is_said_in_words(monkeypatch):
    for name in ("gym_pusht", "gym_pusht.envs", "gym_pusht.envs.pusht"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "tvae.envs.pusht")
    with pytest.raises(ImportError, match=r"pip install 'tvae\[pusht\]'"):
        import_module("tvae.envs.pusht")
