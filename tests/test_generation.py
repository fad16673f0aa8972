"""Imagined trajectories, and bots in environments."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces as gym
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import tvae
from toys import ACTIONS, OBSERVATIONS, noise, rows, untrained
from tvae.data.trajectory import DataError
from tvae.generate.closed_loop import Agent, LatentPolicy
from tvae.generate.open_loop import imagine
from tvae.gymnasium_spaces import flatten, spaces_of
from tvae.model.decoding import Fixed, Recurrence, Tempered, most_likely, sampled
from tvae.model.tvae import TrajectoryVAE
from tvae.rollouts import SpaceMismatchError, as_vector, check_spaces, rollout
from tvae.spaces import Continuous, Space

Z = np.array([0.4, -1.2])


@pytest.fixture(scope="module")
def model() -> TrajectoryVAE:
    return untrained(noise([4, 7, 5]), stop=False)


@pytest.fixture(scope="module")
def starts() -> np.ndarray:
    return rows(OBSERVATIONS, 6, np.random.default_rng(0))


@pytest.fixture(scope="module")
def latents() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(6, 2))


def assert_same(left: Any, right: Any, atol: float = 0.0) -> None:
    assert left.lengths.tolist() == right.lengths.tolist()
    np.testing.assert_allclose(left.observations, right.observations, rtol=0, atol=atol)
    np.testing.assert_allclose(left.actions, right.actions, rtol=0, atol=atol)


# Open loop


@pytest.mark.parametrize("num_steps", [1, 9])
def test_imagined_trajectories_begin_at_their_starts_and_have_all_steps(
    model: TrajectoryVAE, starts: np.ndarray, latents: np.ndarray, num_steps: int
):
    imagined = imagine(model, starts, latents, num_steps=num_steps)
    assert imagined.lengths.tolist() == [num_steps] * 6
    assert imagined.final_observed.all()
    np.testing.assert_array_equal([episode.observations[0] for episode in imagined], starts)
    for values, space in ((imagined.observations, OBSERVATIONS), (imagined.actions, ACTIONS)):
        assert space.first_problem(values) is None
        assert (np.abs(values[:, space.angular]) <= np.pi + 1e-6).all()


def test_imagined_episodes_end_by_themselves():
    """With a stop chance of 0.2 a step, lengths are geometric, cut at the most steps."""
    model = untrained(noise([4, 7, 5]), stop=True)
    with torch.no_grad():
        model.state_decoder.stop.weight.zero_()
        model.state_decoder.stop.bias.fill_(np.log(0.2 / 0.8))
    count = 2_000
    imagined = imagine(
        model, np.repeat(rows(OBSERVATIONS, 1, np.random.default_rng(0)), count, 0), np.zeros((count, 2)), num_steps=8
    )
    chances = [0.2 * 0.8 ** (k - 1) for k in range(1, 8)] + [0.8**7]
    np.testing.assert_allclose(np.bincount(imagined.lengths, minlength=9)[1:] / count, chances, atol=0.03)
    assert all(len(episode.observations) == len(episode) + 1 for episode in imagined)
    with torch.no_grad():
        model.state_decoder.stop.bias.fill_(50.0)
    assert imagine(model, np.ones((2, 6)), np.zeros((2, 2)), num_steps=8).lengths.tolist() == [1, 1]


def test_same_seed_same_dream(model: TrajectoryVAE, starts: np.ndarray, latents: np.ndarray):
    torch.manual_seed(8)
    expected = torch.rand(3)
    torch.manual_seed(8)
    first = imagine(model, starts, latents, num_steps=5, seed=3)
    assert torch.equal(torch.rand(3), expected)
    assert_same(first, imagine(model, starts, latents, num_steps=5, seed=3))
    assert not np.array_equal(first.actions, imagine(model, starts, latents, num_steps=5, seed=4).actions)


def test_most_likely_dreams_are_not_random(model: TrajectoryVAE, starts: np.ndarray, latents: np.ndarray):
    first = imagine(model, starts, latents, num_steps=5, seed=3, choice=most_likely)
    assert_same(first, imagine(model, starts, latents, num_steps=5, seed=4, choice=most_likely))


def test_a_temperature_of_1_draws_as_learnt_and_a_cold_one_what_is_most_likely(
    model: TrajectoryVAE, starts: np.ndarray, latents: np.ndarray
):
    def dream(choice: Any) -> Any:
        return imagine(model, starts, latents, num_steps=5, seed=3, choice=choice)

    assert_same(dream(Tempered(1.0)), dream(sampled))
    cold, mode = dream(Tempered(1e-9)), dream(most_likely)
    np.testing.assert_allclose(cold.observations, mode.observations, atol=1e-2)


@pytest.mark.parametrize("temperature", [0.0, -1.0, np.nan, np.inf])
def test_a_temperature_is_positive(temperature: float):
    with pytest.raises(ValueError, match="a temperature must be a positive number, got"):
        Tempered(temperature)


@pytest.mark.parametrize("choice", [sampled, most_likely])
def test_a_window_that_holds_all_is_none(model: TrajectoryVAE, starts: np.ndarray, latents: np.ndarray, choice: Any):
    def dream(window: int | None) -> Any:
        return imagine(model, starts, latents, num_steps=6, window=window, choice=choice)

    assert_same(dream(None), dream(6), atol=1e-4)
    assert_same(dream(6), dream(50), atol=1e-4)
    assert not np.allclose(dream(None).actions, dream(2).actions, atol=1e-3)


def test_the_window_of_the_training_is_the_default(starts: np.ndarray, latents: np.ndarray):
    narrow = untrained(noise([4, 7, 5]), window=2)
    assert_same(imagine(narrow, starts, latents, num_steps=6), imagine(narrow, starts, latents, num_steps=6, window=2))
    policy = LatentPolicy(narrow, Fixed(Z))
    assert policy.window == 2
    assert LatentPolicy(narrow, Fixed(Z), window=1).window == 1
    assert LatentPolicy(narrow, Fixed(Z), window=5).window == 2


@pytest.mark.parametrize("dynamics", [False, True])
def test_a_dream_follows_its_decoders_step_by_step(starts: np.ndarray, latents: np.ndarray, dynamics: bool):
    """The most likely dream is the one whose every row is the mode of what the whole-sequence decoders say."""
    model = untrained(noise([4, 7, 5]), stop=False, dynamics=dynamics, events=False)
    imagined = imagine(model, starts[:1], latents[:1], num_steps=5, choice=most_likely)
    episode, z = imagined[0], torch.from_numpy(latents[:1]).float()
    with torch.no_grad():
        values = model.observation_normalizer.values(torch.from_numpy(episode.observations[None, :-1]).float())
        states = model.observation_normalizer.features(values)
        taken = model.action_normalizer.values(torch.from_numpy(episode.actions[None]).float())
        law, _, _ = model.state_decoder(model.state_decoder_inputs(states, taken), values, z)
        following = model.observation_normalizer.raw(law.mode())[0].numpy()
        seen = torch.from_numpy(episode.observations[None, :-1]).float()
        inputs = model.policy_decoder_inputs(seen, torch.zeros(1, 5, 0))
        actions = model.action_normalizer.raw(model.policy_decoder(inputs, z).mode())[0].numpy()
    following[:, OBSERVATIONS.angular] = (following[:, OBSERVATIONS.angular] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(episode.observations[1:], following, atol=1e-4)
    np.testing.assert_allclose(episode.actions, actions, atol=1e-4)


@pytest.mark.parametrize("dynamics", [False, True])
def test_the_dreamed_world_answers_to_the_action_where_it_is_a_dynamics_model(
    starts: np.ndarray, latents: np.ndarray, dynamics: bool
):
    """Another policy leads from the same states to others; a world that reads z alone goes its way."""
    model = untrained(noise([4, 7, 5]), stop=False, dynamics=dynamics)
    first = imagine(model, starts, latents, num_steps=4, choice=most_likely)
    with torch.no_grad():
        for parameter in model.policy_decoder.parameters():
            parameter.neg_()
    second = imagine(model, starts, latents, num_steps=4, choice=most_likely)
    assert not np.allclose(first.actions, second.actions, atol=1e-2)
    assert np.array_equal(first.observations, second.observations) == (not dynamics)


@pytest.mark.parametrize("window", [1, 3])
def test_a_dynamics_model_dreams_in_windows(starts: np.ndarray, latents: np.ndarray, window: int):
    model = untrained(noise([4, 7, 5]), dynamics=True, window=window)
    assert_same(
        imagine(model, starts, latents, num_steps=1, seed=3),
        imagine(model, starts, latents, num_steps=1, seed=3, window=9),
        atol=1e-5,
    )
    assert len(imagine(model, starts, latents, num_steps=6)) == 6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_steps": 0}, "num_steps must be at least 1, got 0"),
        ({"z": np.zeros((5, 2))}, r"6 episodes need z of the shape \(6, 2\), got \(5, 2\)"),
        ({"z": np.zeros((6, 3))}, r"got \(6, 3\)"),
        ({"z": Z}, r"got \(2,\)"),
        ({"window": 0}, "window must be at least 1 step, got 0"),
        ({"z": np.full((6, 2), np.nan)}, r"z needs finite numbers, got \[nan nan\]"),
        ({"starts": np.zeros((6, 2))}, r"starts need the shape \(episodes, 6\), got \(6, 2\)"),
        ({"starts": np.full((6, 6), np.inf)}, r"start 0, column observation\.room: needs a finite number, got inf"),
    ],
)
def test_impossible_dreams_are_refused(model: TrajectoryVAE, starts: np.ndarray, change: dict, message: str):
    with pytest.raises(ValueError, match=message):
        imagine(model, **{"starts": starts, "z": np.zeros((6, 2)), "num_steps": 3, **change})


def test_a_dream_that_explodes_ends_in_words():
    space = Space((Continuous("x"),))
    model = untrained(noise([5, 5], observation_space=space, action_space=space))
    with torch.no_grad():
        model.state_decoder.head.parameters_of_law.bias.fill_(1e38)
        model.state_decoder.head.unit.fill_(1e3)
    with pytest.raises(ValueError, match="grow beyond all numbers at step 1"):
        imagine(model, np.zeros((1, 1)), np.zeros((1, 2)), num_steps=3)


# Policies


def laws(model: TrajectoryVAE, observations: np.ndarray, window: int | None) -> torch.Tensor:
    """The policy's features after each observation, (T, N, H)."""
    recurrence = Recurrence(
        model.policy_decoder.trunk, torch.from_numpy(np.tile(Z, (observations.shape[1], 1))).float(), window
    )
    nothing = torch.zeros(observations.shape[1], model.events.num_events)
    with torch.inference_mode():
        return torch.stack(
            [recurrence.step(model.policy_decoder_inputs(torch.from_numpy(o).float(), nothing)) for o in observations]
        )


