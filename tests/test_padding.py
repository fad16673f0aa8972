"""Padding, the order of a batch and the cuts into windows change no number that they must not change."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from toys import ACTIONS, OBSERVATIONS, noise, untrained
from tvae.data.batches import TrajectoryBatch, batch_of
from tvae.model.elbo import log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, whole

MODELS = {
    "plain": {},
    "everything": {
        "stop": True,
        "action_components": 3,
        "state_components": 2,
        "prior_components": 2,
        "latent_features": 3,
    },
    "without latent": {"latent_features": 0, "stop": False},
    "with a horizon": {"horizon": 3},
    "a dynamics model": {"encode_actions": False, "dynamics": True},
}
episodes = st.lists(st.tuples(st.integers(1, 7), st.booleans()), min_size=1, max_size=5)


@pytest.fixture(scope="module", params=MODELS)
def model(request: pytest.FixtureRequest) -> TrajectoryVAE:
    return untrained(noise([4, 7, 5]), **MODELS[request.param])


def numbers(model: TrajectoryVAE, batch: TrajectoryBatch) -> dict[str, torch.Tensor]:
    """All that the model says of each trajectory, at z = the mean of its posterior."""
    with torch.no_grad():
        posterior = model.posterior(batch)
        policy, state, stop = log_likelihood(model, batch, posterior.mean, whole(batch))
        kl = model.prior.kl(posterior, posterior.mean)
    return {
        "mean": posterior.mean, "stddev": posterior.stddev, "policy": policy, "state": state, "stop": stop, "kl": kl
    }  # fmt: skip


def assert_equal(left: dict[str, torch.Tensor], right: dict[str, torch.Tensor]) -> None:
    for name, values in left.items():
        torch.testing.assert_close(values, right[name], rtol=1e-5, atol=1e-5, msg=lambda text, n=name: f"{n}: {text}")


@settings(max_examples=30)
@given(episodes=episodes)
def test_a_trajectory_alone_is_what_it_is_in_company(model: TrajectoryVAE, episodes: list[tuple[int, bool]]):
    lengths, final = zip(*episodes, strict=True)
    demonstrations = noise(lengths, final)
    together = numbers(model, batch_of(demonstrations, np.arange(len(lengths))))
    for index in range(len(lengths)):
        alone = numbers(model, batch_of(demonstrations, np.array([index])))
        assert_equal(alone, {name: values[index : index + 1] for name, values in together.items()})


@settings(max_examples=20)
@given(episodes=episodes, data=st.data())
def test_order_of_the_batch_only_permutes(model: TrajectoryVAE, episodes: list[tuple[int, bool]], data: st.DataObject):
    lengths, final = zip(*episodes, strict=True)
    demonstrations = noise(lengths, final)
    order = np.array(data.draw(st.permutations(range(len(lengths)))))
    straight = numbers(model, batch_of(demonstrations, np.arange(len(lengths))))
    assert_equal(
        {name: values[order] for name, values in straight.items()}, numbers(model, batch_of(demonstrations, order))
    )


def with_garbage(batch: TrajectoryBatch) -> TrajectoryBatch:
    """The batch with nonsense wherever nothing was recorded."""
    result = {}
    for name, space, known in (
        ("observations", OBSERVATIONS, batch.mask),
        ("next_observations", OBSERVATIONS, batch.next_known),
        ("actions", ACTIONS, batch.mask),
    ):
        rows = getattr(batch, name).clone()
        garbage = torch.full((space.num_columns,), 1e6)
        garbage[space.categorical] = torch.tensor(space.num_categories, dtype=torch.float32) - 1
        rows[~known] = garbage
        result[name] = rows
    return replace(batch, **result)


@settings(max_examples=20)
@given(episodes=episodes)
def test_content_of_padding_means_nothing(model: TrajectoryVAE, episodes: list[tuple[int, bool]]):
    lengths, final = zip(*episodes, strict=True)
    batch = batch_of(noise(lengths, final), np.arange(len(lengths)))
    assert_equal(numbers(model, batch), numbers(model, with_garbage(batch)))


def test_padding_gets_no_gradient():
    model = untrained(noise([4, 7, 5]), stop=True, dropout=0.0)
    batch = with_garbage(batch_of(noise([7, 2, 1], [True, False, True]), np.arange(3)))
    tracked = replace(batch, observations=batch.observations.requires_grad_(), actions=batch.actions.requires_grad_())
    posterior = model.posterior(tracked)
    windows = cut(batch.lengths, 3, 2)
    policy, state, stop = log_likelihood(model, tracked, posterior.mean, windows)
    (policy + state + stop).sum().backward()
    for rows in (tracked.observations, tracked.actions):
        assert rows.grad.isfinite().all()
        assert (rows.grad[~batch.mask] == 0).all()
        assert (rows.grad[batch.mask] != 0).any()


def test_no_state_term_where_the_next_observation_is_missing():
    model = untrained(noise([4, 7, 5]))
    complete, cropped = noise([5, 3], [True, True]), noise([5, 3], [False, True])
    batch, without = (batch_of(d, np.arange(2)) for d in (complete, cropped))
    assert batch.next_known.tolist() == [[True] * 5, [True] * 3 + [False] * 2]
    assert without.next_known.tolist() == [[True] * 4 + [False], [True] * 3 + [False] * 2]
    only = replace(batch, next_known=without.next_known)
    full, less = numbers(model, batch), numbers(model, only)
    with torch.no_grad():
        values = model.observation_normalizer.values(batch.observations)
        states = model.observation_normalizer.features(values)
        law, _, _ = model.state_decoder(states, values, full["mean"])
        by_step = law.log_prob(model.observation_normalizer.values(batch.next_observations))
    torch.testing.assert_close(full["state"][0] - less["state"][0], by_step[0, 4], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(full["state"][1], less["state"][1])
    torch.testing.assert_close(full["policy"], less["policy"])


def test_an_episode_ends_once_at_its_last_step():
    """With stop log-odds of c throughout, T steps have (T - 1) log(1 - sigmoid(c)) + log(sigmoid(c))."""
    model = untrained(noise([4, 7, 5]), stop=True)
    with torch.no_grad():
        model.state_decoder.stop.weight.zero_()
        model.state_decoder.stop.bias.fill_(-1.5)
    lengths = torch.tensor([4, 1, 6])
    batch = batch_of(noise(lengths.tolist(), [True, False, True]), np.arange(3))
    goes_on, ends = np.log(1 / (1 + np.exp(-1.5))), np.log(1 / (1 + np.exp(1.5)))
    expected = ((lengths - 1) * goes_on + ends).float()
    for windows in (whole(batch), cut(batch.lengths, 2, 1), cut(batch.lengths, 3, 0)):
        _, _, stop = log_likelihood(model, batch, torch.zeros(3, 2), windows)
        torch.testing.assert_close(stop, expected)


@given(
    lengths=st.lists(st.integers(1, 30), min_size=1, max_size=6),
    window=st.integers(1, 40),
    offset=st.integers(0, 39),
)
def test_windows_hold_each_step_once(lengths: list[int], window: int, offset: int):
    offset %= window
    windows = cut(torch.tensor(lengths), window, offset)
    assert windows.steps.shape == windows.valid.shape
    assert windows.steps.shape[1] <= window
    assert windows.valid[:, 0].all()
    seen: dict[int, list[int]] = {index: [] for index in range(len(lengths))}
    for trajectory, steps, valid in zip(windows.trajectory.tolist(), windows.steps, windows.valid, strict=True):
        inside = steps[valid].tolist()
        assert inside == list(range(inside[0], inside[0] + len(inside)))
        assert inside[0] == 0 or inside[0] % window == offset
        seen[trajectory].extend(inside)
    assert seen == {index: list(range(length)) for index, length in enumerate(lengths)}
    assert 0 <= windows.steps.min() <= windows.steps.max() < max(lengths)


@pytest.mark.parametrize("window", [6, 7, 100])
def test_a_window_that_holds_all_is_none(window: int):
    model = untrained(noise([4, 7, 5]), stop=True)
    batch = batch_of(noise([6, 2, 5], [True, False, True]), np.arange(3))
    z = torch.randn(3, 2, generator=torch.Generator().manual_seed(0))
    everything = log_likelihood(model, batch, z, whole(batch))
    for terms, expected in zip(log_likelihood(model, batch, z, cut(batch.lengths, window, 0)), everything, strict=True):
        torch.testing.assert_close(terms, expected, rtol=1e-5, atol=1e-5)


def test_a_window_is_a_trajectory_that_begins_there():
    """What the decoders say in a window is what they say of the piece on its own, at the same z."""
    model = untrained(noise([4, 7, 5]), events=False)  # an event before a window is known in it
    demonstrations = noise([7])
    episode = demonstrations[0]
    z = torch.randn(1, 2, generator=torch.Generator().manual_seed(0))
    pieces = [type(episode)(episode.observations[a : b + 1], episode.actions[a:b]) for a, b in ((0, 2), (2, 5), (5, 7))]
    apart = type(demonstrations).from_trajectories(pieces, OBSERVATIONS, ACTIONS)
    batch, parts = batch_of(demonstrations, np.array([0])), batch_of(apart, np.arange(3))
    in_windows = log_likelihood(model, batch, z, cut(batch.lengths, 3, 2))
    on_their_own = log_likelihood(model, parts, z.expand(3, -1), whole(parts))
    for together, separate in zip(in_windows[:2], on_their_own[:2], strict=True):
        torch.testing.assert_close(together, separate.sum(0, keepdim=True), rtol=1e-5, atol=1e-5)
