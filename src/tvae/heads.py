"""From features to the law of a row.

| signal      | law                          | parameters a network gives                                      |
|-------------|------------------------------|-----------------------------------------------------------------|
| continuous  | N(m, s^2)                    | m, and s = floor + softplus(.)                                  |
| angular     | von Mises(m, k)              | m = atan2 of two numbers, k = 1 / s^2, s = floor + softplus(.)  |
| binary      | Bernoulli(p)                 | log-odds                                                        |
| categorical | categorical(p_1 .. p_K)      | log-weights                                                     |

The law stands relative to an origin: m = origin + unit * output (angles: origin + angle), and s is measured in
units. A policy's origin is 0 and its unit 1. A state decoder's origin is the present state and its unit the typical
change in one step, so that it predicts the change.

The floor keeps a density from growing without limit where recorded data repeat exactly, which would drown every
other term of the objective.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.distributions import Bernoulli, Categorical, Normal
from torch.nn.functional import pad, softplus

from tvae.distributions import Columns, Joint, Mixture, RowDistribution, VonMises
from tvae.spaces import Space


class Head(nn.Module):
    """p(x | h): the law of a row of `space` given features (..., H); a mixture of K joint laws where K > 1.

    >>> from tvae.spaces import Angular, Binary
    >>> head = Head(Space((Angular("heading"), Binary("attack"))), in_features=8, floor=0.01)
    >>> head(torch.zeros(5, 8), torch.zeros(5, 2)).sample().shape
    torch.Size([5, 2])
    """

    unit: Tensor
    _continuous: Tensor
    _angular: Tensor
    _binary: Tensor
    _categorical: Tensor
    _slots: Tensor

    def __init__(self, space: Space, in_features: int, *, floor: float, num_components: int = 1) -> None:
        super().__init__()
        if floor <= 0:
            raise ValueError(f"floor must be positive, got {floor}")
        if num_components < 1:
            raise ValueError(f"num_components must be at least 1, got {num_components}")
        self.space = space
        self.floor = floor
        self.num_components = num_components
        num_continuous, num_angular = len(space.continuous), len(space.angular)
        self._sizes = [num_continuous, num_continuous, num_angular, num_angular, num_angular, len(space.binary)]
        self._sizes.append(sum(space.num_categories))
        if num_components > 1:
            self.weights = nn.Linear(in_features, num_components)
        self.parameters_of_law = nn.Linear(in_features, num_components * sum(self._sizes))
        self.register_buffer("unit", torch.ones(space.num_columns))
        slots = np.where(space.category_mask, np.cumsum(space.category_mask).reshape(space.category_mask.shape), 0) - 1
        self.register_buffer("_slots", torch.from_numpy(slots), persistent=False)
        for kind in ("continuous", "angular", "binary", "categorical"):
            self.register_buffer(f"_{kind}", torch.from_numpy(getattr(space, kind)), persistent=False)

    def forward(self, features: Float[Tensor, "*batch H"], origin: Float[Tensor, "*batch C"]) -> RowDistribution:
        """The law of the row relative to `origin`, in the form that `tvae.data.normalizer` calls values."""
        outputs = self.parameters_of_law(features)
        if self.num_components == 1:
            return self._joint(outputs, origin)
        outputs = outputs.unflatten(-1, (self.num_components, -1))
        weights = Categorical(logits=self.weights(features), validate_args=False)
        return Mixture(weights, self._joint(outputs, origin.unsqueeze(-2)))

    def _joint(self, outputs: Tensor, origin: Tensor) -> Joint:
        mean, spread, x, y, width, log_odds, weights = outputs.split(self._sizes, dim=-1)
        parts: list[Columns] = []
        if len(self._continuous):
            unit = self.unit[self._continuous]
            start = origin.index_select(-1, self._continuous)
            scale = unit * (self.floor + softplus(spread))
            parts.append(Columns(self._continuous, Normal(start + unit * mean, scale, validate_args=False)))
        if len(self._angular):
            angle = origin.index_select(-1, self._angular) + torch.atan2(y, 1 + x)
            scale = self.unit[self._angular] * (self.floor + softplus(width))
            parts.append(Columns(self._angular, VonMises(angle, scale.reciprocal().square(), validate_args=False)))
        if len(self._binary):
            parts.append(Columns(self._binary, Bernoulli(logits=log_odds, validate_args=False)))
        if len(self._categorical):
            logits = pad(weights, (0, 1), value=-math.inf)[..., self._slots]
            parts.append(Columns(self._categorical, Categorical(logits=logits, validate_args=False)))
        return Joint(self.space.num_columns, tuple(parts))