@pytest.mark.parametrize("window", [1, 2, 3])
def test_a_window_sees_so_many_states_and_no_more(model: TrajectoryVAE, window: int):
    """Two pasts that differ up to `window` steps ago: the present law is the same after, and not before, that."""
    random = np.random.default_rng(2)
    one = np.stack([rows(OBSERVATIONS, 4, random) for _ in range(6)])
    other = one.copy()
    other[2] = rows(OBSERVATIONS, 4, random)
    same = [torch.allclose(a, b) for a, b in zip(laws(model, one, window), laws(model, other, window), strict=True)]
    assert same == [not 2 <= step < 2 + window for step in range(6)]


def test_a_memoryless_policy_depends_on_the_present_alone():
    """But for the events that it has used."""
    model = untrained(noise([4, 7, 5]), stop=False, events=False)
    present = rows(OBSERVATIONS, 3, np.random.default_rng(3))
    policy = LatentPolicy(model, Fixed(Z), window=1, choice=most_likely)
    answers = []
    for past in (0, 1, 5):
        policy.reset(3, seed=0)
        for _ in range(past):
            policy.act(rows(OBSERVATIONS, 3, np.random.default_rng(past)))
        answers.append(policy.act(present))
    np.testing.assert_array_equal(answers[0], answers[1])
    np.testing.assert_array_equal(answers[0], answers[2])


