"""The policy alone, trained on z of styles as its bots get them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from toys import noise, two_styles, untrained
from tvae.config import ModelConfig, PolicyConfig, RunConfig, TrainingConfig
from tvae.data.arrays import from_arrays
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.fitting import trained
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import Fixed
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import drawn, whole
from tvae.spaces import Binary, Continuous, Space
from tvae.train.latents import OfStyles
from tvae.train.loop import TrainingError
from tvae.train.observer import Observer
from tvae.train.policy import Lessons, log_likelihoods, train_policy


@pytest.fixture(scope="module")
def walks() -> Demonstrations:
    return two_styles(60)


def ways(demonstrations: Demonstrations) -> np.ndarray:
    """0 to the left, 1 to the right."""
    return np.array([int(episode.actions.mean() > 0) for episode in demonstrations])


SIDES = [Fixed(np.array([-1.0, 0.0])), Fixed(np.array([1.0, 0.0]))]


def after(walks: Demonstrations, **arguments: Any) -> TrajectoryVAE:
    model, quick = untrained(walks), {"num_steps": 150, "batch_size": 64, "learning_rate": 0.02}
    train_policy(model, Lessons(walks, OfStyles(SIDES, ways(walks))), **{**quick, **arguments})
    return model


def test_a_style_of_z_does_what_its_episodes_did_and_nothing_else_of_the_model_changes(walks: Demonstrations):
    before, model = untrained(walks).state_dict(), after(walks)
    for name, tensor in model.state_dict().items():
        learnt = name.startswith("policy_decoder.") and not name.endswith("unit")
        assert torch.equal(tensor, before[name]) != learnt, name
    assert not model.policy_decoder.training
    batch = batch_of(walks, np.arange(len(walks)))
    inputs = model.policy_decoder_inputs(batch.observations[:, :1], batch.observations.new_zeros(len(walks), 1, 0))
    for side, way in enumerate((-1, 1)):
        z = torch.tensor(SIDES[side].z, dtype=torch.float32).expand(len(walks), -1)
        with torch.no_grad():
            law = model.policy_decoder(inputs, z)
        assert (model.action_normalizer.raw(law.mode()) * way > 0).all()


def test_the_same_seed_gives_the_same_policy_and_leaves_the_randomness_of_others_alone(walks: Demonstrations):
    torch.manual_seed(3)
    expected = torch.rand(3)
    torch.manual_seed(3)
    first = after(walks, num_steps=5)
    assert torch.equal(torch.rand(3), expected)
    second, third = after(walks, num_steps=5), after(walks, num_steps=5, seed=1)
    weights = [list(model.policy_decoder.parameters()) for model in (first, second, third)]
    assert all(torch.equal(a, b) for a, b in zip(weights[0], weights[1], strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(weights[0], weights[2], strict=True))


def test_every_step_is_in_training_mode_also_after_held_out_actions_were_judged(walks: Demonstrations):
    """Otherwise nothing is dropped, and cuDNN's nets give no gradient at all."""
    model, modes = untrained(walks), []
    model.policy_decoder.register_forward_pre_hook(
        lambda decoder, inputs: modes.append((torch.is_grad_enabled(), decoder.training))
    )
    lessons = Lessons(walks, OfStyles(SIDES, ways(walks)))
    train_policy(model.eval(), lessons, lessons, num_steps=20, batch_size=64)
    assert set(modes) == {(True, True), (False, False)}


def test_steps_and_likelihoods_are_told(walks: Demonstrations):
    told: dict[int, float] = {}
    after(walks, on_step=told.__setitem__)
    assert list(told) == list(range(1, 151))
    assert told[150] > told[1] + 0.3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_steps": 0}, "num_steps must be at least 1, got 0"),
        ({"batch_size": 0}, "batch_size must be at least 1, got 0"),
    ],
)
def test_counts_below_1_are_refused(walks: Demonstrations, arguments: dict[str, int], message: str):
    with pytest.raises(ValueError, match=message):
        after(walks, **arguments)


def test_each_episode_needs_a_latent(walks: Demonstrations):
    with pytest.raises(ValueError, match="60 episodes need as many latents, got 3"):
        Lessons(walks, OfStyles(SIDES, np.zeros(3, dtype=np.int64)))


