"""Priors p(z) and the posterior's divergence from them.

A prior is an object with `kl`, `log_prob`, `sample`, and `component`, the one of its Gaussians that a z most likely
belongs to:

- `StandardNormal`: N(0, I), the paper's; the divergence is exact;
- `GaussianMixture`: sum_k w_k N(m_k, diag s_k^2) with learned w, m, s; the divergence is estimated at the sample
  that the objective uses anyway, log q(z | tau) - log p(z).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.distributions import Categorical, Independent, MixtureSameFamily, Normal, kl_divergence


class Prior(nn.Module, ABC):
    """p(z) over Z latent features."""

    def __init__(self, latent_features: int) -> None:
        super().__init__()
        self.latent_features = latent_features

    @abstractmethod
    def log_prob(self, z: Float[Tensor, "*batch Z"]) -> Float[Tensor, "*batch"]:
        """log p(z) in nats."""

    @abstractmethod
    def sample(self, count: int) -> Float[Tensor, "{count} Z"]:
        """`count` draws."""

    @abstractmethod
    def kl(self, posterior: Normal, z: Float[Tensor, "B Z"]) -> Float[Tensor, " B"]:
        """KL(q(z | tau) || p(z)) of each trajectory, in nats; `z` is a draw from the posterior."""

    @abstractmethod
    def component(self, z: Float[Tensor, "*batch Z"]) -> Int[Tensor, "*batch"]:
        """argmax_k p(k | z) of the Gaussian, counted from 0, that each z most likely belongs to."""


class StandardNormal(Prior):
    """N(0, I).

    >>> prior = StandardNormal(2)
    >>> prior.kl(Normal(torch.zeros(1, 2), torch.ones(1, 2)), torch.zeros(1, 2)).tolist()
    [0.0]
    """

    _origin: Tensor

    def __init__(self, latent_features: int) -> None:
        super().__init__(latent_features)
        self.register_buffer("_origin", torch.zeros(latent_features), persistent=False)

    def log_prob(self, z: Float[Tensor, "*batch Z"]) -> Float[Tensor, "*batch"]:
        return -0.5 * (z.square() + math.log(2 * math.pi)).sum(-1)

    def sample(self, count: int) -> Float[Tensor, "{count} Z"]:
        return torch.randn_like(self._origin.expand(count, -1))

    def kl(self, posterior: Normal, z: Float[Tensor, "B Z"]) -> Float[Tensor, " B"]:
        unit = Normal(torch.zeros_like(posterior.mean), torch.ones_like(posterior.mean), validate_args=False)
        return kl_divergence(posterior, unit).sum(-1)

    def component(self, z: Float[Tensor, "*batch Z"]) -> Int[Tensor, "*batch"]:
        return torch.zeros(z.shape[:-1], dtype=torch.int64, device=z.device)


class GaussianMixture(Prior):
    """sum_k w_k N(m_k, diag s_k^2), learned with the model.

    The means begin on a sphere of radius 2 so that the components differ from the first step on.
    """

    def __init__(self, latent_features: int, num_components: int) -> None:
        super().__init__(latent_features)
        self.num_components = num_components
        self.logits = nn.Parameter(torch.zeros(num_components))
        directions = torch.randn(num_components, latent_features)
        self.means = nn.Parameter(2 * directions / directions.norm(dim=-1, keepdim=True).clamp_min(1e-6))
        self.log_scales = nn.Parameter(torch.zeros(num_components, latent_features))

    def _law(self) -> MixtureSameFamily:
        parts = Independent(Normal(self.means, self.log_scales.exp(), validate_args=False), 1, validate_args=False)
        weights = Categorical(logits=self.logits, validate_args=False)
        return MixtureSameFamily(weights, parts, validate_args=False)

    def log_prob(self, z: Float[Tensor, "*batch Z"]) -> Float[Tensor, "*batch"]:
        result: Tensor = self._law().log_prob(z)
        return result

    def sample(self, count: int) -> Float[Tensor, "{count} Z"]:
        result: Tensor = self._law().sample((count,))
        return result

    def kl(self, posterior: Normal, z: Float[Tensor, "B Z"]) -> Float[Tensor, " B"]:
        return posterior.log_prob(z).sum(-1) - self.log_prob(z)

    def component(self, z: Float[Tensor, "*batch Z"]) -> Int[Tensor, "*batch"]:
        law = self._law()
        joint = law.mixture_distribution.logits + law.component_distribution.log_prob(z.unsqueeze(-2))
        return joint.argmax(-1)