def test_a_policy_acts_by_its_seed(model: TrajectoryVAE):
    observations = rows(OBSERVATIONS, 4, np.random.default_rng(3))

    def acts(seed: int) -> np.ndarray:
        policy = LatentPolicy(model, Fixed(Z))
        policy.reset(4, seed)
        return np.stack([policy.act(observations) for _ in range(3)])

    torch.manual_seed(8)
    expected = torch.rand(3)
    torch.manual_seed(8)
    first = acts(0)
    assert torch.equal(torch.rand(3), expected)
    np.testing.assert_array_equal(first, acts(0))
    assert not np.array_equal(first, acts(1))
    assert not np.array_equal(first[0], first[1])


def test_fixed_latents():
    random = np.random.default_rng(0)
    np.testing.assert_array_equal(Fixed(Z).sample(3, random), [Z, Z, Z])
    several = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(Fixed(several).sample(2, random), several[:2])
    with pytest.raises(ValueError, match="4 copies of the environment need one z or as many, got 3"):
        Fixed(several).sample(4, random)


def test_z_of_another_size_is_refused(model: TrajectoryVAE):
    with pytest.raises(ValueError, match=r"1 episodes need z of the shape \(1, 2\), got \(1, 3\)"):
        Agent(model, np.zeros(3))


