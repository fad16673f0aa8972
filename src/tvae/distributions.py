"""Laws of a whole row: independent laws of its columns, and mixtures of such.

The laws of single columns are torch's. A row's law is a `Joint`, p(x) = prod_c p_c(x_c), or a `Mixture` of K of
them, p(x) = sum_k w_k prod_c p_kc(x_c), whose columns depend on each other through k. Both answer `log_prob`,
`log_prob_by_column` (the marginals), `sample` and `mode`, on the values that `tvae.data.normalizer` calls *values*.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.distributions import Bernoulli, Categorical, Distribution, Normal
from torch.distributions import VonMises as TorchVonMises

_MOST_PROPOSALS = 64


@runtime_checkable
class RowDistribution(Protocol):
    """A law of rows (..., C)."""

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        ...

    def log_prob_by_column(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Marginal log-density of every column on its own, in nats."""
        ...

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        ...

    def mode(self) -> Float[Tensor, "*batch C"]:
        """A most likely row each (of a mixture: that of its heaviest component)."""
        ...

    def tempered(self, temperature: float) -> RowDistribution:
        """The law in proportion to p^(1/T) (of a mixture: weights and components each)."""
        ...


class VonMises(TorchVonMises):
    """torch's von Mises law, exact at any concentration k and in single precision.

    log p(x) = -2 k s(x) - log(2 pi I0(k) e^-k), where s(x) = sin^2((x - m) / 2).
    """

    def log_prob(self, value: Tensor) -> Tensor:
        """Log-density in nats per radian."""
        k = self.concentration
        return -2 * k * torch.sin((value - self.loc) / 2).square() - math.log(2 * math.pi) - _log_i0e(k)

    @torch.no_grad()
    def sample(self, sample_shape: Sequence[int] = ()) -> Tensor:
        """Draws in [-pi, pi], by rejection from a wrapped Cauchy law.

        With u uniform in +-1/2, m + 2 atan(tan(pi u) / sqrt(1 + 4 k)) has a density in proportion to 1 / (1 + 4 k s).
        The ratio exp(-2 k s) (1 + 4 k s) is greatest where 4 k s = min(1, 4 k). Of proposals, 0.66 or more are taken.
        """
        k = self.concentration.expand((*sample_shape, *self.batch_shape))
        greatest = (4 * k).clamp(max=1)
        away, found = torch.zeros_like(k), torch.zeros_like(k, dtype=torch.bool)
        for _ in range(_MOST_PROPOSALS):
            u, v = torch.rand_like(k) - 0.5, torch.rand_like(k)
            proposal = 2 * torch.atan(torch.tan(math.pi * u) / torch.sqrt(1 + 4 * k))
            ks = k * torch.sin(proposal / 2).square()
            away = torch.where(found, away, proposal)
            found |= v.log() <= torch.log1p(4 * ks) - 2 * ks - torch.log1p(greatest) + greatest / 2
            if found.all():
                break
        angle = self.loc + away
        return angle - 2 * math.pi * torch.round(angle / (2 * math.pi))


def _log_i0e(k: Tensor) -> Tensor:
    """log(I0(k) e^-k), by its asymptotic series for large k, where the derivative of `i0e` cancels."""
    large = k.clamp_min(1_000)
    return torch.where(k < 1_000, torch.special.i0e(k).log(), 0.125 / large - 0.5 * torch.log(2 * math.pi * large))


@dataclass(frozen=True)
class Columns:
    """The law of some columns, one and the same family: batch shape (..., number of columns)."""

    columns: Int[Tensor, " N"]
    law: Distribution


def drawn(law: Distribution) -> Tensor:
    """A draw from a column's law."""
    draw: Tensor = law.sample()
    return draw.to(law.logits.dtype) if isinstance(law, Categorical) else draw


def most_likely(law: Distribution) -> Tensor:
    """The mode of a column's law; of a fair coin, 0."""
    match law:
        case Normal() | VonMises():
            return law.loc
        case Categorical():
            return law.logits.argmax(-1).to(law.logits.dtype)
        case Bernoulli():
            return (law.logits > 0).to(law.logits.dtype)
        case _:
            raise TypeError(f"no mode is known for a {type(law).__name__}")


