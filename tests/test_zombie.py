"""The zombie world against its law, and its demonstrators against the figures that the task rests on."""

from dataclasses import fields
from itertools import pairwise

import gymnasium
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import tvae  # noqa: F401 - registers the environments
from tvae.envs.zombie import (
    HELD_OUT_WORLDS,
    AttackExpert,
    AvoidExpert,
    StraightWalk,
    StraightWalkAttacking,
    TwoStepAttacker,
    ZombieAttackEnv,
    ZombieAttackVectorEnv,
    success,
    zombie_demonstrations,
)
from tvae.envs.zombie_dynamics import GOAL, ZombieAttack, ZombieState, chases, leads, stops, zigzags
from tvae.gymnasium_spaces import flatten, spaces_of, unflatten
from tvae.rollouts import rollout
from tvae.spaces import Angular, Binary, Continuous

mpl.use("Agg")

NUM_EPISODES = 2000
INFO = {"attacks", "zombie_dead", "closest_zombie", "closest_goal", "goal_reached"}


@pytest.fixture(scope="module")
def demonstrations():
    return zombie_demonstrations()


def episodes_of(policy, **world):
    return rollout(ZombieAttackVectorEnv(1000, **world), policy, NUM_EPISODES, seed=7)


def final(demonstrations, column):
    return demonstrations.steps[column][demonstrations.action_starts + demonstrations.lengths - 1]


def state(agent, zombie, *, zombie_start=(9.0, 9.0), time=0, closest=np.inf):
    """One copy with a living zombie."""
    return ZombieState(
        time=np.array([time]),
        agent=np.array([agent]),
        heading=np.zeros(1),
        zombie=np.array([zombie]),
        zombie_start=np.array([zombie_start]),
        alive=np.array([True]),
        attacks=np.array([0]),
        closest_zombie=np.array([closest]),
        closest_goal=np.array([np.inf]),
    )


def test_env_checker():
    check_env(gymnasium.make("tvae/ZombieAttack-v0").unwrapped)


def test_made_by_gymnasium_in_each_way():
    single = gymnasium.make("tvae/ZombieAttack-v0", zombie_speed=0.2)
    assert isinstance(single.unwrapped, ZombieAttackEnv)
    batched = gymnasium.make_vec("tvae/ZombieAttack-v0", num_envs=3, behaviour="leads")
    assert isinstance(batched, ZombieAttackVectorEnv)
    assert batched.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    sync = gymnasium.make_vec("tvae/ZombieAttack-v0", num_envs=3, vectorization_mode="sync")
    assert success(rollout(sync, AttackExpert(), 5))["attack"].all()
    assert sync.single_action_space == batched.single_action_space


def test_spaces_are_read_for_what_they_are():
    envs = ZombieAttackVectorEnv(2)
    observation, action = spaces_of(envs)
    assert observation.signals == (
        Continuous("distance_to_goal"),
        Angular("bearing_of_goal"),
        Continuous("distance_to_zombie"),
        Angular("bearing_of_zombie"),
    )
    assert action.signals == (Binary("attack"), Angular("heading"))
    assert list(envs.single_action_space.spaces) == ["attack", "heading"]


def test_a_row_becomes_an_action_and_back():
    space, row = ZombieAttackEnv().action_space, np.array([1.0, 4.0])
    action = unflatten(space, row)
    assert action in space
    np.testing.assert_allclose(flatten(space, action), [1.0, 4.0 - 2 * np.pi])


def test_vector_env_keeps_to_its_spaces_and_restarts_in_the_next_step():
    envs = ZombieAttackVectorEnv(200)
    envs.action_space.seed(0)
    observations, info = envs.reset(seed=0)
    assert set(info) == INFO | {f"_{name}" for name in INFO}
    previously_ended = np.zeros(200, dtype=bool)
    restarts = 0
    for _ in range(70):
        assert observations in envs.observation_space
        observations, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
        assert all(values.shape == (200,) for values in info.values())
        fresh = observations[previously_ended]
        np.testing.assert_allclose(fresh[:, 0], np.hypot(5, 5))
        assert (fresh[:, 2] >= 2).all()
        assert (info["attacks"][previously_ended] == 0).all()
        assert not (terminated | truncated | (reward > 0))[previously_ended].any()
        assert not (terminated & truncated).any()
        previously_ended = terminated | truncated
        restarts += int(previously_ended.sum())
    assert restarts >= 2 * 200