def test_a_z_is_whatever_holds_its_numbers(model: TrajectoryVAE):
    for z in (Z.tolist(), tuple(Z), torch.tensor(Z)):
        np.testing.assert_array_equal(Agent(model, z).policy.z, [Z])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_observation_that_is_no_number_is_refused(model: TrajectoryVAE, value: float):
    """Not acted on, and above all not waited for."""
    policy = LatentPolicy(model, Fixed(Z))
    policy.reset(3, 0)
    observations = rows(OBSERVATIONS, 3, np.random.default_rng(3))
    observations[1, OBSERVATIONS.column("x")] = value
    with pytest.raises(DataError, match=r"episode 1, column observation\.x: needs a finite number"):
        policy.act(observations)


# Agents


class Fork(gymnasium.Env):
    """Takes and gives dictionaries, tuples and choices; ends after three steps; remembers what it was given."""

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own type

    observation_space = gym.Dict(
        {"place": gym.Discrete(4, start=-1), "view": gym.Tuple((gym.Box(-2, 2, (2,)), gym.MultiBinary(2)))}
    )
    action_space = gym.Dict({"turn": gym.Box(-np.pi, np.pi, dtype=np.float64), "tool": gym.MultiDiscrete([2, 3])})

    def __init__(self) -> None:
        self.given: list[Any] = []
        self.closed = False

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.observation_space.seed(seed)
        self.time = 0
        return self.observation_space.sample(), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.given.append(action)
        self.time += 1
        return self.observation_space.sample(), float(self.time), self.time == 3, False, {}

    def close(self):
        self.closed = True


def model_for(env: gymnasium.Env) -> TrajectoryVAE:
    observation_space, action_space = spaces_of(as_vector(env))
    return untrained(noise([5, 4], observation_space=observation_space, action_space=action_space))


@pytest.mark.parametrize(
    "make", [lambda: gymnasium.make("tvae/ZombieAttack-v0"), Fork, lambda: gymnasium.make("CartPole-v1")]
)
@pytest.mark.parametrize("choice", [sampled, most_likely])
def test_agents_act_in_the_spaces_of_the_environment(make: Any, choice: Any):
    env = make()
    agent = Agent(model_for(env), Z, env, choice=choice)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        agent.reset()
        ended = False
        for _ in range(3):
            if not ended:
                action = agent.act(observation)
                assert env.action_space.contains(action)
                observation, _, ended, _, _ = env.step(action)


def test_an_agent_without_environment_speaks_in_names(model: TrajectoryVAE):
    agent = Agent(model, Z)
    observation = {"room": 2, "x": [1.0], "bearing": [0.5], "alive": [1], "y": [3.0], "door": 0}
    action = agent.act(observation)
    assert set(action) == set(ACTIONS.names)
    assert int(action["tool"]) in {1, 2, 3, 4}
    assert action["attack"].tolist() in [[0], [1]]
    alone = Agent(model, Z).act({name: np.ravel(value)[0] for name, value in observation.items()})
    assert str(alone) == str(action)


