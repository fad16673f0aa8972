"""A T-VAE whose evidence is known: linear in z, with Gaussian noise.

    z ~ N(0, I),  s_{t+1} = s_t + A s_t + G z + noise,  a_t = C s_t + K z + noise

Given s_1, a trajectory is then Gaussian, and so is z given the trajectory.
"""

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence
from torch.nn.functional import softplus

from toys import noise
from tvae.data.batches import TrajectoryBatch, batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.heads import Head
from tvae.model.elbo import elbo, log_likelihood
from tvae.model.latent import GaussianMixture
from tvae.model.trunks import ReactiveTrunk
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import cut, whole
from tvae.spaces import Continuous, Space

PLANE = Space((Continuous("x"), Continuous("y")))
LATENT = 2
LENGTHS = [6, 1, 4, 6]


@dataclass(frozen=True)
class Linear:
    """mean = matrix [s; d; z] + offset, where nothing depends on the last change d, with independent noise of these
    standard deviations, in standardised units."""

    matrix: np.ndarray
    offset: np.ndarray
    noise: np.ndarray


def make_linear(trunk: ReactiveTrunk, head: Head, random: np.random.Generator, z_gain: np.ndarray) -> Linear:
    """Give the decoder weights that make it exactly linear in [s; d; z], of which its head sees each: no mixing, no
    memory, and no style weighs anything."""
    assert trunk.by_style is not None
    for part in (trunk.recurrent, trunk.mix, trunk.by_style):
        for parameter in part.parameters():
            nn.init.zeros_(parameter)
    number, inputs = len(z_gain), trunk.recurrent.input_size
    matrix = 0.3 * random.normal(size=(number, inputs))
    matrix[:, -LATENT:] = z_gain
    matrix[:, 2:-LATENT] = 0  # neither proportions nor, since windows begin without one, a last change
    offset, spread = random.normal(size=number), random.normal(size=number)
    with torch.no_grad():
        head.parameters_of_law.weight.zero_()
        head.parameters_of_law.weight[:number, -inputs:] = torch.from_numpy(matrix)
        head.parameters_of_law.bias[:number] = torch.from_numpy(offset)
        head.parameters_of_law.bias[number:] = torch.from_numpy(spread)
    unit = head.unit.numpy()
    scale = unit * (head.floor + softplus(torch.from_numpy(spread)).numpy())
    return Linear(unit[:, None] * matrix, unit * offset, scale)


@dataclass(frozen=True)
class World:
    """A linear-Gaussian T-VAE, trajectories, and what is known of them exactly."""

    model: TrajectoryVAE
    batch: TrajectoryBatch
    evidence: Tensor
    """(B,) log p(tau | s_1)"""
    posterior: Normal
    """p(z | tau), batch shape (B, Z)"""


def in_double(batch: TrajectoryBatch) -> TrajectoryBatch:
    numbers = ("observations", "next_observations", "actions")
    return replace(batch, **{name: getattr(batch, name).double() for name in numbers})


def residuals(demonstrations: Demonstrations, index: int, model: TrajectoryVAE, laws: tuple[Linear, Linear]):
    """y, G and noise of one trajectory with y = G z + noise, all standardised."""
    episode = demonstrations[index]
    states = model.observation_normalizer.values(torch.from_numpy(episode.observations)).numpy()
    actions = model.action_normalizer.values(torch.from_numpy(episode.actions)).numpy()
    parts, gains, noises = [], [], []
    before = states[: len(actions)]
    after = states[1:] - before[: len(states) - 1]
    for law, values in zip(laws, (after, actions), strict=True):
        on_state, on_latent = law.matrix[:, :2], law.matrix[:, -LATENT:]
        for present, value in zip(before, values, strict=False):
            parts.append(value - on_state @ present - law.offset)
            gains.append(on_latent)
            noises.append(law.noise)
    return np.concatenate(parts), np.concatenate(gains), np.concatenate(noises)