def test_single_env_equals_vector_env():
    rng = np.random.default_rng(0)
    for seed, options in enumerate(({}, *HELD_OUT_WORLDS.values())):
        env, envs = ZombieAttackEnv(**options), ZombieAttackVectorEnv(1, **options)
        (one, one_info), (many, many_info) = env.reset(seed=seed), envs.reset(seed=seed)
        ended = False
        while not ended:
            np.testing.assert_array_equal(one, many[0])
            assert one_info == {name: many_info[name][0] for name in INFO}
            heading, attack = np.array(rng.normal(one[1], 0.5)), rng.integers(2, size=1)
            one, *outcome, one_info = env.step({"attack": attack, "heading": heading})
            many, *outcomes, many_info = envs.step({"attack": attack[None], "heading": heading[None]})
            assert outcome == [values[0] for values in outcomes]
            ended = outcome[1] or outcome[2]


def test_copies_are_independent():
    task, rng = ZombieAttack(behaviour=zigzags), np.random.default_rng(0)
    together = task.start(50, rng)
    alone = [
        ZombieState(**{f.name: getattr(together, f.name)[[i]] for f in fields(together)}) for i in range(50)
    ]
    for _ in range(20):
        actions = np.stack((rng.integers(2, size=50), rng.uniform(-np.pi, np.pi, size=50)), axis=1)
        together = task.step(together, actions)
        alone = [task.step(one, actions[[i]]) for i, one in enumerate(alone)]
    for field in fields(together):
        separate = np.concatenate([getattr(one, field.name) for one in alone])
        np.testing.assert_array_equal(getattr(together, field.name), separate)


def test_zombie_starts_uniformly_away_from_the_agent():
    zombie = ZombieAttack().start(20_000, np.random.default_rng(0)).zombie
    distance = np.hypot(*zombie.T)
    assert distance.min() >= 2
    assert zombie.min() >= -2.5
    assert zombie.max() <= 5
    share = ((zombie > 2).all(axis=1)).mean()  # a square that the free circle does not touch
    assert share == pytest.approx(9 / (7.5**2 - np.pi * 4), abs=0.01)


@pytest.mark.parametrize(
    ("zombie", "attack", "dead", "zombie_after", "closest"),
    [
        ((0.9, 0.0), 1, True, (0.9, 0.0), 2.0),  # killed before anybody moves, so no contact after it counts
        ((0.9, 0.0), 0, False, (0.6, 0.0), 0.1),
        ((1.0, 0.0), 1, False, (0.7, 0.0), 0.2),  # just out of range
        ((0.7, 0.0), 0, False, (0.5, 0.0), 0.0),  # does not overshoot
    ],
)
def test_order_within_a_step(zombie, attack, dead, zombie_after, closest):
    task = ZombieAttack()
    after = task.step(state((0.0, 0.0), zombie, closest=2.0), np.array([[attack, 0.0]]))
    np.testing.assert_allclose(after.agent, [[0.5, 0.0]])
    np.testing.assert_allclose(after.zombie, [zombie_after], atol=1e-12)
    info = task.info(after)
    assert info["zombie_dead"] == dead
    assert info["attacks"] == attack
    np.testing.assert_allclose(info["closest_zombie"], closest, atol=1e-12)
    bearing = np.arctan2(*(np.array(zombie_after) - (0.5, 0.0))[::-1])
    distance = np.hypot(*(np.array(zombie_after) - (0.5, 0.0)))
    np.testing.assert_allclose(task.observe(after)[0, 2:], [distance, bearing], atol=1e-12)


def test_dead_zombie_stays_in_sight():
    env = ZombieAttackEnv()
    expert = AttackExpert()
    expert.reset(1, seed=0)
    observation, info = env.reset(seed=3)
    positions = []
    ended = False
    while not ended:
        attack, heading = expert.act(observation[None])[0]
        observation, _, terminated, truncated, info = env.step(
            {"attack": np.array([attack]), "heading": np.array(heading)}
        )
        goal, zombie = (d * np.array([np.cos(b), np.sin(b)]) for d, b in (observation[:2], observation[2:]))
        if info["zombie_dead"]:
            positions.append(GOAL - goal + zombie)
        ended = terminated or truncated
    assert terminated
    assert len(positions) > 3
    np.testing.assert_allclose(positions, np.broadcast_to(positions[0], (len(positions), 2)), atol=1e-12)