def test_an_agent_without_environment_speaks_in_names_whatever_the_signals():
    space = Space((Continuous("x"), Continuous("y")))
    agent = Agent(untrained(noise([5, 4], observation_space=space, action_space=space)), Z)
    action = agent.act({"x": 1.0, "y": -2.0})
    assert {name: value.shape for name, value in action.items()} == {"x": (1,), "y": (1,)}
    for observation in ({"x": 1.0}, np.zeros(2), None):
        with pytest.raises(DataError, match=r"an observation has to be of Dict\('x': .*, got "):
            agent.act(observation)


def test_an_agent_plays_one_episode(cart_pole: TrajectoryVAE):
    env = gymnasium.make("CartPole-v1")
    agent = Agent(cart_pole, Z, env)
    with pytest.raises(DataError, match=r"an agent plays one episode .*, got \(3,\) of them"):
        agent.act(np.zeros((3, 4)))


def test_a_rollout_does_not_disturb_the_episode_of_the_agent():
    env = Fork()
    agent, other = (Agent(model_for(env), Z, env, seed=2) for _ in range(2))
    observation, _ = env.reset(seed=1)
    assert str(agent.act(observation)) == str(other.act(observation))
    tvae.rollout(SyncVectorEnv([Fork] * 3), other, 5)
    assert str(agent.act(observation)) == str(other.act(observation))


def test_an_agent_draws_a_new_z_for_each_episode(model: TrajectoryVAE):
    class Normal:
        def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
            return rng.normal(size=(count, 2))

    agent = Agent(model, Normal(), seed=5)
    first = agent.policy.z
    agent.reset()
    assert not np.array_equal(agent.policy.z, first)
    np.testing.assert_array_equal(Agent(model, Normal(), seed=5).policy.z, first)


def test_environments_stay_open():
    env = Fork()
    agent = Agent(model_for(env), Z, env)
    tvae.rollout(env, agent, 2)
    as_vector(env).close()
    assert not env.closed


TWO, CHOICE = gym.Box(-1, 1, (2,)), gym.Discrete(2)


@pytest.mark.parametrize(
    ("observation_space", "action_space", "message"),
    [
        (gym.Box(-1, 1, (3,)), CHOICE, r"observations differ .*: 2 signals against 3\. Model: 0, 1\. .*: 0, 1, 2\."),
        (gym.MultiBinary(2), CHOICE, r"signal 0 is continuous \('0'\) against binary \('0'\); signal 1"),
        (TWO, gym.Discrete(3), r"actions differ .*: signal 0 is categorical \(2\) \('0'\) against categorical \(3\)"),
        (gym.Box(-np.pi, np.pi, (2,)), CHOICE, r"is continuous \('0'\) against angular"),
    ],
)
def test_a_model_of_other_spaces_is_refused_in_words(observation_space: Any, action_space: Any, message: str):
    class Other(Fork):
        pass

    mine, other = Other(), Other()
    mine.observation_space, mine.action_space = TWO, CHOICE
    other.observation_space, other.action_space = observation_space, action_space
    model = model_for(mine)
    check_spaces(as_vector(mine), model.observation_space, model.action_space)
    with pytest.raises(SpaceMismatchError, match=message):
        Agent(model, Z, other)
    with pytest.raises(SpaceMismatchError, match=message):
        tvae.rollout(other, Agent(model, Z), 1)


# Rollouts


@pytest.fixture(scope="module")
def cart_pole() -> TrajectoryVAE:
    return model_for(gymnasium.make("CartPole-v1"))


