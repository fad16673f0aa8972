"""Scores of steps and signals against the bound, against scipy and against sums over what else could have come."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.stats import norm
from torch.distributions import Bernoulli, Categorical, Normal

from toys import ACTIONS, OBSERVATIONS, ONE, noise, two_styles, untrained
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.distributions import Columns, Joint, Mixture
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.scores import Scores, score, share_as_unlikely
from tvae.evaluate.similarity import distances, nearest, overlap
from tvae.evaluate.unlikeness import unlike_places
from tvae.model.elbo import policy_log_likelihood, state_log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, rolling, whole

LENGTHS = (7, 1, 4, 12, 3)
FINAL = (True, False, True, False, False)


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    return noise(LENGTHS, FINAL)


ARGUMENTS = [
    {},
    {"action_components": 3, "state_components": 2, "window": 3},
    {"events": False, "stop": False, "reactive": False},
    {"dynamics": True, "latent_features": 0},
]


@pytest.mark.parametrize("arguments", ARGUMENTS)
def test_sums_are_the_terms_of_the_bound(demonstrations: Demonstrations, arguments: dict[str, object]) -> None:
    model = untrained(demonstrations, **arguments)
    if model.window is not None:
        model.bot_window = 2
    batch = batch_of(demonstrations, np.arange(len(demonstrations)))
    with torch.no_grad():
        z = model.posterior(batch).mean
        sees = whole(batch) if model.window is None else rolling(batch.lengths, 2)
        policy = policy_log_likelihood(model, batch, z, sees)
        windows = whole(batch) if model.window is None else cut(batch.lengths, 3, 0)
        state, _, stop = state_log_likelihood(model, batch, z, windows)
    scores = score(model, demonstrations, batch_size=2)
    for found, expected in ((scores.policy_term, policy), (scores.state_term, state), (scores.stop_term, stop)):
        np.testing.assert_allclose(found, expected, atol=1e-4, rtol=0)
    everything = (policy + state + stop).numpy() / np.array(LENGTHS)
    np.testing.assert_allclose(scores.per_step, everything, atol=1e-4, rtol=0)
    np.testing.assert_allclose(scores.steps.sum() + scores.events.sum(), (policy + state + stop).sum(), atol=1e-3)


def test_steps_stand_where_they_belong(demonstrations: Demonstrations) -> None:
    model = untrained(demonstrations, window=3)
    model.bot_window = 2
    scores = score(model, demonstrations, batch_size=2)
    assert scores.starts.tolist() == [0, 7, 8, 12, 24]
    unrecorded = np.isnan(scores.state)
    assert np.flatnonzero(unrecorded).tolist() == [7, 23, 26]
    assert np.isnan(scores.observation_signals).all(1).tolist() == unrecorded.tolist()
    assert not np.isnan(scores.action).any()
    for index, (start, length) in enumerate(zip(scores.starts, LENGTHS, strict=True)):
        alone = score(model, demonstrations.select([index]))
        rows = slice(start, start + length)
        np.testing.assert_allclose(scores.action_signals[rows], alone.action_signals, atol=1e-4)
        np.testing.assert_allclose(scores.state[rows], alone.state, atol=1e-4)
        np.testing.assert_allclose(scores.end[rows], alone.end, atol=1e-4)
        np.testing.assert_allclose(scores.events[index], alone.events[0], atol=1e-4)


def test_independent_signals_add_up_and_those_of_a_mixture_do_not(demonstrations: Demonstrations) -> None:
    plain = score(untrained(demonstrations), demonstrations)
    np.testing.assert_allclose(plain.action_signals.sum(1), plain.action, atol=1e-4)
    np.testing.assert_allclose(plain.observation_signals.sum(1), plain.state, atol=1e-4)
    mixed = score(untrained(demonstrations, action_components=3), demonstrations)
    assert np.abs(mixed.action_signals.sum(1) - mixed.action).max() > 1e-3


def test_a_column_of_a_mixture_is_the_row_with_the_other_summed_out() -> None:
    weights = Categorical(probs=torch.tensor([0.3, 0.7], dtype=torch.float64))
    means, scales = torch.tensor([[-1.0], [2.0]]).double(), torch.tensor([[0.5], [1.5]]).double()
    coins = Bernoulli(probs=torch.tensor([[0.1], [0.8]]).double())
    law = Mixture(
        weights, Joint(2, (Columns(torch.tensor([1]), Normal(means, scales)), Columns(torch.tensor([0]), coins)))
    )
    attack, heading = law.log_prob_by_column(torch.tensor([1.0, 0.4]).double()).tolist()

    def row(coin: float, x: float) -> float:
        return law.log_prob(torch.tensor([coin, x]).double()).exp().item()

    assert math.exp(heading) == pytest.approx(row(0, 0.4) + row(1, 0.4))
    assert math.exp(heading) == pytest.approx(0.3 * norm.pdf(0.4, -1, 0.5) + 0.7 * norm.pdf(0.4, 2, 1.5))
    assert math.exp(attack) == pytest.approx(quad(lambda x: row(1, x), -20, 20, points=[-1, 2])[0])


def test_an_event_that_never_occurs_costs_once(demonstrations: Demonstrations) -> None:
    never = dataclasses.replace(demonstrations, actions=np.array(demonstrations.actions))
    never.actions[:, 0] = 0
    model = untrained(demonstrations)
    scores = score(model, never)
    assert scores.events.shape == (5, 1)
    assert (scores.events < -0.1).all()
    np.testing.assert_allclose(scores.action_signals[:, 0], 0, atol=1e-6)
    every_step = score(untrained(demonstrations, events=False), never)
    assert every_step.events.shape == (5, 0)
    assert (every_step.action_signals[:, 0] < -0.01).all()


def test_scoring_changes_nothing_and_tells_its_progress(demonstrations: Demonstrations) -> None:
    model = untrained(demonstrations, dropout=0.5)
    model.train()
    told: list[int] = []
    first = score(model, demonstrations, batch_size=2, on_episodes=told.append)
    assert model.training
    assert told == [2, 4, 5]
    np.testing.assert_array_equal(first.action, score(model, demonstrations, batch_size=2).action)


def test_other_signals_are_refused_with_what_was_needed() -> None:
    model = TrajectoryVAE(OBSERVATIONS, ACTIONS)
    for function in (score, encode):
        with pytest.raises(DataError, match="6 signals against 1"):
            function(model, two_styles(4))
        with pytest.raises(DataError, match=r"actions differ.*4 signals against 1"):
            function(model, noise([3], observation_space=OBSERVATIONS, action_space=ONE))


def test_shares_of_a_reference_are_valid_p_values() -> None:
    random = np.random.default_rng(0)
    shares = np.concatenate(
        [share_as_unlikely(random.normal(size=10), random.normal(size=19)) for _ in range(400)]
    )
    for level in (0.05, 0.25, 0.5):
        assert (shares <= level).mean() == pytest.approx(level, abs=0.03)
    assert share_as_unlikely(np.array([-9.0]), random.normal(size=99)).tolist() == [0.01]


def test_the_usual_value_of_a_signal_is_that_of_recorded_steps() -> None:
    def sessions(action: list[float], state: list[float]) -> Scores:
        steps, rest = np.array(action), np.array(state)
        length, end = np.array([len(steps)]), np.zeros(len(steps))
        return Scores(length, steps, steps[:, None], rest, rest[:, None], end, np.zeros((1, 0)))

    reference = sessions([-5.0] * 4, [-5.0, np.nan, np.nan, np.nan])
    (place,) = unlike_places(sessions([-7.0], [-5.5]), reference, 1)
    assert place.signal == 0
    (place,) = unlike_places(sessions([-7.0], [-9.5]), reference, 1)
    assert place.signal == 1


def test_distance_is_bhattacharyyas() -> None:
    means, scales = np.array([[0.5, -1.0], [1.5, 0.0]]), np.array([[0.3, 1.0], [0.8, 2.0]])
    posteriors = Posteriors(means[[0, 1, 0]], scales[[0, 1, 0]])

    def shared(x: float, axis: int) -> float:
        return math.sqrt(math.prod(norm.pdf(x, means[:, axis], scales[:, axis])))

    expected = math.prod(quad(shared, -20, 20, args=(axis,), limit=200)[0] for axis in range(2))
    found = distances(posteriors, 0)
    assert overlap(found)[1] == pytest.approx(expected)
    assert found[[0, 2]].tolist() == [0.0, 0.0]
    assert distances(posteriors, 1)[0] == pytest.approx(found[1])
    scaled = Posteriors(posteriors.means * [10, 0.1], posteriors.scales * [10, 0.1])
    np.testing.assert_allclose(distances(scaled, 0), found)


def test_a_feature_that_is_not_used_does_not_count() -> None:
    random = np.random.default_rng(1)
    means, scales = random.normal(size=(8, 1)), random.uniform(0.2, 0.5, size=(8, 1))
    with_idle = Posteriors(np.hstack([means, np.zeros((8, 1))]), np.hstack([scales, np.ones((8, 1))]))
    np.testing.assert_allclose(distances(with_idle, 3), distances(Posteriors(means, scales), 3))


def test_nearest_leaves_the_episode_itself_out() -> None:
    twins = Posteriors(np.array([[0.0], [0.0], [3.0]]), np.ones((3, 1)))
    positions, found = nearest(twins, to=1, count=1)
    assert (positions.tolist(), found.tolist()) == ([0], [0.0])
    with pytest.raises(IndexError, match="from 0 to 2, got 3"):
        nearest(twins, to=3, count=1)
    with pytest.raises(ValueError, match="at least 1"):
        nearest(twins, to=0, count=0)
