"""The bound's terms as numbers, on average over trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
import torch

from tvae.model.elbo import Elbo


@dataclass(frozen=True)
class Terms:
    """Means over trajectories of the bound's terms, in nats per trajectory."""

    policy: float
    state: float
    stop: float
    kl: float
    ahead: float = 0.0
    """0 for a horizon of 1"""

    def value(self, beta: float, state_weight: float = 1.0) -> float:
        """The bound with the divergence weighted by `beta` and the state term by `state_weight`."""
        return self.policy + state_weight * self.state + self.ahead + self.stop - beta * self.kl

    @classmethod
    def of(cls, terms: Elbo) -> Terms:
        """Their means over the trajectories of a batch."""
        means = torch.stack([terms.policy, terms.state, terms.stop, terms.kl, terms.ahead]).mean(1).tolist()
        return cls(*means)

    @classmethod
    def average(cls, terms: Sequence[Terms], shares: Sequence[float] | None = None) -> Terms:
        """Their mean, each weighed by its share if these are given.

        >>> Terms.average([Terms(1.0, 0.0, 0.0, 2.0), Terms(3.0, 0.0, 0.0, 2.0)], [0.25, 0.75]).policy
        2.5
        """
        return cls(*np.average([astuple(each) for each in terms], axis=0, weights=shares).tolist())
