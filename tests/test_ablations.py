"""What the encoder and the state decoder read: with and without the actions."""

from __future__ import annotations

from dataclasses import asdict, fields, replace

import numpy as np
import pytest
import torch
from torch import Tensor

from toys import noise, untrained
from tvae.config import ModelConfig, RunConfig, TrainingConfig
from tvae.data.batches import TrajectoryBatch, batch_of
from tvae.evaluate.likelihood import importance_weighted_bound
from tvae.model.elbo import log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, whole

DEMONSTRATIONS = noise([5, 3, 6], [True, False, True])


@pytest.fixture(scope="module")
def batch() -> TrajectoryBatch:
    return batch_of(DEMONSTRATIONS, np.arange(3))


@pytest.fixture(scope="module")
def otherwise(batch: TrajectoryBatch) -> TrajectoryBatch:
    """The same states with other actions, the last of each episode only."""
    actions, last = batch.actions.clone(), batch.lengths - 1
    actions[range(3), last] = batch.actions[[2, 0, 1], last[[2, 0, 1]]]
    return replace(batch, actions=actions)


def terms(model: TrajectoryVAE, batch: TrajectoryBatch, window: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
    windows = whole(batch) if window is None else cut(batch.lengths, window, 1)
    with torch.no_grad():
        return log_likelihood(model, batch, torch.zeros(len(batch), model.latent_features), windows)


@pytest.mark.parametrize("encode_actions", [True, False])
def test_posteriors_differ_with_the_actions_only_if_the_encoder_reads_them(
    batch: TrajectoryBatch, otherwise: TrajectoryBatch, encode_actions: bool
):
    model = untrained(DEMONSTRATIONS, encode_actions=encode_actions)
    with torch.no_grad():
        one, other = model.posterior(batch), model.posterior(otherwise)
    for left, right in ((one.mean, other.mean), (one.stddev, other.stddev)):
        assert torch.equal(left, right) == (not encode_actions)


def test_an_encoder_without_actions_still_reads_the_states(batch: TrajectoryBatch):
    model = untrained(DEMONSTRATIONS, encode_actions=False)
    with torch.no_grad():
        means = model.posterior(batch).mean
    assert len(means.unique(dim=0)) == 3


@pytest.mark.parametrize("window", [None, 2])
@pytest.mark.parametrize("dynamics", [True, False])
def test_the_state_and_stop_terms_differ_with_the_recorded_action_only_in_a_dynamics_model(
    batch: TrajectoryBatch, otherwise: TrajectoryBatch, dynamics: bool, window: int | None
):
    model = untrained(DEMONSTRATIONS, dynamics=dynamics)
    (policy, state, stop), (other_policy, other_state, other_stop) = (
        terms(model, part, window) for part in (batch, otherwise)
    )
    assert not torch.isclose(policy, other_policy).any()
    changed = dynamics & batch.next_known[range(3), batch.lengths - 1]  # where nothing follows there is no term
    assert torch.equal(state != other_state, changed)
    assert torch.equal(stop != other_stop, torch.full((3,), dynamics))


def test_a_dynamics_model_knows_no_later_action(batch: TrajectoryBatch, otherwise: TrajectoryBatch):
    """p(s_t+1 | s_1:t, a_1:t, z): the last action of an episode says nothing of what came before it."""
    model = untrained(DEMONSTRATIONS, dynamics=True)
    known = batch.next_known.clone()
    known[range(3), batch.lengths - 1] = False
    _, state, _ = terms(model, replace(batch, next_known=known))
    _, other, _ = terms(model, replace(otherwise, next_known=known))
    assert torch.equal(state, other)


def test_the_bound_of_a_model_without_latent_is_its_likelihood():
    model = untrained(DEMONSTRATIONS, latent_features=0, dynamics=True, encode_actions=False)
    policy, state, stop = terms(model, batch_of(DEMONSTRATIONS, np.arange(3)))
    bound = importance_weighted_bound(model, DEMONSTRATIONS, num_samples=2)
    np.testing.assert_allclose(bound.total, policy + state + stop, rtol=1e-5)
    np.testing.assert_allclose(bound.actions, policy, rtol=1e-5)


def test_the_configuration_knows_every_argument_of_the_model():
    of_a_run = asdict(ModelConfig())
    assert of_a_run == untrained(DEMONSTRATIONS, **of_a_run).arguments
    assert [field.name for field in fields(ModelConfig)] == list(untrained(DEMONSTRATIONS).arguments)


def test_a_configuration_from_before_an_argument_was_added_means_its_default():
    data = RunConfig().to_json()
    for name in ("encode_actions", "dynamics", "events"):
        del data["model"][name]
    for name in ("state_weight", "kl_budget", "start_independence", "swapped_start"):
        del data["training"][name]
    assert RunConfig.from_json(data) == RunConfig()
    chosen = RunConfig(ModelConfig(encode_actions=False, dynamics=True), TrainingConfig(state_weight=0.5))
    assert RunConfig.from_json(chosen.to_json()) == chosen
