"""Methods that learn by acting: actions as points of a Box, copies for Stable-Baselines3, and learnt rewards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import VecEnv

from toys import ACTIONS, noise, rows
from tvae.baselines.apprenticeship import FeatureMatching
from tvae.baselines.boxes import MOST, BoxActions
from tvae.baselines.contract import AnyOf, Lesson, NoCode
from tvae.baselines.counting import StepCounter
from tvae.baselines.gail import GAIL, Informed
from tvae.baselines.judging import Discriminator, Judging
from tvae.baselines.moments import Moments, Sight
from tvae.baselines.practice import LearntReward, Practice, PracticedPolicy, PracticeGround
from tvae.baselines.state_vae import StateTrajectoryVAE, StateVAE
from tvae.baselines.state_vae_gail import FromPolicy, StateVAEWithGAIL, ToldDiscriminator
from tvae.device import seeded
from tvae.envs.navigation import navigation_demonstrations
from tvae.envs.zombie import ZombieAttackVectorEnv, zombie_demonstrations
from tvae.experiments.benchmark.tasks import TASKS
from tvae.rollouts import rollout

# Actions as points of a Box


def test_actions_of_all_kinds_come_back_from_their_points():
    demonstrations = noise([40, 60])
    box = BoxActions(demonstrations)
    drawn = rows(ACTIONS, 30, np.random.default_rng(1))
    points = box.points(drawn)
    assert points.shape == (30, *(box.space.shape or ())) == (30, 3 + 4)  # a category has a number for each
    assert box.space.contains(points[0].astype(np.float32))
    assert box.choices.tolist() == [0, 2, 3, 4, 5]
    np.testing.assert_allclose(box.raw(points), drawn, atol=1e-9)


def test_points_at_random_give_actions_like_the_demonstrations():
    demonstrations = zombie_demonstrations(200)
    points = np.random.default_rng(0).normal(size=(20_000, 2))
    attack, heading = BoxActions(demonstrations).raw(points).T
    assert attack.mean() == pytest.approx(demonstrations.actions[:, 0].mean(), abs=0.005)
    assert np.angle(np.exp(1j * (heading - demonstrations.actions[:, 1].mean())).mean()) == pytest.approx(0, abs=0.1)
    far = BoxActions(demonstrations).raw(np.full((1, 2), 1e9))
    np.testing.assert_array_equal(far, BoxActions(demonstrations).raw(np.full((1, 2), MOST)))


def test_noise_about_a_leaning_chooses_as_often_as_told():
    demonstrations = noise([40, 60])
    box = BoxActions(demonstrations)
    told = {0: np.array([[0.9, 0.1]]), 2: np.array([[0.1, 0.6, 0.3, 0.0]])}
    row = np.array([[1.0, 0.5, 0.0, 3.0]])
    points = box.leaning(row, told)
    rest = [1, 6]  # what does not choose stays
    np.testing.assert_array_equal(points[:, rest], box.points(row)[:, rest])
    around = points + np.random.default_rng(0).normal(size=(40_000, points.shape[1]))
    done = box.raw(around)
    assert done[:, 0].mean() == pytest.approx(0.1, abs=0.01)
    often = np.bincount(done[:, 2].astype(int), minlength=4) / len(done)
    np.testing.assert_allclose(often, told[2][0], atol=0.05)


# Copies for Stable-Baselines3


class Counting(LearntReward):
    """1 for each moment."""

    def __init__(self) -> None:
        self.improved: list[Moments] = []

    def of(self, moments: Moments) -> torch.Tensor:
        return torch.ones(len(moments))

    def improve(self, own: Moments, num_steps: int) -> None:
        self.improved.append(own)


def test_a_restart_is_no_moment_and_not_rewarded():
    sight, steps = Sight(zombie_demonstrations(10)), StepCounter()
    envs = steps.of(ZombieAttackVectorEnv(8))
    ground = PracticeGround(envs, sight, AnyOf(np.eye(3)), Counting(), seed=0)
    assert isinstance(ground, VecEnv)
    first = ground.reset()
    assert first.shape == (8, *(ground.observation_space.shape or ())) == (8, sight.num_state_features + 3)
    points = sight.box.points(np.tile([0.0, np.pi / 4], (8, 1))).astype(np.float32)  # straight to the goal, in 14 steps
    rewards, ended, codes = [], [], [first[:, -3:]]
    for _ in range(40):
        observed, reward, done, _ = ground.step(points)
        rewards.append(reward)
        ended.append(done)
        codes.append(observed[:, -3:])
    expected = np.ones(40)
    expected[[14, 29]] = 0
    np.testing.assert_array_equal(rewards, np.tile(expected[:, None], 8))
    assert np.flatnonzero(np.all(ended, axis=1)).tolist() == [13, 28]
    for begin, end in ((0, 14), (15, 29), (30, 40)):
        assert (np.stack(codes[begin:end]) == codes[begin]).all()
        assert (codes[begin].sum(1) == 1).all()
    assert (codes[15] != codes[0]).any()
    assert steps.count == len(ground.taken()) == 8 * 38


def test_copies_have_nothing_to_show_or_to_change():
    ground = PracticeGround(ZombieAttackVectorEnv(2), Sight(zombie_demonstrations(4)), NoCode(), Counting(), seed=0)
    assert ground.get_attr("render_mode") == [None, None]
    assert ground.env_is_wrapped(object) == [False, False]
    for refused in (
        lambda: ground.get_attr("speed"),
        lambda: ground.set_attr("speed", 1),
        lambda: ground.env_method("jump"),
    ):
        with pytest.raises(AttributeError, match="copies"):
            refused()


def test_a_policy_sees_what_it_saw_in_practice():
    demonstrations = zombie_demonstrations(10)
    lesson, sight, codes = Lesson(demonstrations, TASKS["zombie"].world), Sight(demonstrations), AnyOf(np.eye(2))
    network = Practice(1, 4, 8, 1, 1, 1).learn(lesson, sight, codes, Counting())
    seen: list[torch.Tensor] = []
    watched = network.get_distribution
    network.get_distribution = lambda given: (seen.append(given), watched(given))[1]  # type: ignore[method-assign]
    rollout(ZombieAttackVectorEnv(5), PracticedPolicy(network, sight, codes), 5, seed=2)
    states = torch.stack(seen)[:, :, :-2]
    assert (states[0, :, sight.senses.num_features :] == 0).all()  # no last change yet
    again = sight.state(states[1, :, : sight.senses.num_features], states[0, :, : sight.senses.num_features])
    torch.testing.assert_close(states[1], again)


# Practice


class Rightwards(Counting):
    """The change in x."""

    def __init__(self, sight: Sight) -> None:
        super().__init__()
        self.column = sight.senses.num_features

    def of(self, moments: Moments) -> torch.Tensor:
        return moments.states[:, self.column]


def test_practice_finds_what_is_rewarded():
    lesson = Lesson(navigation_demonstrations(30), TASKS["navigation"].world)
    sight = Sight(lesson.demonstrations)
    reward = Rightwards(sight)
    practice = Practice(12, 16, 32, 4, 4, 3, learning_rate=5e-3, log_std=0.0)
    before = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    policy = PracticedPolicy(practice.learn(lesson, sight, NoCode(), reward), sight, NoCode())
    assert torch.equal(torch.get_rng_state(), before[0])
    np.testing.assert_array_equal(np.random.get_state()[1], before[1])  # noqa: NPY002
    assert len(reward.improved) == 12
    assert sum(map(len, reward.improved)) == lesson.steps.count
    ends = [episode.observations[-1, 0] for episode in rollout(lesson.world.envs(20), policy, 20)]
    assert np.mean(ends) > 60


def test_a_budget_takes_rounds_away():
    demonstrations = zombie_demonstrations(4)
    practice = Practice(10, 4, 8, 2, 4, 3)
    assert practice.gradient_steps == 10 * (2 * 4 + 3)
    for most, steps in ((None, 110), (1000, 110), (40, 33), (11, 11), (10, 2)):
        within = practice.within(Lesson(demonstrations, TASKS["zombie"].world, most_steps=most))
        assert within.gradient_steps == steps
    with pytest.raises(ValueError, match="4 copies of 8 steps cannot be split into 5 batches"):
        replace(practice, num_batches=5)


# Rewards


def beside(moments: Moments, codes: torch.Tensor) -> Moments:
    """Moments whose actions tell the code: a unit above or below those demonstrated."""
    return Moments(moments.states, moments.actions + 2 * codes[:, :1] - 1, codes)


def own_of(sight: Sight, count: int = 1000) -> Moments:
    return beside(sight.drawn(count), torch.eye(2)[torch.arange(count) % 2])


@pytest.mark.parametrize("kind", ["discriminator", "features"])
def test_demonstrated_moments_are_rewarded_above_others(kind: str):
    sight = Sight(navigation_demonstrations(30))
    with seeded(0, torch.device("cpu")):
        made = {
            "discriminator": lambda: Discriminator(sight, Judging(batch_size=128, learning_rate=1e-2)),
            "features": lambda: FeatureMatching(sight, 256, 0.1),
        }
        reward, own = made[kind](), own_of(sight)
        reward.improve(own, 40)
    theirs = reward.of(sight.demonstrated)
    assert theirs.shape == (len(sight.demonstrated),)
    assert theirs.mean() > reward.of(own).mean() + 0.05


def test_a_code_that_can_be_told_is_rewarded_and_found_in_demonstrations():
    sight = Sight(navigation_demonstrations(30))
    with seeded(0, torch.device("cpu")):
        reward = Informed(Discriminator(sight, Judging(batch_size=128, learning_rate=1e-2)), 2, 1.0)
        own = own_of(sight)
        reward.improve(own, 80)
    swapped = Moments(own.states, own.actions, 1 - own.codes)
    assert reward.of(own).mean() > reward.of(swapped).mean() + 0.5
    told = reward.codes()
    assert told.shape == (30, 2)
    np.testing.assert_array_equal(told.sum(1), 1)
    reward.posterior[-1].bias.data += torch.tensor([100.0, 0.0])
    np.testing.assert_array_equal(reward.codes(), np.tile([1, 0], (30, 1)))


def test_long_demonstrations_are_drawn_as_often_as_short_ones():
    sight = Sight(noise([2, 200]))
    with seeded(0, torch.device("cpu")):
        drawn = sight.drawn(4000)
    short = (drawn.states[:, None] == sight.demonstrated.states[:2]).all(-1).any(-1)
    assert short.float().mean() == pytest.approx(0.5, abs=0.05)


def test_gail_counts_what_it_learns():
    lesson = Lesson(zombie_demonstrations(10), TASKS["zombie"].world)
    facts = GAIL(Practice(2, 4, 8, 1, 2, 3)).learn(lesson).facts
    assert facts["gradient_steps"] == 2 * (2 + 3)
    assert 0 < lesson.steps.count <= 2 * 4 * 8


# Both stages of Wang et al.


def staged(lesson: Lesson) -> tuple[StateVAEWithGAIL, StateVAE, Sight]:
    method = StateVAEWithGAIL(
        StateTrajectoryVAE(hidden_features=16, num_steps=3), Practice(2, 4, 8, 1, 2, 3), Judging(batch_size=32)
    )
    return method, method.first.fit(lesson), Sight(lesson.demonstrations)


def test_the_second_stage_starts_where_the_first_one_ended():
    lesson = Lesson(zombie_demonstrations(12), TASKS["zombie"].world)
    _, model, sight = staged(lesson)
    start = FromPolicy(model.policy, sight)
    episode = lesson.demonstrations[0]
    features = sight.senses(torch.from_numpy(episode.observations[:3]).float())
    codes = torch.randn(1, 8)
    law, _ = model.policy(torch.from_numpy(episode.observations[None, :3]).float(), codes)
    yes = torch.ones(1, 3, 2)
    for step, before in ((0, 0), (1, 0), (2, 1)):
        points = start.points(sight.state(features[step : step + 1], features[before : before + 1]), codes)
        heading = sight.box.raw(points)[0, 1]
        assert heading == pytest.approx(law.mode()[0, step, 1].item(), abs=1e-4)
        around = points + np.random.default_rng(0).normal(size=(20_000, 2))
        expected = law.log_prob_by_column(yes)[0, step, 0].exp().item()
        assert sight.box.raw(around)[:, 0].mean() == pytest.approx(expected, abs=0.02)


def test_the_discriminator_is_told_whose_code_it_is():
    demonstrations = navigation_demonstrations(30)
    sight = Sight(demonstrations)
    codes = np.eye(3)[np.unique(demonstrations.attribute("label"), return_inverse=True)[1]]
    with seeded(0, torch.device("cpu")):
        reward = ToldDiscriminator(sight, codes, Judging(batch_size=128, learning_rate=1e-2))
        right = sight.told(codes).demonstrated
        own = Moments(sight.demonstrated.states, sight.demonstrated.actions, right.codes.roll(1, -1))
        reward.improve(own, 60)
    theirs = Moments(own.states, own.actions, right.codes)
    assert reward.of(theirs).mean() > reward.of(own).mean() + 0.05
    assert sight.demonstrated.codes.shape == (len(sight.demonstrated), 0)  # itself told nothing


def test_both_stages_are_counted_and_acted_on():
    lesson = Lesson(zombie_demonstrations(12), TASKS["zombie"].world)
    method, _, _ = staged(lesson)
    bots = method.learn(lesson)
    assert bots.facts["gradient_steps"] == 3 + 2 * (2 + 3)
    assert 0 < lesson.steps.count <= 2 * 4 * 8
    assert set(bots.by_style) == {"attack", "avoid"}
