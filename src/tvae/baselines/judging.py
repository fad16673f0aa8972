"""A judge of single moments: whether they were demonstrated or are the policy's own, as a `LearntReward`.

With f the logit of the probability that a moment (x, a) was demonstrated (`tvae.baselines.moments`),

    min_f  E_own[softplus(f(x, a))] + E_demonstrated[softplus(-f(x, a))] + penalty E[abs(grad f)^2]

and the reward is f itself, which favours neither long nor short episodes (Fu et al. 2018). The penalty is taken between
own and demonstrated moments (after Gulrajani et al. 2017, but towards 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import softplus

from tvae.baselines.moments import Moments, Sight

_MOST = 10.0
"""Largest logit that is rewarded."""


def network(sight: Sight, hidden_features: int, out_features: int) -> nn.Sequential:
    """An MLP over [x_t; a_t]."""
    return nn.Sequential(
        nn.Linear(sight.demonstrated.pairs.shape[1], hidden_features),
        nn.Tanh(),
        nn.Linear(hidden_features, hidden_features),
        nn.Tanh(),
        nn.Linear(hidden_features, out_features),
    )


@dataclass(frozen=True)
class Judging:
    """How discriminator and posterior are learnt."""

    penalty: float = 0.01
    batch_size: int = 512
    """Own moments in a gradient step, and as many demonstrated ones."""
    learning_rate: float = 1e-3
    hidden_features: int = 64


class Discriminator:
    """f, a `LearntReward`."""

    def __init__(self, sight: Sight, judging: Judging) -> None:
        self.sight, self.judging = sight, judging
        self.logit = network(sight, judging.hidden_features, 1)
        self._optimizer = torch.optim.Adam(self.logit.parameters(), lr=judging.learning_rate)

    @torch.no_grad()
    def of(self, moments: Moments) -> Float[Tensor, " N"]:
        """f of each moment."""
        return self.logit(moments.pairs)[:, 0].clamp(-_MOST, _MOST)

    def improve(self, own: Moments, num_steps: int) -> None:
        """Descend on the loss of D."""
        for _ in range(num_steps):
            mine = own.drawn(self.judging.batch_size).pairs
            theirs = self.sight.drawn(self.judging.batch_size).pairs
            share = torch.rand(len(mine), 1)
            between = (share * mine + (1 - share) * theirs).requires_grad_()
            (slope,) = torch.autograd.grad(self.logit(between).sum(), between, create_graph=True)
            loss = softplus(self.logit(mine)).mean() + softplus(-self.logit(theirs)).mean()
            loss = loss + self.judging.penalty * slope.square().sum(-1).mean()
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()