def test_a_likelihood_that_is_not_finite_is_an_error_in_words(walks: Demonstrations):
    with pytest.raises(TrainingError, match=r"step \d+ of the policy: the log-likelihood of an action is"):
        after(walks, learning_rate=1e30)


@pytest.mark.parametrize("window", [1, 2, 3, 50])
def test_a_moment_is_seen_with_the_past_that_a_bot_would_have_there(window: int):
    batch = batch_of(noise([1, 2, 5, 9] * 25), np.arange(100))
    windows = drawn(batch, window, 3)
    assert (windows.valid.sum(1) == 1).all()
    moment = windows.steps[windows.valid]
    assert windows.trajectory.bincount().tolist() == [3] * 100
    lengths = batch.lengths[windows.trajectory]
    assert (moment < lengths).all()
    for length in (1, 2, 5, 9):
        assert set(moment[lengths == length].tolist()) == set(range(length))
    before = windows.valid.long().argmax(1)
    assert torch.equal(before, moment.clamp_max(min(window, 9) - 1))
    assert (windows.steps[:, 1:] - windows.steps[:, :-1] >= 0).all()


def test_a_window_without_end_is_the_whole_episode():
    batch = batch_of(noise([2, 5]), np.arange(2))
    assert torch.equal(drawn(batch, None, 3).valid, whole(batch).valid)


def test_a_model_without_windows_learns_from_whole_episodes(walks: Demonstrations):
    told: dict[int, float] = {}
    model = untrained(walks, window=None)
    lessons = Lessons(walks, OfStyles(SIDES, ways(walks)))
    train_policy(model, lessons, num_steps=100, batch_size=64, learning_rate=0.02, on_step=told.__setitem__)
    assert told[100] > told[1] + 0.3


@pytest.mark.parametrize("window", [None, 3])
def test_each_step_of_the_demonstrations_and_each_episode_s_events_count_once(window: int | None):
    press, x = Space((Continuous("u"), Binary("press"))), Space((Continuous("x"),))
    random = np.random.default_rng(0)

    def episode(length: int, force: float, pressed: bool) -> Trajectory:
        actions = np.column_stack([force + 0.1 * random.normal(size=length), np.zeros(length)])
        actions[random.integers(length), 1] = pressed
        return Trajectory(np.zeros((length + 1, 1)), actions)

    episodes = [episode(40, 1.0, True) for _ in range(10)] + [episode(4, -1.0, False) for _ in range(30)]
    walks = Demonstrations.from_trajectories(episodes, x, press)
    model = untrained(walks, latent_features=0, window=window)
    lessons = Lessons(walks, OfStyles([Fixed(np.zeros(0))], np.zeros(40, dtype=np.int64)))
    train_policy(model, lessons, num_steps=400, batch_size=256, learning_rate=0.02, weight_decay=0.0)
    with torch.no_grad():
        assert model.events.probability(torch.zeros(1, 0)).item() == pytest.approx(0.25, abs=0.05)
    if window is None:  # one that is bounded does not tell how long an episode has lasted
        bot = LatentPolicy(model, Fixed(np.zeros(0)))
        bot.reset(4_000, 0)
        assert (bot.act(np.zeros((4_000, 1)))[:, 0] > 0).mean() == pytest.approx(0.25, abs=0.1)


def test_held_out_actions_that_cannot_be_are_an_error_in_words(walks: Demonstrations):
    actions = walks.actions.copy()
    actions[3] = np.finfo(np.float32).max
    held_out = Lessons(replace(walks, actions=actions), OfStyles(SIDES, ways(walks)))
    with pytest.raises(TrainingError, match="the log-likelihood of a held-out episode's actions is -inf"):
        train_policy(untrained(walks), Lessons(walks, OfStyles(SIDES, ways(walks))), held_out, num_steps=5)


def test_of_what_was_learnt_what_makes_held_out_actions_most_likely_is_kept(walks: Demonstrations):
    other = two_styles(20, seed=1)
    lessons, held_out = (Lessons(some, OfStyles(SIDES, ways(some))) for some in (walks, other))
    model = untrained(walks)
    train_policy(model, lessons, held_out, num_steps=150, batch_size=64, learning_rate=0.02)
    learnt = log_likelihoods(model, held_out).mean()
    assert learnt > log_likelihoods(untrained(walks), held_out).mean() + 3
    train_policy(model, lessons, held_out, num_steps=20, batch_size=64, learning_rate=3.0)
    assert log_likelihoods(model, held_out).mean() >= learnt


