"""What the state decoder says of states further ahead."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from toys import noise, two_styles, untrained
from tvae.data.batches import batch_of
from tvae.fitting.fit import fit
from tvae.model.elbo import elbo, predicted_states, state_log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, whole

LENGTHS, ENDS = [7, 2, 5], [True, True, False]


def test_the_states_ahead_are_those_that_come():
    demonstrations = noise(LENGTHS, ENDS)
    model = untrained(demonstrations, horizon=3)
    batch = batch_of(demonstrations, np.arange(3))
    windows = whole(batch)
    ahead = predicted_states(model, batch, torch.zeros(3, 2), windows).ahead
    assert ahead is not None
    trajectory, _ = windows.counted
    there = trajectory[ahead.known]
    assert torch.bincount(there, minlength=3).tolist() == [5, 0, 2]  # of 8, 3 and 5 states, those from the fourth on
    for index in range(3):
        states = torch.from_numpy(demonstrations[index].observations[3:]).float()
        expected = model.observation_normalizer.values(states)
        torch.testing.assert_close(ahead.values[ahead.known][there == index], expected)


def test_the_term_is_that_of_its_head_alone():
    demonstrations = noise(LENGTHS, ENDS)
    model = untrained(demonstrations, horizon=3)
    batch = batch_of(demonstrations, np.arange(3))
    z = torch.zeros(3, 2)
    state, ahead, stop = state_log_likelihood(model, batch, z, cut(batch.lengths, 4, 1))
    assert model.state_decoder.ahead is not None
    torch.nn.init.zeros_(model.state_decoder.ahead.parameters_of_law.weight)
    again = state_log_likelihood(model, batch, z, cut(batch.lengths, 4, 1))
    torch.testing.assert_close(again[0], state)
    torch.testing.assert_close(again[2], stop)
    assert again[1][0] != ahead[0]
    assert again[1][1] == ahead[1] == 0


def test_a_horizon_of_one_has_no_term():
    demonstrations = noise(LENGTHS, ENDS)
    model = untrained(demonstrations)
    batch = batch_of(demonstrations, np.arange(3))
    assert model.state_decoder.ahead is None
    assert (elbo(model, batch, policy=whole(batch), state=whole(batch)).ahead == 0).all()


def test_where_one_is_in_so_many_steps_is_learnt():
    walks = two_styles(60)
    model = fit(walks, horizon=5, num_steps=150, evaluate_every=50, hidden_features=16, batch_size=32)
    batch = batch_of(walks, np.arange(60))
    with torch.no_grad():
        ahead = predicted_states(model, batch, model.posterior(batch).mean, whole(batch)).ahead
    assert ahead is not None
    error = (ahead.law.mode() - ahead.values)[ahead.known]
    assert error.abs().mean() < 0.2 * ahead.values[ahead.known].std()


def test_a_horizon_is_at_least_one_step():
    walks = two_styles(2)
    with pytest.raises(ValueError, match="horizon must be at least 1 step, got 0"):
        TrajectoryVAE(walks.observation_space, walks.action_space, horizon=0)