def test_rollouts_in_a_plain_environment(cart_pole: TrajectoryVAE):
    envs = gymnasium.make_vec("CartPole-v1", num_envs=3, vectorization_mode="sync")
    episodes = tvae.rollout(envs, Agent(cart_pole, Z), 7, seed=1)
    assert len(episodes) == 7
    assert episodes.final_observed.all()
    for episode in episodes:
        assert len(episode.observations) == len(episode) + 1
        assert set(np.unique(episode.actions)) <= {0.0, 1.0}
        assert episode.steps["reward"].tolist() == [1.0] * len(episode)
        assert episode.steps["terminated"].tolist() == [False] * (len(episode) - 1) + [True]
    starts = np.array([episode.observations[0] for episode in episodes])
    assert len(np.unique(starts, axis=0)) == 7
    assert_same(episodes, tvae.rollout(envs, Agent(cart_pole, Z), 7, seed=1))
    assert episodes.lengths.tolist() != tvae.rollout(envs, Agent(cart_pole, Z), 7, seed=2).lengths.tolist()


def test_recorded_episodes_are_those_of_stepping_by_hand(cart_pole: TrajectoryVAE):
    """The recorded actions, taken one by one in the same world, lead to the recorded observations to the last one."""
    episodes = tvae.rollout(gymnasium.make("CartPole-v1"), Agent(cart_pole, Z), 3, seed=4)
    env = gymnasium.make("CartPole-v1")
    seeds = np.random.SeedSequence(4)
    for episode in episodes:
        world_seed, _ = (int(s.generate_state(1)[0] >> 1) for s in seeds.spawn(2))
        observation, _ = env.reset(seed=world_seed)
        for step, row in enumerate(episode.actions):
            np.testing.assert_allclose(episode.observations[step], observation)
            observation, _, terminated, truncated, _ = env.step(int(row[0]))
            assert (terminated or truncated) == (step == len(episode) - 1)
        np.testing.assert_allclose(episode.observations[-1], observation)


def test_recorded_actions_are_those_that_the_environment_was_given():
    env = Fork()
    model = model_for(env)
    with torch.no_grad():
        model.policy_decoder.head.parameters_of_law.bias.mul_(100)
    episodes = tvae.rollout(env, Agent(model, Z), 4)
    given = np.stack([flatten(env.action_space, action) for action in env.given])
    np.testing.assert_array_equal(np.concatenate([episode.actions for episode in episodes]), given)
    assert episodes.lengths.tolist() == [3, 3, 3, 3]


def test_actions_beyond_the_bounds_are_recorded_as_taken():
    env = Fork()
    env.action_space = gym.Box(-0.1, 0.1, (2,))
    episodes = tvae.rollout(env, Agent(model_for(env), Z), 3)
    assert (np.abs(episodes.actions) <= 0.1 + 1e-8).all()
    assert (np.abs(episodes.actions) == np.float32(0.1)).any()


def test_progress_is_told_and_counts_are_checked(cart_pole: TrajectoryVAE):
    envs = SyncVectorEnv([lambda: gymnasium.make("CartPole-v1")] * 3)
    policy, told = LatentPolicy(cart_pole, Fixed(Z)), []
    rollout(envs, policy, 5, on_step=told.append)
    assert told[-1] == 5
    assert all(before <= after for before, after in pairwise(told))
    with pytest.raises(ValueError, match="num_episodes must be at least 1, got 0"):
        rollout(envs, policy, 0)


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_modes_that_hide_the_final_observation_or_never_restart_are_refused(
    cart_pole: TrajectoryVAE, mode: AutoresetMode
):
    envs = SyncVectorEnv([lambda: gymnasium.make("CartPole-v1")] * 2, autoreset_mode=mode)
    with pytest.raises(ValueError, match="needs the autoreset mode NEXT_STEP"):
        rollout(envs, LatentPolicy(cart_pole, Fixed(Z)), 1)


def test_a_zombie_bot_plays_many_episodes_at_once():
    envs = gymnasium.make_vec("tvae/ZombieAttack-v0", num_envs=40)
    model = untrained(noise([5, 4], observation_space=spaces_of(envs)[0], action_space=spaces_of(envs)[1]))
    episodes = tvae.rollout(envs, Agent(model, Z), 60, seed=3)
    assert len(episodes) == 60
    assert episodes.lengths.max() <= 30
    assert episodes.action_space == model.action_space
    assert_same(episodes, tvae.rollout(envs, Agent(model, Z), 60, seed=3))
