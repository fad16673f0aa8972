"""Binary actions as events: their likelihood by brute force, and what a bot remembers of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch.distributions import Bernoulli, Normal

from toys import noise, rows, untrained
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.distributions import Columns, Joint, Mixture
from tvae.generate.closed_loop import LatentPolicy
from tvae.generate.open_loop import imagine
from tvae.model.decoding import EventMemory, Fixed, most_likely, sampled
from tvae.model.elbo import log_likelihood
from tvae.model.events import SURE, Events
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, whole
from tvae.spaces import Binary, Continuous, Space

SEEN = Space((Continuous("x"),))
BUTTONS = Space((Binary("jump"), Continuous("force"), Binary("fire")))


class Foreign:
    """A law of rows that knows no Bernoulli."""

    def log_prob(self, values: torch.Tensor) -> torch.Tensor:
        return values[..., 0]

    def log_prob_by_column(self, values: torch.Tensor) -> torch.Tensor:
        return values

    def sample(self) -> torch.Tensor:
        return torch.zeros(1, 3)

    mode = sample

    def tempered(self, temperature: float) -> Foreign:
        return self


def pressed(lengths: list[int], seed: int = 0) -> Demonstrations:
    return noise(lengths, observation_space=SEEN, action_space=BUTTONS, seed=seed)


def log_odds_of_use(model: TrajectoryVAE, value: float) -> None:
    """Every event occurs in an episode with these log-odds, whatever z."""
    with torch.no_grad():
        assert model.events.share is not None
        assert model.events.by_style is not None
        model.events.share.fill_(value)
        for parameter in model.events.by_style.parameters():
            parameter.zero_()


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("window", [None, 1, 3])
def test_the_likelihood_is_that_of_use_and_hazards(components: int, window: int | None):
    """sum_t log p(a_t), with p(e_t = 1) = 0 for an event that the trajectory does not use, and log p(E | z)."""
    demonstrations = pressed([5, 1, 4])
    demonstrations.actions[demonstrations.action_starts[2] :, 0] = 0  # no jump in the last trajectory
    model = untrained(demonstrations, action_components=components, window=window)
    batch, z = batch_of(demonstrations, np.arange(3)), torch.randn(3, 2, generator=torch.Generator().manual_seed(1))
    windows = whole(batch) if window is None else cut(batch.lengths, window, 0)
    with torch.no_grad():
        found, _, _ = log_likelihood(model, batch, z, windows)
        for index, episode in enumerate(demonstrations):
            events = episode.actions[:, [0, 2]]
            used = events.max(0) > 0
            done = (np.cumsum(events, 0) - events > 0).astype(np.float32)
            seen = torch.from_numpy(episode.observations[: len(episode)]).float()
            inputs = model.policy_decoder_inputs(seen, torch.from_numpy(done))[None]
            pieces = inputs.split(window or len(episode), dim=1)
            expected = 0.0
            actions = model.action_normalizer.values(torch.from_numpy(episode.actions).float())
            step = 0
            for piece in pieces:
                law = model.policy_decoder(piece, z[index : index + 1])
                for at in range(piece.shape[1]):
                    expected += _row(law, (0, at), actions[step], used)
                    step += 1
            share = model.events.occurrence(z[index : index + 1]).parts[0].law.probs[0]
            expected += sum(math.log(p if use else 1 - p) for p, use in zip(share.tolist(), used, strict=True))
            assert found[index].item() == pytest.approx(expected, abs=1e-4)


def _row(law: Joint | Mixture, at: tuple[int, int], action: torch.Tensor, used: np.ndarray) -> float:
    """log p of one action by scalars: Bernoullis of used events, and the normal law of the force."""
    if isinstance(law, Mixture):
        weights = law.weights.probs[at]
        each = [_joint(law.components, (*at, k), action, used) for k in range(len(weights))]
        return math.log(sum(w * math.exp(p) for w, p in zip(weights.tolist(), each, strict=True)))
    return _joint(law, at, action, used)


def _joint(law: Joint, at: tuple[int, ...], action: torch.Tensor, used: np.ndarray) -> float:
    total = 0.0
    for part in law.parts:
        if isinstance(part.law, Bernoulli):
            for column, (p, use) in enumerate(zip(part.law.probs[at].tolist(), used, strict=True)):
                pushed = action[(0, 2)[column]] == 1
                total += math.log(p if pushed else 1 - p) if use else 0.0
        else:
            assert isinstance(part.law, Normal)
            total += Normal(part.law.loc[at], part.law.scale[at]).log_prob(action[[1]]).item()
    return total


def test_without_events_nothing_is_remembered():
    plain = untrained(pressed([5, 4]), events=False)
    assert plain.events.num_events == 0
    assert plain.policy_decoder.trunk.unit.shape[0] == 2  # x, and its logarithm
    law = plain.policy_decoder.law(torch.zeros(3, plain.policy_decoder.trunk.num_features))
    assert plain.events.given(law, torch.zeros(3, 0, dtype=torch.bool)) is law
    assert plain.events.log_prob(torch.zeros(3, 2), torch.zeros(3, 0, dtype=torch.bool)).tolist() == [0, 0, 0]


def test_a_model_without_a_latent_has_shares_of_its_own():
    events = Events(BUTTONS.binary, latent_features=0, hidden_features=4)
    assert events.share is not None
    with torch.no_grad():
        events.share.copy_(torch.tensor([0.0, 2.0]))
    used = torch.tensor([[True, False]])
    expected = math.log(0.5) + math.log(1 - 1 / (1 + math.exp(-2)))
    assert events.log_prob(torch.zeros(1, 0), used).item() == pytest.approx(expected, abs=1e-6)


def test_hazards_of_a_mixture_are_weighed():
    events = Events(BUTTONS.binary, 2, 4)
    weights = torch.distributions.Categorical(probs=torch.tensor([[0.25, 0.75]]))
    part = Columns(torch.tensor([0, 2]), Bernoulli(probs=torch.tensor([[[0.2, 1.0], [0.6, 0.0]]])))
    torch.testing.assert_close(events.hazard(Mixture(weights, Joint(3, (part,)))), torch.tensor([[0.5, 0.25]]))
    with pytest.raises(TypeError, match="joint law or a mixture of them, got Foreign"):
        events.hazard(Foreign())
    with pytest.raises(TypeError, match="joint law or a mixture of them, got Foreign"):
        events.given(Foreign(), torch.zeros(1, 2, dtype=torch.bool))


def law_with(hazard: float, num_copies: int = 1) -> Joint:
    probs = torch.full((num_copies, 2), hazard)
    return Joint(3, (Columns(torch.tensor([0, 2]), Bernoulli(probs=probs)),))


@pytest.mark.parametrize(("hazards", "done"), [([0.95], 1.0), ([0.5], 0.0), ([0.5, 0.5], 0.0), ([0.7, 0.7], 1.0)])
def test_an_event_is_done_when_it_was_due_for_sure(hazards: list[float], done: float):
    model = untrained(pressed([5, 4]))
    memory = EventMemory(model, torch.zeros(1, 2), most_likely)
    for hazard in hazards:
        assert memory.done.tolist() == [[0.0, 0.0]]
        memory.note(law_with(hazard), torch.tensor([[1.0, 3.0, 0.0]]))
    assert memory.done.tolist() == [[done, 0.0]]
    assert SURE == 0.9


@pytest.mark.parametrize("choice", [sampled, most_likely])
@pytest.mark.parametrize("odds", [-60.0, 60.0])
def test_a_bot_uses_an_event_in_an_episode_or_not_at_all(choice, odds: float):
    model = untrained(pressed([6, 6, 6]))
    log_odds_of_use(model, odds)
    with torch.no_grad():
        model.policy_decoder.head.parameters_of_law.bias.fill_(3.0)  # a hazard of 0.95
    policy = LatentPolicy(model, Fixed(np.zeros(2)), choice=choice)
    policy.reset(50, seed=3)
    acted = np.stack([policy.act(rows(SEEN, 50, np.random.default_rng(step))) for step in range(4)])
    assert (acted[..., [0, 2]].max(0) == (odds > 0)).all()
    imagined = imagine(model, np.zeros((20, 1)), np.zeros((20, 2)), num_steps=4, choice=choice)
    assert (imagined.actions[:, [0, 2]].max() > 0) == (odds > 0)


def test_what_a_bot_has_done_reaches_its_policy():
    """The same state before and after an event: another law, though the window holds one state."""
    model = untrained(pressed([6, 6]), window=1)
    log_odds_of_use(model, 60.0)
    with torch.no_grad():
        model.policy_decoder.head.parameters_of_law.bias.fill_(5.0)
    policy = LatentPolicy(model, Fixed(np.zeros(2)), choice=most_likely)
    policy.reset(1, seed=0)
    present = np.array([[1.0]])
    first, second, third = (policy.act(present) for _ in range(3))
    assert first[0, 0] == first[0, 2] == 1
    assert first[0, 1] != second[0, 1]
    assert second[0, 1] == third[0, 1]
