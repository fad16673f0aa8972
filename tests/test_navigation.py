"""The navigation world against its law, and its expert against the figures that the task rests on."""

import gymnasium
import matplotlib as mpl
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import tvae  # noqa: F401 - registers the environments
from tvae.envs.navigation import (
    GOAL_BEARINGS,
    NavigationEnv,
    NavigationExpert,
    NavigationVectorEnv,
    any_goal,
    navigation_demonstrations,
)
from tvae.gymnasium_spaces import spaces_of
from tvae.rollouts import rollout
from tvae.spaces import Angular, Continuous

mpl.use("Agg")

NUM_EPISODES = 3000


@pytest.fixture(scope="module")
def demonstrations():
    return navigation_demonstrations(NUM_EPISODES)


def final_distances(demonstrations):
    ends = demonstrations.observations[demonstrations.observation_starts + demonstrations.lengths]
    goals = np.stack([demonstrations.attribute("goal_x"), demonstrations.attribute("goal_y")], axis=1)
    return np.hypot(*(ends - goals).T)


def test_env_checker():
    check_env(gymnasium.make("tvae/Navigation-v0").unwrapped)


def test_spaces():
    envs = gymnasium.make_vec("tvae/Navigation-v0", num_envs=2)
    assert isinstance(envs, NavigationVectorEnv)
    observation, action = spaces_of(envs)
    assert observation.signals == (Continuous("x"), Continuous("y"))
    assert action.signals == (Angular("heading"),)


def test_moves_have_length_1_and_episodes_100_steps():
    env, rng = NavigationEnv(), np.random.default_rng(0)
    position, _ = env.reset(seed=0)
    for step in range(1, 101):
        heading = rng.uniform(-np.pi, np.pi)
        before, (position, reward, terminated, truncated, info) = position, env.step(np.array(heading))
        np.testing.assert_allclose(position - before, [np.cos(heading), np.sin(heading)], atol=1e-12)
        assert (terminated, truncated) == (False, step == 100)
        distance = np.hypot(info["goal_x"] - position[0], info["goal_y"] - position[1])
        assert info["goal_distance"] == pytest.approx(distance)
        assert reward == pytest.approx(-distance if step == 100 else 0.0)


def test_straight_walk_stays_in_the_observation_space():
    for heading in np.linspace(-np.pi, np.pi, 9):
        env = NavigationEnv()
        env.reset(seed=0)
        for _ in range(100):
            position, *_ = env.step(np.array(heading))
        assert position in env.observation_space


def test_single_env_equals_vector_env():
    env, envs = NavigationEnv(), NavigationVectorEnv(1)
    (one, info), (many, infos) = env.reset(seed=5), envs.reset(seed=5)
    for heading in np.linspace(-3, 3, 20):
        np.testing.assert_array_equal(one, many[0])
        assert (info["goal_x"], info["goal_y"]) == (infos["goal_x"][0], infos["goal_y"][0])
        one, *_, info = env.step(np.array(heading))
        many, *_, infos = envs.step(np.array([heading]))


def test_goals_are_jittered_about_three_places():
    goals = any_goal(30_000, np.random.default_rng(0))
    centres = 100 * np.stack(
        [np.cos(list(GOAL_BEARINGS.values())), np.sin(list(GOAL_BEARINGS.values()))], axis=1
    )
    offsets = goals[:, None] - centres
    nearest = np.hypot(*offsets.transpose(2, 0, 1)).argmin(axis=1)
    np.testing.assert_allclose(np.bincount(nearest) / len(goals), 1 / 3, atol=0.015)
    jitter = offsets[np.arange(len(goals)), nearest]
    np.testing.assert_allclose(jitter.mean(axis=0), 0.0, atol=0.15)
    np.testing.assert_allclose(np.cov(jitter.T), 25 * np.eye(2), atol=1.0)


def test_expert_arrives(demonstrations):
    distances = final_distances(demonstrations)
    assert distances.mean() == pytest.approx(5.2, abs=0.4)
    assert np.percentile(distances, 95) == pytest.approx(13.0, abs=1.0)
    last = demonstrations.action_starts + demonstrations.lengths - 1
    np.testing.assert_allclose(demonstrations.steps["info.goal_distance"][last], distances)
    np.testing.assert_allclose(demonstrations.steps["reward"][last], -distances)


def test_experts_noise_is_a_stationary_autoregression():
    goals = np.tile([1e9, 0.0], (5000, 1))  # so far away that its bearing is 0 from everywhere
    episodes = rollout(NavigationVectorEnv(5000), NavigationExpert(goals), 5000)
    noise = episodes.actions.reshape(5000, 100)
    np.testing.assert_allclose(noise.std(axis=0), 0.3, atol=0.02)
    for lag in (1, 3):
        correlation = np.corrcoef(noise[:, :-lag].ravel(), noise[:, lag:].ravel())[0, 1]
        assert correlation == pytest.approx(0.8**lag, abs=0.02)


def test_demonstrations(demonstrations):
    label = demonstrations.attribute("label")
    assert {name: int((label == name).sum()) for name in GOAL_BEARINGS} == dict.fromkeys(GOAL_BEARINGS, 1000)
    np.testing.assert_array_equal(demonstrations.attribute("episode"), np.arange(NUM_EPISODES))
    assert (demonstrations.lengths == 100).all()
    assert demonstrations.final_observed.all()
    towards = np.arctan2(demonstrations.attribute("goal_y"), demonstrations.attribute("goal_x"))
    expected = np.array([GOAL_BEARINGS[name] for name in label])
    assert np.abs(towards - expected).max() < np.radians(15)
    assert {"info.goal_x", "info.goal_y", "info.goal_distance"} <= set(demonstrations.steps)


def test_demonstrations_by_seed():
    one, same, other = (navigation_demonstrations(4, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.actions, same.actions)
    np.testing.assert_array_equal(one.attribute("goal_x"), same.attribute("goal_x"))
    assert not np.array_equal(one.actions, other.actions)
    assert (one.attribute("label") == "left").sum() == 2


def test_too_few_are_refused():
    with pytest.raises(ValueError, match="3 styles need num_episodes of at least 3, got 2"):
        navigation_demonstrations(2)
    with pytest.raises(ValueError, match="2 episodes need as many goals, got 1"):
        NavigationExpert(np.zeros((1, 2))).reset(2, seed=0)


def test_pictures_show_the_way():
    env = NavigationEnv(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(50):
        env.step(np.array(0.5))
    after = env.render()
    assert before.shape == after.shape == (400, 400, 3)
    blue = [(frame.astype(int) @ [-1, -1, 2] > 100).sum() for frame in (before, after)]
    assert blue[1] > blue[0] + 50