@pytest.fixture(scope="module")
def world() -> World:
    random = np.random.default_rng(3)
    demonstrations = noise(
        LENGTHS, [True, True, False, True], observation_space=PLANE, action_space=Space((Continuous("a"),))
    )
    model = TrajectoryVAE(
        PLANE, demonstrations.action_space, latent_features=LATENT, hidden_features=8, stop=False, state_floor=0.3
    ).double()
    model.calibrate(demonstrations)
    model.eval()
    state, policy = model.state_decoder, model.policy_decoder
    laws = (
        make_linear(state.trunk, state.head, random, np.array([[0.7, 0.0], [-0.4, 0.0]])),
        make_linear(policy.trunk, policy.head, random, np.array([[0.0, 0.9]])),
    )
    evidence, means, deviations = [], [], []
    for index in range(len(demonstrations)):
        value, gain, spread = residuals(demonstrations, index, model, laws)
        covariance = gain @ gain.T + np.diag(spread**2)
        evidence.append(multivariate_normal(np.zeros(len(value)), covariance).logpdf(value))
        precision = np.eye(LATENT) + gain.T @ np.diag(spread**-2) @ gain
        np.testing.assert_allclose(precision, np.diag(np.diag(precision)))  # so a diagonal posterior is exact
        deviations.append(np.diag(precision) ** -0.5)
        means.append(np.linalg.solve(precision, gain.T @ (value / spread**2)))
    batch = in_double(batch_of(demonstrations, np.arange(len(demonstrations))))
    posterior = Normal(torch.from_numpy(np.stack(means)), torch.from_numpy(np.stack(deviations)))
    return World(model, batch, torch.tensor(evidence), posterior)


def likelihood(world: World, z: Tensor, window: int | None = None) -> Tensor:
    windows = whole(world.batch) if window is None else cut(world.batch.lengths, window, 1)
    policy, state, stop = log_likelihood(world.model, world.batch, z, windows)
    assert (stop == 0).all()
    return policy + state


def expectation(world: World, posterior: Normal) -> Tensor:
    """E_q log p(tau | z), exactly: the average over points with q's mean and covariance, for it is quadratic."""
    away = LATENT**0.5 * torch.eye(LATENT, dtype=torch.float64)
    points = [posterior.mean + sign * step * posterior.stddev for sign in (-1, 1) for step in away]
    return torch.stack([likelihood(world, z) for z in points]).mean(0)


def bound(world: World, posterior: Normal) -> Tensor:
    return expectation(world, posterior) - world.model.prior.kl(posterior, posterior.mean)


@pytest.mark.parametrize("window", [None, 1, 3])
def test_evidence_is_the_same_for_every_z_of_the_exact_posterior(world: World, window: int | None):
    with torch.no_grad():
        for z in world.posterior.sample((20,)):
            ratio = likelihood(world, z, window) + world.model.prior.log_prob(z) - world.posterior.log_prob(z).sum(-1)
            torch.testing.assert_close(ratio, world.evidence, rtol=1e-5, atol=1e-6)


def test_bound_is_the_evidence_at_the_exact_posterior(world: World):
    with torch.no_grad():
        torch.testing.assert_close(bound(world, world.posterior), world.evidence, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("shift", "stretch"), [(0.3, 1.0), (0.0, 1.5), (0.0, 0.5), (-0.2, 0.8), (2.0, 3.0)])
def test_elsewhere_the_bound_falls_short_by_the_divergence_from_the_exact_posterior(
    world: World, shift: float, stretch: float
):
    exact = world.posterior
    other = Normal(exact.mean + shift, exact.stddev * stretch)
    with torch.no_grad():
        gap = world.evidence - bound(world, other)
    assert (gap > 0.01).all()
    torch.testing.assert_close(gap, kl_divergence(other, exact).sum(-1), rtol=1e-5, atol=1e-6)


class Known(nn.Module):
    """An encoder that gives this posterior."""

    def __init__(self, posterior: Normal) -> None:
        super().__init__()
        self.posterior = posterior

    def forward(self, sequence: Tensor, lengths: Tensor, summary: Tensor | None = None) -> Normal:
        return self.posterior


def test_objective_with_a_prior_without_closed_form_is_the_evidence_at_any_sample(world: World):
    same = GaussianMixture(LATENT, 3).double()
    with torch.no_grad():
        same.means.zero_()  # three times N(0, I)
        same.logits.copy_(torch.tensor([0.0, 1.0, -1.0]))
    model = deepcopy(world.model)
    model.encoder, model.prior = Known(world.posterior), same
    for _ in range(10):
        terms = elbo(model, world.batch, policy=whole(world.batch), state=whole(world.batch))
        torch.testing.assert_close(terms.value(), world.evidence, rtol=1e-5, atol=1e-6)


def test_objective_keeps_its_terms_apart(world: World):
    model = deepcopy(world.model)
    model.encoder = Known(world.posterior)
    terms = elbo(model, world.batch, policy=whole(world.batch), state=whole(world.batch))
    unit = Normal(torch.zeros_like(world.posterior.mean), torch.ones_like(world.posterior.mean))
    torch.testing.assert_close(terms.kl, kl_divergence(world.posterior, unit).sum(-1))
    torch.testing.assert_close(terms.value(4.0), terms.policy + terms.state - 4 * terms.kl)