def test_the_likelihood_of_an_episode_is_that_of_its_own_z(walks: Demonstrations):
    model, z = after(walks), np.where(ways(walks)[:, None] == 0, [[-1.0, 0.0]], [[1.0, 0.0]])
    own = log_likelihoods(model, Lessons(walks, Posteriors(z, np.full_like(z, 1e-9))))
    assert own == pytest.approx(log_likelihoods(model, Lessons(walks, OfStyles(SIDES, ways(walks)))), abs=1e-3)
    other = log_likelihoods(model, Lessons(walks, Posteriors(-z, np.full_like(z, 1e-9))))
    assert (own > other + 3).all()


QUICK = RunConfig(
    model=ModelConfig(hidden_features=8, prior_components=1),
    training=TrainingConfig(num_steps=60, batch_size=8, evaluate_every=30, held_out=0.2),
    policy=PolicyConfig(num_steps=3, batch_size=16),
)


def test_a_run_trains_its_policy_on_the_styles_it_found(walks: Demonstrations, tmp_path: Path):
    steps: list[int] = []
    notes: list[str] = []
    observer = Observer(on_policy_step=lambda step, nats: steps.append(step), on_note=notes.append)
    plain, records = trained(
        walks,
        replace(QUICK, policy=PolicyConfig(num_steps=0)),
        checkpoint=tmp_path / "plain",
        device="cpu",
        observer=observer,
    )
    assert (steps, notes) == ([], [])
    model, again = trained(walks, QUICK, checkpoint=tmp_path / "model", device="cpu", observer=observer)
    assert steps == [1, 2, 3]
    (note,) = notes
    assert note.startswith("the policy learns further from z of any episode of a style")
    assert records == again
    training, held_out = walks.split(0.2, seed=0, group=None)
    found = find_playstyles(encode(plain, training), seed=0)
    assigned, _ = found.assign(encode(plain, held_out))
    train_policy(
        plain,
        Lessons(training, OfStyles(found.styles, found.assignment)),
        Lessons(held_out, OfStyles(found.styles, assigned)),
        num_steps=3,
        batch_size=16,
    )
    resumed, _ = trained(walks, QUICK, checkpoint=tmp_path / "model", device="cpu", observer=Observer())
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, plain.state_dict()[name]), name
        assert torch.equal(tensor, resumed.state_dict()[name]), name


def levels(count: int) -> Demonstrations:
    """Each episode with an action of its own, held from its first step to its last; observations tell nothing."""
    random = np.random.default_rng(0)
    actions = [level + 0.05 * random.normal(size=(10, 1)) for level in random.uniform(-1, 1, count)]
    return from_arrays([random.normal(size=(11, 1)) for _ in actions], actions)


def test_where_z_holds_more_than_a_style_of_how_to_act_the_policy_is_told_that_of_each_episode(tmp_path: Path):
    held = levels(100)
    training = replace(QUICK.training, num_steps=300, learning_rate=0.02)
    config = replace(QUICK, training=training, policy=PolicyConfig(num_steps=100, batch_size=64))
    notes: list[str] = []
    model, _ = trained(
        held, config, checkpoint=tmp_path / "model", device="cpu", observer=Observer(on_note=notes.append)
    )
    (note,) = notes
    assert note.startswith("the policy learns further from z of each episode itself")
    posteriors = encode(model, held)
    mine = log_likelihoods(model, Lessons(held, posteriors)).mean()
    others = np.roll(posteriors.means, 1, axis=0)
    assert mine > log_likelihoods(model, Lessons(held, Posteriors(others, posteriors.scales))).mean() + 5


def test_a_model_without_a_latent_learns_too(walks: Demonstrations, tmp_path: Path):
    config = replace(QUICK, model=replace(QUICK.model, latent_features=0))
    steps: list[int] = []
    observer = Observer(on_policy_step=lambda step, nats: steps.append(step))
    trained(walks, config, checkpoint=tmp_path / "model", device="cpu", observer=observer)
    assert steps == [1, 2, 3]