def tempered(law: Distribution, temperature: float) -> Distribution:
    """The law of a column in proportion to p^(1/T): below 1 nearer to the mode, 1 as it is.

    >>> tempered(Normal(torch.zeros(1), torch.ones(1)), 0.25).stddev.item(), tempered(Bernoulli(0.8), 0.5).mean.item()
    (0.5, 0.9411764740943909)
    """
    match law:
        case Normal():
            return Normal(law.loc, law.scale * math.sqrt(temperature))
        case VonMises():
            return VonMises(law.loc, law.concentration / temperature)
        case Categorical():
            return Categorical(logits=law.logits / temperature)
        case Bernoulli():
            return Bernoulli(logits=law.logits / temperature)
        case _:
            raise TypeError(f"no temperature is known for a {type(law).__name__}")


@dataclass(frozen=True)
class Joint:
    """Independent columns: log p(x) = sum_c log p_c(x_c).

    >>> joint = Joint(2, (Columns(torch.tensor([1]), Normal(torch.zeros(1), torch.ones(1))),
    ...                   Columns(torch.tensor([0]), Bernoulli(logits=torch.zeros(1)))))
    >>> round(joint.log_prob(torch.tensor([1.0, 0.0])).item(), 4)  # ln(1/2) - ln(2 pi)/2
    -1.6121
    """

    num_columns: int
    parts: tuple[Columns, ...]

    def log_prob_by_column(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Log-density of every column on its own, in nats."""
        result = torch.zeros_like(values)
        for part in self.parts:
            result[..., part.columns] = part.law.log_prob(values.index_select(-1, part.columns))
        return result

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        total = torch.zeros_like(values[..., 0])
        for part in self.parts:
            total = total + part.law.log_prob(values.index_select(-1, part.columns)).sum(-1)
        return total

    def _assemble(self, values: list[Tensor]) -> Tensor:
        rows = values[0].new_empty(*values[0].shape[:-1], self.num_columns)
        for part, columns in zip(self.parts, values, strict=True):
            rows[..., part.columns] = columns
        return rows

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        return self._assemble([drawn(part.law) for part in self.parts])

    def mode(self) -> Float[Tensor, "*batch C"]:
        """The most likely row each."""
        return self._assemble([most_likely(part.law) for part in self.parts])

    def tempered(self, temperature: float) -> Joint:
        """The law in proportion to p^(1/T)."""
        parts = tuple(Columns(part.columns, tempered(part.law, temperature)) for part in self.parts)
        return Joint(self.num_columns, parts)


@dataclass(frozen=True)
class Mixture:
    """K joints, weighted: log p(x) = log sum_k w_k p_k(x). Columns depend on each other through k."""

    weights: Categorical
    """Batch shape (...), K categories."""
    components: Joint
    """Batch shape (..., K)."""

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        return torch.logsumexp(self.weights.logits + self.components.log_prob(self._spread(values)), dim=-1)

    def log_prob_by_column(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Marginal log-density of every column, log sum_k w_k p_kc(x_c), in nats.

        They add up to `log_prob` only where the columns do not depend on each other.

        >>> weights = Categorical(probs=torch.tensor([0.5, 0.5]))
        >>> coins = Bernoulli(probs=torch.tensor([[0.0, 0.0], [1.0, 1.0]]))  # equal coins: both 0, or both 1
        >>> law = Mixture(weights, Joint(2, (Columns(torch.tensor([0, 1]), coins),)))
        >>> law.log_prob_by_column(torch.tensor([1.0, 1.0])).exp(), law.log_prob(torch.tensor([1.0, 1.0])).exp()
        (tensor([0.5000, 0.5000]), tensor(0.5000))
        """
        by_column = self.components.log_prob_by_column(self._spread(values))
        return torch.logsumexp(self.weights.logits.unsqueeze(-1) + by_column, dim=-2)

    def _spread(self, values: Tensor) -> Tensor:
        return values.unsqueeze(-2).expand(*values.shape[:-1], self.weights.logits.shape[-1], values.shape[-1])

    def _of(self, rows: Tensor, component: Tensor) -> Tensor:
        index = component[..., None, None].expand(*component.shape, 1, rows.shape[-1])
        return rows.gather(-2, index).squeeze(-2)

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        return self._of(self.components.sample(), self.weights.sample())

    def mode(self) -> Float[Tensor, "*batch C"]:
        """The most likely row of the heaviest component."""
        return self._of(self.components.mode(), self.weights.logits.argmax(-1))

    def tempered(self, temperature: float) -> Mixture:
        """Weights in proportion to w^(1/T), each component to p^(1/T); where components lie apart, that is p^(1/T).

        (But for the factor by which a broad component gains on a narrow one.)
        """
        return Mixture(Categorical(logits=self.weights.logits / temperature), self.components.tempered(temperature))
