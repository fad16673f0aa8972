"""Priors of z."""

import numpy as np
import pytest
import torch
from scipy import stats
from scipy.special import logsumexp
from torch.distributions import Normal

from tvae.device import seeded
from tvae.model.latent import GaussianMixture, Prior, StandardNormal

CPU = torch.device("cpu")


def mixture() -> GaussianMixture:
    with seeded(2, CPU):
        prior = GaussianMixture(2, 3)
    with torch.no_grad():
        prior.logits.copy_(torch.tensor([0.0, 1.0, -1.0]))
        prior.log_scales.copy_(torch.tensor([[0.0, -1.0], [0.5, 0.2], [-0.3, 0.0]]))
    return prior


@pytest.mark.parametrize("prior", [StandardNormal(2), mixture()], ids=["normal", "mixture"])
def test_density_integrates_to_1_and_draws_follow_it(prior: Prior):
    axis = torch.linspace(-9, 9, 181)
    grid = torch.cartesian_prod(axis, axis)
    with torch.no_grad():
        mass = prior.log_prob(grid).exp().reshape(181, 181) * 0.1**2
        with seeded(0, CPU):
            draws = prior.sample(5_000)
    assert mass.sum().item() == pytest.approx(1, abs=1e-4)
    assert draws.shape == (5_000, 2)
    for column in range(2):
        cumulative = mass.sum(1 - column).cumsum(0).numpy()
        assert stats.kstest(draws[:, column], lambda v, c=cumulative: np.interp(v, axis + 0.05, c)).pvalue > 1e-3


def test_mixture_is_that_of_scipy():
    prior, z = mixture(), np.array([0.3, -1.1])
    weights = np.exp(prior.logits.detach().numpy()) / np.exp(prior.logits.detach().numpy()).sum()
    means, scales = prior.means.detach().numpy(), prior.log_scales.exp().detach().numpy()
    parts = [stats.multivariate_normal(m, np.diag(s**2)).logpdf(z) for m, s in zip(means, scales, strict=True)]
    assert prior.log_prob(torch.from_numpy(z).float()).item() == pytest.approx(logsumexp(parts, b=weights), rel=1e-5)


def test_means_of_a_new_mixture_lie_on_a_sphere_apart():
    prior = GaussianMixture(3, 5)
    torch.testing.assert_close(prior.means.norm(dim=-1), torch.full((5,), 2.0))
    assert torch.cdist(prior.means, prior.means)[~torch.eye(5, dtype=torch.bool)].min() > 1e-3


def test_divergence_from_the_normal_is_exact_and_that_from_a_mixture_right_on_average():
    posterior = Normal(torch.tensor([[0.5, -1.0]]), torch.tensor([[0.3, 0.8]]))
    mean, std = posterior.mean.numpy(), posterior.stddev.numpy()
    exact = 0.5 * (mean**2 + std**2 - 1 - np.log(std**2)).sum()
    assert StandardNormal(2).kl(posterior, posterior.mean).item() == pytest.approx(exact, rel=1e-5)
    same = GaussianMixture(2, 2)
    with torch.no_grad():
        same.means.zero_()
        with seeded(0, CPU):
            z = posterior.sample((20_000,))[:, 0]
        wide = Normal(posterior.mean.expand(20_000, -1), posterior.stddev.expand(20_000, -1))
        estimates = same.kl(wide, z)
    assert estimates.mean().item() == pytest.approx(exact, abs=4 * estimates.std().item() / 20_000**0.5)


def test_no_features_cost_nothing():
    prior, nothing = StandardNormal(0), torch.zeros(4, 0)
    assert prior.kl(Normal(nothing, nothing, validate_args=False), nothing).tolist() == [0, 0, 0, 0]
    assert prior.sample(4).shape == (4, 0)