def test_goal_ends_the_episode_with_reward_1_and_30_steps_without():
    env = ZombieAttackEnv()
    observation, _ = env.reset(seed=0)
    for step in range(1, 15):
        action = {"attack": np.array([0]), "heading": np.array(observation[1])}
        observation, reward, terminated, truncated, info = env.step(action)
        assert terminated == (step == 14)
        assert reward == info["goal_reached"] == float(terminated)
        assert not truncated
    assert info["closest_goal"] == observation[0] < 0.5
    env.reset(seed=0)
    away = {"attack": np.array([1]), "heading": np.array(-2.5)}
    ends = [env.step(away)[2:4] for _ in range(30)]
    assert ends == [(False, False)] * 29 + [(False, True)]


DIAGONAL = 0.3 / np.sqrt(2)


@pytest.mark.parametrize(
    ("behaviour", "before", "step"),
    [
        (chases, {}, (-0.3, 0.0)),
        (stops, {"zombie_start": (5.0, 0.0), "closest": 2.6}, (-0.3, 0.0)),
        (stops, {"zombie_start": (5.0, 0.0), "closest": 2.4}, (0.0, 0.0)),
        (leads, {}, (-0.6 / np.sqrt(5), 0.3 / np.sqrt(5))),  # to (0, 1), half of their distance ahead
        (zigzags, {"time": 0}, (-DIAGONAL, -DIAGONAL)),
        (zigzags, {"time": 1}, (-DIAGONAL, DIAGONAL)),
        (zigzags, {"time": 2}, (-DIAGONAL, DIAGONAL)),
        (zigzags, {"time": 3}, (-DIAGONAL, -DIAGONAL)),
    ],
)
def test_behaviours(behaviour, before, step):
    """The agent walks up to (0, 0), the zombie stands at (2, 0)."""
    moved = ZombieAttack(behaviour=behaviour).step(
        state((0.0, -0.5), (2.0, 0.0), **before), np.array([[0.0, np.pi / 2]])
    )
    np.testing.assert_allclose(moved.agent, [[0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(moved.zombie - [2.0, 0.0], [step], atol=1e-12)


@pytest.mark.parametrize(("expert", "style"), [(AttackExpert(), "attack"), (AvoidExpert(), "avoid")])
def test_experts_always_succeed(expert, style):
    episodes = episodes_of(expert)
    outcome = success(episodes)
    assert len(episodes) == NUM_EPISODES
    assert outcome[style].all()
    assert not outcome["avoid" if style == "attack" else "attack"].any()
    assert (final(episodes, "info.attacks") == (1 if style == "attack" else 0)).all()
    assert episodes.lengths.max() <= 24


def test_straight_walks_measure_the_difficulty():
    assert success(episodes_of(StraightWalk()))["avoid"].mean() == pytest.approx(0.53, abs=0.04)
    assert success(episodes_of(StraightWalkAttacking()))["attack"].mean() == pytest.approx(0.47, abs=0.04)


def test_two_observations_suffice_to_attack():
    episodes = episodes_of(TwoStepAttacker())
    assert success(episodes)["attack"].all()
    assert (final(episodes, "info.attacks") == 1).all()


@pytest.mark.parametrize("world", HELD_OUT_WORLDS)
def test_held_out_worlds(world):
    options = HELD_OUT_WORLDS[world]
    assert success(episodes_of(AttackExpert(), **options))["attack"].mean() >= 0.99
    assert success(episodes_of(AvoidExpert(), **options))["avoid"].mean() >= 0.99
    straight = success(episodes_of(StraightWalk(), **options))["avoid"].mean()
    low, high = {
        "speed_0.2": (0.58, 0.66),
        "speed_0.4": (0.40, 0.48),
        "start_0_5": (0.05, 0.12),
        "start_-5_5": (0.74, 0.82),
        "stops": (0.65, 0.73),
        "leads": (0.43, 0.51),
        "zigzag": (0.58, 0.66),
    }[world]
    assert low < straight < high


def test_a_zombie_that_stops_looks_dead():
    assert success(episodes_of(TwoStepAttacker(), **HELD_OUT_WORLDS["stops"]))["attack"].mean() < 0.5


def test_demonstrations(demonstrations):
    label = demonstrations.attribute("label")
    assert len(demonstrations) == NUM_EPISODES
    assert (label == "attack").sum() == (label == "avoid").sum() == NUM_EPISODES // 2
    assert (label[:100] == "attack").sum() in range(25, 76)
    np.testing.assert_array_equal(demonstrations.attribute("episode"), np.arange(NUM_EPISODES))
    outcome = success(demonstrations)
    np.testing.assert_array_equal(outcome["attack"], label == "attack")
    np.testing.assert_array_equal(outcome["avoid"], label == "avoid")
    columns = {"reward", "terminated", "truncated", *(f"info.{name}" for name in INFO)}
    assert set(demonstrations.steps) == columns
    assert demonstrations.final_observed.all()
    assert final(demonstrations, "terminated").all()
    assert demonstrations.steps["reward"].sum() == NUM_EPISODES
    assert not demonstrations.steps["truncated"].any()
    assert demonstrations.lengths.max() <= 24


def test_demonstrations_by_seed():
    one, same, other = (zombie_demonstrations(11, seed=seed) for seed in (1, 1, 2))
    assert (one.attribute("label") == "attack").sum() == 6
    np.testing.assert_array_equal(one.observations, same.observations)
    np.testing.assert_array_equal(one.actions, same.actions)
    np.testing.assert_array_equal(one.attribute("label"), same.attribute("label"))
    assert not np.array_equal(one[0].observations[0], other[0].observations[0])
    with pytest.raises(ValueError, match="at least 2, got 1"):
        zombie_demonstrations(1)


def test_vector_env_is_reproducible():
    envs = ZombieAttackVectorEnv(5)
    first, _ = envs.reset(seed=4)
    second, _ = envs.reset()
    again, _ = envs.reset(seed=4)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"behaviour": "dances"}, "behaviour must be one of chases, stops, leads, zigzags, got 'dances'"),
        ({"zombie_speed": -0.1}, "zombie_speed must be finite and not negative, got -0.1"),
        ({"zombie_speed": np.nan}, "zombie_speed must be finite"),
        ({"start_low": 3.0, "start_high": 3.0}, "start_low must be less than start_high"),
        ({"start_low": -1.0, "start_high": 1.0}, "the start region needs a coordinate beyond"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        ZombieAttackEnv(**options)


def test_bad_use_is_refused():
    env = ZombieAttackEnv()
    action = {"attack": np.array([0]), "heading": np.array(0.0)}
    with pytest.raises(ResetNeeded, match="reset before its first step"):
        env.step(action)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="finite numbers"):
        env.step(action | {"heading": np.array(np.nan)})
    with pytest.raises(ValueError, match="num_envs must be at least 1, got 0"):
        ZombieAttackVectorEnv(0)


def test_pictures_show_what_happens():
    env = ZombieAttackEnv(render_mode="rgb_array")
    expert = AttackExpert()
    expert.reset(1, seed=0)
    observation, info = env.reset(seed=3)
    frames = [env.render()]
    while not info["zombie_dead"]:
        attack, heading = expert.act(observation[None])[0]
        action = {"attack": np.array([attack]), "heading": np.array(heading)}
        observation, _, _, _, info = env.step(action)
        frames.append(env.render())
    assert all(frame.shape == (400, 400, 3) and frame.dtype == np.uint8 for frame in frames)
    assert all((before != after).any() for before, after in pairwise(frames))
    red = [(frame.astype(int) @ [2, -1, -1] > 200).sum() for frame in frames]
    assert red[-1] < min(red[:-1])  # the living zombie's circle is gone
    assert ZombieAttackEnv().render() is None


def test_pictures_of_a_vector_env_show_the_present_episode_only():
    envs = ZombieAttackVectorEnv(2, render_mode="rgb_array")
    expert = AttackExpert()
    expert.reset(2, seed=0)
    observations, _ = envs.reset(seed=0)
    ended = np.zeros(2, dtype=bool)
    while not ended.any():
        attack, heading = expert.act(observations).T
        observations, _, terminated, truncated, _ = envs.step({"attack": attack[:, None], "heading": heading})
        ended = terminated | truncated
    copy = int(ended.argmax())
    walked = envs.render()[copy]
    envs.step({"attack": np.zeros((2, 1)), "heading": np.zeros(2)})
    restarted = envs.render()[copy]
    blue = [(frame.astype(int) @ [-1, -1, 2] > 100).sum() for frame in (walked, restarted)]
    assert blue[1] < blue[0] / 2
    assert ZombieAttackVectorEnv(2).render() is None


def test_a_window_opens_and_closes():
    env = ZombieAttackEnv(render_mode="human")
    env.reset(seed=0)
    figures = plt.get_fignums()
    env.step({"attack": np.array([0]), "heading": np.array(0.0)})
    assert env.render() is None
    assert plt.get_fignums() == figures != []
    env.close()
    env.close()
    assert plt.get_fignums() == figures[:-1]
