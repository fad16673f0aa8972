"""The circle world against its law, and its expert against the figures that the task rests on."""

import gymnasium
import matplotlib as mpl
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import tvae  # noqa: F401 - registers the environments
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.envs.circle import (
    RADII,
    CircleEnv,
    CircleExpert,
    CircleVectorEnv,
    ConstantTurn,
    angles_walked,
    circle_demonstrations,
    circle_steps,
    radius_errors,
)
from tvae.gymnasium_spaces import spaces_of
from tvae.rollouts import rollout
from tvae.spaces import Angular, Continuous, Space

mpl.use("Agg")

NUM_EPISODES = 1500


@pytest.fixture(scope="module")
def demonstrations():
    return circle_demonstrations(NUM_EPISODES)


def radii_of(demonstrations):
    return np.array([RADII[label] for label in demonstrations.attribute("label")])


def test_env_checker():
    check_env(gymnasium.make("tvae/Circle-v0").unwrapped)


def test_spaces():
    envs = gymnasium.make_vec("tvae/Circle-v0", num_envs=2)
    assert isinstance(envs, CircleVectorEnv)
    observation, action = spaces_of(envs)
    assert observation.signals == (Continuous("x"), Continuous("y"))
    assert action.signals == (Angular("turn"),)


def test_turns_add_up_to_a_heading_and_episodes_have_126_steps():
    env, rng = CircleEnv(), np.random.default_rng(0)
    position, info = env.reset(seed=0)
    heading = info["heading"]
    assert heading == 0
    for step in range(1, 127):
        turn = rng.uniform(-np.pi, np.pi)
        heading += turn
        before, (position, reward, terminated, truncated, info) = position, env.step(np.array(turn))
        np.testing.assert_allclose(position - before, [np.cos(heading), np.sin(heading)], atol=1e-12)
        assert -np.pi <= info["heading"] < np.pi
        assert (reward, terminated, truncated) == (0.0, False, step == 126)


def test_single_env_equals_vector_env():
    env, envs = CircleEnv(), CircleVectorEnv(1)
    (one, _), (many, _) = env.reset(seed=5), envs.reset(seed=5)
    for turn in np.linspace(-3, 3, 20):
        np.testing.assert_array_equal(one, many[0])
        one, *_ = env.step(np.array(turn))
        many, *_ = envs.step(np.array([turn]))


def test_measures_on_perfect_circles():
    rows = []
    for radius, distance in ((10.0, 0.0), (-10.0, 2.0), (20.0, 0.5)):
        angle = np.arange(circle_steps(radius) + 31) * 2 * np.pi / circle_steps(radius)
        around = np.stack([np.sin(angle), -np.sign(radius) * np.cos(angle)], axis=1)
        path = [0.0, radius] + (abs(radius) + distance) * around
        path[circle_steps(radius) + 1 :] = 99.0  # is not looked at
        rows.append(Trajectory(path, np.zeros((len(path) - 1, 1))))
    space = Space((Continuous("x"), Continuous("y")))
    circles = Demonstrations.from_trajectories(rows, space, Space((Angular("turn"),)))
    radii = np.array([10.0, -10.0, 20.0])
    np.testing.assert_allclose(radius_errors(circles, radii), [0.0, 2.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(angles_walked(circles, radii), 2 * np.pi)
    backwards = Trajectory(circles[0].observations[circle_steps(10.0) :: -1], np.zeros((63, 1)))
    reverse = Demonstrations.from_trajectories([backwards], space, circles.action_space)
    np.testing.assert_allclose(angles_walked(reverse, radii[:1]), -2 * np.pi)


def test_expert_walks_once_around(demonstrations):
    radii = radii_of(demonstrations)
    errors, angles = radius_errors(demonstrations, radii), angles_walked(demonstrations, radii)
    for radius in RADII.values():
        assert errors[radii == radius].mean() == pytest.approx(0.09, abs=0.01)
        assert angles[radii == radius].mean() == pytest.approx(2 * np.pi, rel=0.01)
    assert errors.max() < 0.3
    assert angles.min() > np.radians(350)


@pytest.mark.parametrize(("radius", "drift"), [(10.0, 1.5), (-10.0, 1.5), (20.0, 4.0)])
def test_without_feedback_it_drifts(radius, drift):
    envs = CircleVectorEnv(1000, num_steps=circle_steps(radius))
    episodes = rollout(envs, ConstantTurn(radius), 1000)
    assert radius_errors(episodes, np.full(1000, radius)).mean() == pytest.approx(drift, rel=0.1)


def test_expert_goes_on_around():
    episodes = rollout(CircleVectorEnv(100), CircleExpert(-10.0), 100)
    assert (episodes.lengths == 126).all()
    distances = np.hypot(*(episodes.observations - [0.0, -10.0]).T)
    assert np.abs(distances - 10).max() < 0.8


def test_demonstrations(demonstrations):
    label = demonstrations.attribute("label")
    assert {name: int((label == name).sum()) for name in RADII} == dict.fromkeys(RADII, 500)
    np.testing.assert_array_equal(demonstrations.attribute("episode"), np.arange(NUM_EPISODES))
    expected = np.where(label == "left_20", 126, 63)
    np.testing.assert_array_equal(demonstrations.lengths, expected)
    assert demonstrations.final_observed.all()
    last = demonstrations.action_starts + demonstrations.lengths - 1
    assert demonstrations.steps["truncated"][last].all()
    assert demonstrations.steps["truncated"].sum() == NUM_EPISODES
    assert "info.heading" in demonstrations.steps


def test_demonstrations_by_seed():
    one, same, other = (circle_demonstrations(3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.actions, same.actions)
    np.testing.assert_array_equal(one.attribute("label"), same.attribute("label"))
    assert not np.array_equal(one.actions, other.actions)


def test_bad_options_are_refused():
    with pytest.raises(ValueError, match="num_steps must be at least 1, got 0"):
        CircleEnv(num_steps=0)
    with pytest.raises(ValueError, match="3 styles need num_episodes of at least 3, got 2"):
        circle_demonstrations(2)


def test_pictures_show_the_way():
    env = CircleEnv(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(60):
        env.step(np.array(0.1))
    after = env.render()
    assert before.shape == after.shape == (400, 400, 3)
    blue = [(frame.astype(int) @ [-1, -1, 2] > 100).sum() for frame in (before, after)]
    assert blue[1] > blue[0] + 50
