"""Environments of others: wrapped, in vectors, in processes, and those that are particular about their actions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces as gym
from gymnasium import wrappers
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

import tvae
from commands import refused
from toys import noise, untrained
from tvae.data.arrays import from_arrays
from tvae.data.sources import save_demonstrations
from tvae.errors import TvaeError
from tvae.gymnasium_spaces import spaces_of
from tvae.rollouts import SpaceMismatchError, as_vector

Z = np.array([0.5, -1.0])


def agent_for(env: gymnasium.Env[Any, Any]) -> tvae.Agent:
    observation_space, action_space = spaces_of(as_vector(env))
    return tvae.Agent(untrained(noise([5, 4], observation_space=observation_space, action_space=action_space)), Z)


def test_what_a_wrapper_changes_is_what_a_bot_sees_and_does() -> None:
    plain = gymnasium.make("MountainCarContinuous-v0", max_episode_steps=4)
    seen, done = gym.Box(-100, 100, (2,), np.float64), gym.Box(-3, 3, (1,), np.float64)
    wrapped = wrappers.TransformObservation(plain, lambda observation: 10.0 * observation, seen)
    wrapped = wrappers.TransformAction(wrapped, lambda action: action / 3, done)
    episodes = tvae.rollout(wrapped, agent_for(wrapped), 2)
    bare = tvae.rollout(plain, agent_for(plain), 2)
    np.testing.assert_allclose(episodes[0].observations[0], 10 * bare[0].observations[0], rtol=1e-6)
    assert np.abs(episodes.actions).max() > 1
    assert episodes.lengths.tolist() == [4, 4]
    assert episodes.steps["truncated"].tolist() == [False, False, False, True] * 2


def test_names_that_a_wrapper_makes_wrong_are_refused_in_words() -> None:
    named = gymnasium.make("CartPole-v1")
    named.metadata = {**named.metadata, "signal_names": {"observation": ["x", "v", "angle", "turn"]}}
    timed = wrappers.TimeAwareObservation(named)
    message = r"metadata\['signal_names'\]\['observation'\] does not fit .*: 5 signals need as many names, got 4"
    with pytest.raises(TvaeError, match=message):
        tvae.rollout(timed, agent_for(named), 1)
    timed.metadata = {**timed.metadata, "signal_names": {}}
    with pytest.raises(SpaceMismatchError, match=r"4 signals against 5\. Model: x, v, angle, turn\. Env"):
        tvae.rollout(timed, agent_for(named), 1)
    assert len(tvae.rollout(timed, agent_for(timed), 2)) == 2


def test_statistics_of_a_wrapper_do_no_harm() -> None:
    env = wrappers.RecordEpisodeStatistics(gymnasium.make("CartPole-v1"))
    episodes = tvae.rollout(env, agent_for(env), 2)
    assert set(episodes.steps) == {"reward", "terminated", "truncated"}


def test_wrappers_of_vectors_are_respected() -> None:
    make = [lambda: gymnasium.make("MountainCarContinuous-v0", max_episode_steps=4)] * 2
    envs = wrappers.vector.TransformObservation(
        SyncVectorEnv(make), lambda seen: seen + 5, single_observation_space=gym.Box(0, 9, (2,), np.float64)
    )
    agent = agent_for(make[0]())
    moved, plain = (tvae.rollout(vector, agent, 2) for vector in (envs, SyncVectorEnv(make)))
    np.testing.assert_allclose(moved[0].observations[0], plain[0].observations[0] + 5, rtol=1e-6)


def test_a_vector_that_reuses_its_arrays_is_recorded_rightly() -> None:
    class Reusing(SyncVectorEnv):
        def step(self, actions: Any) -> Any:
            seen, *others = super().step(actions)
            self.buffer[...] = seen
            return self.buffer, *others

        def reset(self, **options: Any) -> Any:
            seen, infos = super().reset(**options)
            self.buffer = seen.astype(np.float64)
            return self.buffer, infos

    make = [lambda: gymnasium.make("MountainCarContinuous-v0", max_episode_steps=6)] * 2
    agent = agent_for(make[0]())
    reused, fresh = (tvae.rollout(kind(make), agent, 2) for kind in (Reusing, SyncVectorEnv))
    np.testing.assert_array_equal(reused.observations, fresh.observations)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_environments_in_processes_of_their_own() -> None:
    make = [lambda: gymnasium.make("CartPole-v1")] * 2
    agent = agent_for(make[0]())
    apart, here = AsyncVectorEnv(make), SyncVectorEnv(make)
    try:
        mine, theirs = (tvae.rollout(envs, agent, 3, seed=2) for envs in (here, apart))
    finally:
        apart.close()
    np.testing.assert_array_equal(mine.observations, theirs.observations)
    np.testing.assert_array_equal(mine.actions, theirs.actions)


def test_a_choice_is_a_number_that_a_table_takes() -> None:
    env = gymnasium.make("FrozenLake-v1")
    agent = agent_for(env)
    agent = tvae.Agent(agent.policy.model, Z, env)
    observation, _ = env.reset(seed=0)
    action = agent.act(observation)
    assert {0: "left", 1: "down", 2: "right", 3: "up"}[action]
    env.step(action)
    assert len(tvae.rollout(env, agent, 2)) == 2


def test_a_fit_looks_at_the_environment_before_it_trains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_demonstrations(from_arrays(np.zeros((12, 4, 4)), np.zeros((12, 4), np.int64)), tmp_path / "a.parquet")
    for env, message in (
        ("PixelWorld-v0", "observations of the environment: the space has the shape (64, 64, 3) and dtype uint8"),
        ("MountainCar-v0", "observations differ between model and environment: 4 signals against 2. Model: 0, 1, 2"),
    ):
        if env == "PixelWorld-v0":
            gymnasium.register(env, PixelWorld)
        said = refused(capsys, "fit", tmp_path / "a.parquet", "--out", tmp_path / "run", "--env", env)
        assert message in said
    assert not (tmp_path / "run").exists()


class PixelWorld(gymnasium.Env[np.ndarray, int]):
    """An environment that shows a picture."""

    observation_space = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)
    action_space = gymnasium.spaces.Discrete(2)
