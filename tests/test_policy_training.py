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
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.fitting import trained
from tvae.model.decoding import Fixed
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import drawn, whole
from tvae.train.loop import Observer, TrainingError
from tvae.train.policy import train_policy


@pytest.fixture(scope="module")
def walks() -> Demonstrations:
    return two_styles(60)


def ways(demonstrations: Demonstrations) -> np.ndarray:
    """0 to the left, 1 to the right."""
    return np.array([int(episode.actions.mean() > 0) for episode in demonstrations])


SIDES = [Fixed(np.array([-1.0, 0.0])), Fixed(np.array([1.0, 0.0]))]


def after(walks: Demonstrations, **arguments: Any) -> TrajectoryVAE:
    model, quick = untrained(walks), {"num_steps": 150, "batch_size": 64, "learning_rate": 0.02}
    train_policy(model, walks, SIDES, ways(walks), **{**quick, **arguments})
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


def test_each_episode_needs_a_style(walks: Demonstrations):
    with pytest.raises(ValueError, match="60 episodes need as many styles, got 3"):
        train_policy(untrained(walks), walks, SIDES, np.zeros(3, dtype=np.int64), num_steps=1)


def test_a_likelihood_that_is_not_finite_is_an_error_in_words(walks: Demonstrations):
    with pytest.raises(TrainingError, match=r"step \d+ of the policy: the log-likelihood of an action is"):
        after(walks, learning_rate=1e30)


@pytest.mark.parametrize("window", [1, 2, 3, 50])
def test_a_moment_is_seen_with_the_past_that_a_bot_would_have_there(window: int):
    batch = batch_of(noise([1, 2, 5, 9] * 50), np.arange(200))
    windows = drawn(batch, window)
    assert (windows.valid.sum(1) == 1).all()
    moment = windows.steps[windows.valid]
    assert torch.equal(windows.trajectory, torch.arange(200))
    assert (moment < batch.lengths).all()
    for lengths in (1, 2, 5, 9):
        assert set(moment[batch.lengths == lengths].tolist()) == set(range(lengths))
    before = windows.valid.long().argmax(1)
    assert torch.equal(before, moment.clamp_max(min(window, 9) - 1))
    assert (windows.steps[:, 1:] - windows.steps[:, :-1] >= 0).all()


def test_a_window_without_end_is_the_whole_episode():
    batch = batch_of(noise([2, 5]), np.arange(2))
    assert torch.equal(drawn(batch, None).valid, whole(batch).valid)


def test_a_run_trains_its_policy_on_the_styles_it_found(walks: Demonstrations, tmp_path: Path):
    config = RunConfig(
        model=ModelConfig(hidden_features=8, prior_components=1),
        training=TrainingConfig(num_steps=60, batch_size=8, evaluate_every=30, held_out=0.2),
        policy=PolicyConfig(num_steps=3, batch_size=16),
    )
    told: list[int] = []
    observer = Observer(on_policy_step=lambda step, nats: told.append(step))
    plain, records = trained(
        walks,
        replace(config, policy=PolicyConfig()),
        checkpoint=tmp_path / "plain",
        device="cpu",
        observer=observer,
    )
    assert told == []
    model, again = trained(walks, config, checkpoint=tmp_path / "model", device="cpu", observer=observer)
    assert told == [1, 2, 3]
    assert records == again
    training, _ = walks.split(0.2, seed=0, group=None)
    found = find_playstyles(encode(plain, training), seed=0)
    train_policy(plain, training, found.styles, found.assignment, num_steps=3, batch_size=16)
    resumed, _ = trained(walks, config, checkpoint=tmp_path / "model", device="cpu", observer=Observer())
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, plain.state_dict()[name]), name
        assert torch.equal(tensor, resumed.state_dict()[name]), name
