"""Laws of a whole row: independent laws of its columns, and mixtures of such.

The laws of single columns are torch's. A row's law is a `Joint`, p(x) = prod_c p_c(x_c), or a `Mixture` of K of
them, p(x) = sum_k w_k prod_c p_kc(x_c), whose columns depend on each other through k. Both answer `log_prob`,
`sample` and `mode`, on the values that `tvae.data.normalizer` calls *values*.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor
from torch.distributions import Bernoulli, Categorical, Distribution, Normal
from torch.distributions import VonMises as TorchVonMises

from tvae.spaces import IntArray


class RowDistribution(Protocol):
    """A law of rows (..., C)."""

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        ...

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        ...

    def mode(self) -> Float[Tensor, "*batch C"]:
        """A most likely row each (of a mixture: that of its heaviest component)."""
        ...


class VonMises(TorchVonMises):
    """torch's von Mises law with a density that stays exact, and its gradient finite, at any concentration.

    log p(x) = -2 k sin^2((x - m) / 2) - log(2 pi I0(k) e^-k); torch's own polynomials overflow from k = 10^4 on.
    """

    def log_prob(self, value: Tensor) -> Tensor:
        """Log-density in nats per radian."""
        away = 2 * torch.sin((value - self.loc) / 2).square()
        return -self.concentration * away - torch.log(2 * torch.pi * torch.special.i0e(self.concentration))


@dataclass(frozen=True)
class Columns:
    """The law of some columns, one and the same family: batch shape (..., number of columns)."""

    columns: IntArray
    law: Distribution


def most_likely(law: Distribution) -> Tensor:
    """The mode of a column's law; of a fair coin, 0."""
    match law:
        case Normal() | VonMises():
            return law.loc
        case Categorical():
            return law.logits.argmax(-1)
        case Bernoulli():
            return (law.logits > 0).to(law.logits.dtype)
        case _:
            raise TypeError(f"no mode is known for a {type(law).__name__}")


@dataclass(frozen=True)
class Joint:
    """Independent columns: log p(x) = sum_c log p_c(x_c).

    >>> import numpy as np
    >>> joint = Joint(2, (Columns(np.array([1]), Normal(torch.zeros(1), torch.ones(1))),
    ...                   Columns(np.array([0]), Bernoulli(logits=torch.zeros(1)))))
    >>> round(joint.log_prob(torch.tensor([1.0, 0.0])).item(), 4)  # ln(1/2) - ln(2 pi)/2
    -1.6121
    """

    num_columns: int
    parts: tuple[Columns, ...]

    def log_prob_by_column(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Log-density of every column on its own, in nats."""
        result = torch.zeros_like(values)
        for part in self.parts:
            result[..., part.columns] = part.law.log_prob(values[..., part.columns])
        return result

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        total = torch.zeros_like(values[..., 0])
        for part in self.parts:
            total = total + part.law.log_prob(values[..., part.columns]).sum(-1)
        return total

    def _assemble(self, values: list[Tensor]) -> Tensor:
        lead = values[0].shape[:-1]
        rows = torch.empty(*lead, self.num_columns, device=values[0].device)
        for part, columns in zip(self.parts, values, strict=True):
            rows[..., part.columns] = columns.to(rows.dtype)
        return rows

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        return self._assemble([part.law.sample() for part in self.parts])

    def mode(self) -> Float[Tensor, "*batch C"]:
        """The most likely row each."""
        return self._assemble([most_likely(part.law) for part in self.parts])


@dataclass(frozen=True)
class Mixture:
    """K joints, weighted: log p(x) = log sum_k w_k p_k(x). Columns depend on each other through k."""

    weights: Categorical
    """Batch shape (...), K categories."""
    components: Joint
    """Batch shape (..., K)."""

    def log_prob(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch"]:
        """Log-density of each row, in nats."""
        spread = values.unsqueeze(-2).expand(*values.shape[:-1], self.weights.logits.shape[-1], values.shape[-1])
        return torch.logsumexp(self.weights.logits + self.components.log_prob(spread), dim=-1)

    def _of(self, rows: Tensor, component: Tensor) -> Tensor:
        index = component[..., None, None].expand(*component.shape, 1, rows.shape[-1])
        return rows.gather(-2, index).squeeze(-2)

    def sample(self) -> Float[Tensor, "*batch C"]:
        """One row each."""
        return self._of(self.components.sample(), self.weights.sample())

    def mode(self) -> Float[Tensor, "*batch C"]:
        """The most likely row of the heaviest component."""
        return self._of(self.components.mode(), self.weights.logits.argmax(-1))
