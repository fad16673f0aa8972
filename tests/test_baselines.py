"""Baselines: one contract for all methods, and what each must be able to learn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.optim.optimizer import register_optimizer_step_post_hook

from toys import ACTIONS, noise, rows, two_styles
from tvae.baselines.act import ActionChunks
from tvae.baselines.bet import BehaviorTransformer, BinTransformer, WindowData, WindowPolicy, middles
from tvae.baselines.chunks import ChunkData, ChunkPolicy, Proposer
from tvae.baselines.cloning import CloningLSTM, CloningMLP
from tvae.baselines.contract import Bots, Envs, Lesson, Method, World
from tvae.baselines.counting import StepCounter
from tvae.baselines.dagger import corrected
from tvae.baselines.descending import Descent
from tvae.baselines.flow import FlowMatching
from tvae.baselines.from_observation import CloningFromObservation, InverseModel
from tvae.baselines.indexed import IndexedCloning
from tvae.baselines.labelled import LabelledCloning
from tvae.baselines.policies import MovingTrunk, positions
from tvae.baselines.posteriors import learn_trajectories
from tvae.baselines.practice import Practice
from tvae.baselines.sectar import SelfConsistentTrajectories, SelfConsistentVAE
from tvae.baselines.senses import Senses
from tvae.baselines.state_vae import StateTrajectoryVAE
from tvae.baselines.stretching import Stretched, read_back
from tvae.data.batches import TrajectoryBatch, batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.normalizer import Normalizer
from tvae.envs.circle import circle_demonstrations
from tvae.envs.navigation import NavigationVectorEnv, navigation_demonstrations
from tvae.envs.zombie import StraightWalk, StraightWalkAttacking, ZombieAttackVectorEnv, zombie_demonstrations
from tvae.errors import TvaeError
from tvae.experiments.benchmark.cells import hyperparameters
from tvae.experiments.benchmark.methods import METHODS, Need, from_extra
from tvae.experiments.benchmark.tasks import TASKS
from tvae.rollouts import Policy, rollout

FEW = {"navigation": navigation_demonstrations, "circle": circle_demonstrations, "zombie": zombie_demonstrations}
STEPS = 4
PLAYED = [(method, task) for method, entry in METHODS.items() for task in entry.tasks if task in FEW]


def made(method: str, task: str = "zombie") -> Method:
    found = METHODS[method].make(task, Path("nowhere"))
    small = {"num_rounds": 2, "num_episodes": 3, "practice": Practice(2, 4, 32, 1, 1, 1)}
    return replace(found, **{name: value for name, value in small.items() if name in hyperparameters(found)})


def lesson(task: str, demonstrations: Demonstrations | None = None, seed: int = 0) -> Lesson:
    return Lesson(demonstrations or FEW[task](24), TASKS[task].world, seed, STEPS)


def watched(world: World, needs: tuple[Need, ...], taken: StepCounter) -> World:
    """The world, in which what is not among the needs is refused, and all steps are counted."""

    def refused(*_: object) -> None:
        raise AssertionError("used without saying so")

    def lessons(label: str, count: int, seed: int) -> tuple[Envs, Policy]:
        envs, demonstrator = world.lessons(label, count, seed)
        return taken.of(envs), demonstrator

    asked = Need.DEMONSTRATORS in needs
    return World(
        envs=(lambda count: taken.of(world.envs(count))) if Need.ENVIRONMENT in needs else refused,
        demonstrators=world.demonstrators if asked else dict.fromkeys(world.demonstrators, refused),
        lessons=lessons if asked else refused,
    )


def actions_of(policy: Policy, task: str) -> np.ndarray:
    envs = TASKS[task].world.envs(5)
    observation_space = FEW[task](4).observation_space
    policy.reset(5, seed=3)
    seen = np.stack([episode.observations[:4] for episode in FEW[task](5, 9)], axis=1)
    assert observation_space.num_columns == seen.shape[-1]
    envs.close()
    return np.stack([policy.act(observations) for observations in seen])


# One contract


@pytest.mark.filterwarnings("ignore::tvae.train.diagnosis.TrainingWarning")
@pytest.mark.parametrize(("method", "task"), PLAYED)
def test_every_method_keeps_the_contract(method: str, task: str):
    entry, taken = METHODS[method], StepCounter()
    first = replace(lesson(task), world=watched(TASKS[task].world, entry.needs, taken))
    steps: list[object] = []
    counting = register_optimizer_step_post_hook(lambda optimizer, *_: steps.append(optimizer))
    bots = made(method, task).learn(first)
    counting.remove()
    assert isinstance(bots, Bots)
    assert set(bots.by_style) in (set(), set(TASKS[task].labels))
    space = first.demonstrations.action_space
    for policy in (bots.at_will, *bots.by_style.values()):
        done = actions_of(policy, task)
        assert done.shape == (4, 5, space.num_columns)
        assert space.first_problem(done.reshape(-1, space.num_columns)) is None
        np.testing.assert_array_equal(actions_of(policy, task), done)  # reset begins anew; randomness is the seed's
    assert (first.steps.count > 0) == (Need.ENVIRONMENT in entry.needs)
    assert first.steps.count == taken.count
    assert len(steps) <= bots.facts.get("gradient_steps", 0) <= STEPS
    assert hyperparameters(made(method, task)) == hyperparameters(made(method, task))


@pytest.mark.filterwarnings("ignore::tvae.train.diagnosis.TrainingWarning")
@pytest.mark.parametrize("method", [name for name, entry in METHODS.items() if Need.DEMONSTRATORS not in entry.needs])
def test_the_same_lesson_gives_the_same_bots_and_labels_teach_only_those_who_say_so(method: str):
    demonstrations = zombie_demonstrations(24)
    done = actions_of(made(method).learn(lesson("zombie", demonstrations)).at_will, "zombie")
    again = actions_of(made(method).learn(lesson("zombie", demonstrations)).at_will, "zombie")
    np.testing.assert_array_equal(done, again)
    shuffled = np.random.default_rng(1).permutation(demonstrations.attribute("label"))
    other = lesson("zombie", demonstrations.with_attributes({"label": shuffled}))
    changed = actions_of(made(method).learn(other).at_will, "zombie")
    assert np.array_equal(done, changed) == (Need.LABELS not in METHODS[method].needs)


@pytest.mark.parametrize(
    "method",
    [
        CloningMLP(),
        CloningLSTM(),
        LabelledCloning(),
        ActionChunks(),
        FlowMatching(),
        BehaviorTransformer(),
        IndexedCloning(),
        StateTrajectoryVAE(),
        SelfConsistentTrajectories(),
    ],
    ids=lambda method: type(method).__name__,
)
def test_every_kind_of_signal_can_be_learnt(method: Method):
    demonstrations = noise([3, 9, 5, 7]).with_attributes({"label": np.array(["a", "b", "a", "b"])})
    bots = method.learn(Lesson(demonstrations, TASKS["zombie"].world, most_steps=2))
    bots.at_will.reset(3, seed=0)
    for observations in np.stack([demonstrations[i].observations[:3] for i in (0, 1, 2)], axis=1):
        assert ACTIONS.first_problem(bots.at_will.act(observations)) is None


# What each must be able to learn


def line(method: Method, **budget: int) -> Bots:
    """Learnt from walks on a line, half to the left and half to the right, in steps of about 1."""
    return replace(method, **budget).learn(Lesson(two_styles(60), TASKS["zombie"].world))


def moves(policy: Policy, count: int = 200) -> np.ndarray:
    policy.reset(count, seed=0)
    return policy.act(np.zeros((count, 1)))[:, 0]


@pytest.mark.parametrize(
    "method",
    [
        LabelledCloning(hidden_features=16, learning_rate=1e-2),
        IndexedCloning(hidden_features=16, learning_rate=2e-2),
        StateTrajectoryVAE(hidden_features=32, learning_rate=5e-3),
        SelfConsistentTrajectories(hidden_features=32, learning_rate=5e-3),
    ],
)
def test_who_can_be_asked_for_a_style_shows_it(method: Method):
    bots = line(method, num_steps=250)
    assert (moves(bots.by_style["left"]) < 0).mean() > 0.9
    assert (moves(bots.by_style["right"]) > 0).mean() > 0.9
    assert 0.3 < (moves(bots.at_will) > 0).mean() < 0.7


def walked(policy: Policy, num_steps: int = 6, count: int = 200) -> np.ndarray:
    """Where walkers are after so many steps from 0."""
    policy.reset(count, seed=0)
    places = np.zeros((count, 1))
    for _ in range(num_steps):
        places = places + policy.act(places)
    return places[:, 0]


@pytest.mark.parametrize(
    ("method", "num_steps"),
    [
        (CloningMLP(hidden_features=32, learning_rate=1e-2), 300),
        (CloningLSTM(hidden_features=16, learning_rate=1e-2), 300),
        (FlowMatching(hidden_features=64, learning_rate=3e-3), 800),
        (BehaviorTransformer(num_bins=8, hidden_features=16, num_heads=2, learning_rate=1e-2), 200),
    ],
)
def test_who_cannot_be_asked_goes_to_both_sides(method: Method, num_steps: int):
    ends = walked(line(method, num_steps=num_steps).at_will)
    assert 0.25 < (ends > 0).mean() < 0.75
    assert (np.abs(np.abs(ends) - 6) < 2.5).mean() > 0.7


def test_chunks_without_a_latent_are_the_average():
    done = moves(line(ActionChunks(num_actions=2), num_steps=300).at_will)
    assert abs(done.mean()) < 0.4
    assert 0.6 < done.std() < 1.4  # one law for both sides: it is wide


def test_a_chunk_is_asked_for_when_the_last_is_used_up():
    class Counting(Proposer):
        senses = Senses.fit(two_styles(4))
        asked = 0

        def propose(self, inputs: torch.Tensor) -> torch.Tensor:
            self.asked += 1
            return torch.full((len(inputs), 3, 1), float(self.asked))

    network = Counting()
    policy = ChunkPolicy(network, num_taken=2)
    policy.reset(2, seed=0)
    values = [policy.act(np.zeros((2, 1))) for _ in range(5)]
    raw = network.senses.actions.raw(torch.tensor([[1.0], [1.0], [2.0], [2.0], [3.0]]))
    np.testing.assert_allclose(np.stack(values)[:, 0], raw.numpy(), rtol=1e-6)


def test_a_trunk_that_sees_the_last_change_sees_it_step_by_step_too():
    trunk = MovingTrunk(3, 2, 8)
    inputs, z = torch.randn(4, 6, 3), torch.randn(4, 2)
    whole, _ = trunk(inputs, z)
    memory, steps = None, []
    for step in range(6):
        features, memory = trunk(inputs[:, step : step + 1], z, memory)
        steps.append(features)
    torch.testing.assert_close(torch.cat(steps, dim=1), whole)
    # the other way through the same states
    assert not torch.allclose(trunk(inputs.flip(1), z)[0].flip(1)[:, 2], whole[:, 2])


def test_behind_the_end_of_an_episode_its_last_action_goes_on():
    demonstrations = two_styles(4)
    data = ChunkData(demonstrations, Senses.fit(demonstrations), num_actions=3)
    chunk = data.at(np.array([0, len(data) - 2]))
    assert chunk.valid.tolist() == [[True, True, True], [True, True, False]]
    assert chunk.actions[1, 2] == chunk.actions[1, 1] != chunk.actions[1, 0]


def bins_of(demonstrations: Demonstrations, num_seen: int) -> BinTransformer:
    senses = Senses.fit(demonstrations)
    stretched = Stretched.fit(demonstrations, senses)
    data = WindowData(demonstrations, senses, num_seen=num_seen)
    network = BinTransformer(
        senses,
        stretched,
        middles(stretched(data.actions), 6, seed=0),
        num_seen=num_seen,
        hidden_features=8,
        num_layers=2,
        num_heads=2,
        dropout=0.0,
    )
    return network.eval()


def test_windows_are_of_one_episode_and_padded_where_it_is_shorter():
    demonstrations = noise([3, 7, 5])
    data = WindowData(demonstrations, Senses.fit(demonstrations), num_seen=5)
    window = data.at(np.arange(len(data)))
    assert window.valid.sum(1).tolist() == [3, 5, 5, 5, 5]  # one, three, one
    values = Senses.fit(demonstrations).actions.values(torch.from_numpy(demonstrations.actions).float())
    torch.testing.assert_close(window.actions[2], values[4:9])


def test_who_sees_a_window_sees_nothing_later_and_acts_on_what_it_was_shown():
    demonstrations = noise([9, 9])
    network = bins_of(demonstrations, num_seen=4)
    inputs = torch.randn(3, 4, 2 * network.senses.num_features)
    logits, offsets = network(inputs)
    later = inputs.clone()
    later[:, 2:] += 1
    torch.testing.assert_close(network(later)[0][:, :2], logits[:, :2])
    torch.testing.assert_close(network(inputs[:, :2])[1], offsets[:, :2])
    window = WindowData(demonstrations, network.senses, num_seen=4).at(np.array([2]))
    shown: list[torch.Tensor] = []
    network.sample = lambda seen: (shown.append(seen), window.actions[:, 0])[1]  # type: ignore[method-assign]
    policy = WindowPolicy(network)
    policy.reset(1, seed=0)
    for row in demonstrations[0].observations[:6]:
        policy.act(row[None])
    assert [seen.shape[1] for seen in shown] == [1, 2, 3, 4, 4, 4]
    torch.testing.assert_close(shown[-1], window.inputs)


def test_the_loss_is_nothing_where_bin_and_offset_are_right():
    demonstrations = two_styles(20)
    network = bins_of(demonstrations, num_seen=3)
    window = WindowData(demonstrations, network.senses, num_seen=3).at(np.arange(4))
    targets = network.stretched(window.actions)
    which = network.nearest(targets)
    right = 50 * torch.nn.functional.one_hot(which, len(network.bins)).float()
    offsets = (targets - network.bins[which])[..., None, :].expand(-1, -1, len(network.bins), -1)
    network.forward = lambda inputs: (right, offsets)  # type: ignore[method-assign]
    assert network.loss(window, 2.0, 10.0).item() == pytest.approx(0, abs=1e-6)
    network.forward = lambda inputs: (0 * right, offsets + 0.5)  # type: ignore[method-assign]
    bins = len(network.bins)
    expected = (1 - 1 / bins) ** 2 * np.log(bins) + 10 * 0.25
    assert network.loss(window, 2.0, 10.0).item() == pytest.approx(expected, rel=1e-5)


def test_states_are_foretold_from_the_first_and_z_alone():
    demonstrations = noise([6, 4])
    model = SelfConsistentVAE(Senses.fit(demonstrations), latent_features=2, hidden_features=8, num_components=1)
    model.calibrate(demonstrations)
    batch = batch_of(demonstrations, np.array([0, 1]))
    z = torch.randn(2, 2)
    first = batch.observations[:, 0]
    law = model.foretold(first, z, 6)
    torch.testing.assert_close(model.foretold(first, z, 3).mode(), law.mode()[:, :3])
    features, _ = model.recurrent(torch.cat([model.policy.senses(first), z], dim=-1)[:, None].expand(-1, 6, -1))
    state = model.policy.senses.observations.values(first)
    for step in range(6):  # each foretold state is where the next change starts
        state = model.next_state(features[:, step], state).mode()
        torch.testing.assert_close(law.mode()[:, step], state, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("warm_up", "weights"), [(0.5, [0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.0, 1.0]), (0.0, [1.0] * 8)])
def test_the_weight_of_kl_rises_in_training_and_is_1_where_weights_are_judged(warm_up: float, weights: list[float]):
    network, told = torch.nn.Linear(1, 1), {True: [], False: []}

    def loss(batch: TrajectoryBatch, kl_weight: float) -> torch.Tensor:
        told[torch.is_grad_enabled()].append(kl_weight)
        return network.weight.square().sum()

    taught = Lesson(two_styles(20), TASKS["zombie"].world, 0, None)
    learn_trajectories(network, loss, taught, Descent(8, 1e-3), warm_up=warm_up)
    assert told[True] == weights
    assert set(told[False]) == {1.0}


def test_small_turns_are_stretched():
    demonstrations = circle_demonstrations(12)
    stretched = Stretched.fit(demonstrations, Senses.fit(demonstrations))
    turns = np.sin(demonstrations.actions[:, 0])
    assert stretched.reach[1].item() == pytest.approx(np.ptp(turns) / 2, rel=1e-4)
    assert stretched.centre[1].item() == pytest.approx((turns.max() + turns.min()) / 2, abs=1e-4)


def test_values_are_read_back_from_their_features():
    values = torch.from_numpy(rows(ACTIONS, 50, np.random.default_rng(0))).float()
    read = read_back(ACTIONS, Normalizer(ACTIONS).features(values))
    torch.testing.assert_close(read, values)


def test_the_inverse_model_sees_where_one_went():
    demonstrations = navigation_demonstrations(6)
    envs = NavigationVectorEnv(20)
    own = rollout(envs, _Wandering(), 20)
    inverse = InverseModel(Senses.fit(demonstrations), 64)
    CloningFromObservation(learning_rate=5e-3)._invert(inverse, own, 400, seed=0)
    with torch.no_grad():
        found = inverse(inverse.inputs(demonstrations)).mode().numpy()
    off = np.abs(np.angle(np.exp(1j * (found - demonstrations.actions))))
    assert np.median(off) < 0.1


class _Wandering:
    def reset(self, num_episodes: int, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def act(self, observations: np.ndarray) -> np.ndarray:
        return self._random.uniform(-np.pi, np.pi, (len(observations), 1))


def test_dagger_keeps_the_learners_states_and_the_demonstrators_actions():
    first = lesson("zombie")
    episodes = corrected(first, "attack", StraightWalk(), 30, seed=4)
    assert {episode.attributes["label"] for episode in episodes} == {"attack"}
    for episode in episodes:
        to_goal = np.diff(episode.observations[:, 0])
        np.testing.assert_allclose(to_goal[:5], -0.5, atol=1e-9)  # the learner walks straight
    attacks = np.array([episode.actions[:, 0].sum() for episode in episodes])
    assert attacks.max() > 1  # it is told again and again, since it never attacks
    assert first.steps.count >= sum(len(episode) for episode in episodes)


# Parts


def test_steps_are_counted_but_not_the_restarts():
    steps = StepCounter()
    episodes = rollout(steps.of(ZombieAttackVectorEnv(40)), StraightWalkAttacking(), 40, seed=1)
    assert set(episodes.lengths.tolist()) == {14}  # the same straight way for all
    assert steps.count == 40 * 14
    rollout(steps.of(NavigationVectorEnv(3)), _Wandering(), 3)
    assert steps.count == 40 * 14 + 300


def test_descent_keeps_the_weights_that_were_judged_best():
    weight = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.zeros_(weight.weight)
    judged: list[float] = []

    def judge() -> float:
        judged.append(weight.weight.item())
        return abs(weight.weight.item() - 0.5)

    descent = Descent(num_steps=60, learning_rate=0.1, evaluate_every=1)
    descent.run(weight, lambda step: (weight.weight - 2).square().sum(), seed=0, judge=judge)
    assert weight.weight.item() == min(judged, key=lambda value: abs(value - 0.5)) != judged[-1]
    with pytest.raises(FloatingPointError, match="step 1"):
        descent.run(weight, lambda step: weight.weight.sum() * float("nan"), seed=0)


def test_nothing_is_held_out_where_nothing_is_to_be():
    training, judged = positions(5, 0.0, seed=0)
    assert (training.tolist(), judged.tolist()) == ([0, 1, 2, 3, 4], [])


def test_a_missing_extra_is_said():
    with pytest.raises(TvaeError, match=r"pip install 'tvae\[gail\]'"):
        from_extra("tvae_has_no_such_module", "GAIL", "gail")("zombie", Path())
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'tvae\.baselines\.gial'"):
        from_extra("tvae.baselines.gial", "GAIL", "gail")("zombie", Path())
