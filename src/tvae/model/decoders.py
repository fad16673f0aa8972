"""The two decoders, p(s_{t+1} | s_{1:t}, z) and pi(a_t | s_{1:t}, z): a recurrent trunk and a head each.

The state decoder may say where things are h steps ahead too, p(s_{t+h} | s_{1:t}, z).

As a dynamics model the state decoder reads the action of each step too, p(s_{t+1} | s_{1:t}, a_{1:t}, z).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor, nn

from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.model.trunks import Places, Trunk
from tvae.spaces import Space


class Endless(nn.Module):
    """p(end_t | s_{1:t}, z) = 0: log-odds of minus infinity, for a model that does not know about ends."""

    def forward(self, features: Float[Tensor, "*batch H"]) -> Float[Tensor, "*batch 1"]:
        return features.new_full((*features.shape[:-1], 1), -math.inf)


class Foretold(NamedTuple):
    """What the state decoder says at each step: batch shape (B, T), or (N,) where it is asked for N of them."""

    following: RowDistribution
    """p(s_{t+1} | s_{1:t}, z)"""
    log_odds: Float[Tensor, "*batch"]
    """that the episode ends with this step"""
    ahead: RowDistribution | None
    """p(s_{t+h} | s_{1:t}, z); None for a horizon h = 1"""


class StateDecoder(nn.Module):
    """p(s_{t+1} | s_{1:t}, z), by the change of state; optionally p(end_t | s_{1:t}, z) and p(s_{t+h} | s_{1:t}, z).

    Where `trunk` takes the features of actions beside those of states, all laws are given a_{1:t} too.
    """

    def __init__(
        self, space: Space, trunk: Trunk, *, floor: float, stop: bool, num_components: int = 1, horizon: int = 1
    ) -> None:
        super().__init__()
        self.horizon = horizon
        self.trunk = trunk
        self.head = Head(space, self.trunk.num_features, floor=floor, num_components=num_components)
        self.stop = nn.Linear(self.trunk.num_features, 1) if stop else Endless()
        self.ahead = (
            Head(space, self.trunk.num_features, floor=floor, num_components=num_components) if horizon > 1 else None
        )

    def forward(
        self,
        inputs: Float[Tensor, "B T F"],
        values: Float[Tensor, "B T O"],
        z: Float[Tensor, "B Z"],
        at: Places | None = None,
    ) -> Foretold:
        """The laws of the values of the states to come, and the log-odds that the episode ends with this step.

        `inputs` are features of the states, then of the actions if the trunk takes them; `values` are the states as
        standardised rows. With `at`, after the N inputs at these places alone.
        """
        features, _ = self.trunk(inputs, z, at=at)
        values = values if at is None else values[at]
        ahead = None if self.ahead is None else self.ahead(features, values)
        return Foretold(self.head(features, values), self.stop(features).squeeze(-1), ahead)


class PolicyDecoder(nn.Module):
    """pi(a_t | s_{1:t}, z)."""

    def __init__(self, action_space: Space, trunk: Trunk, *, floor: float, num_components: int = 1) -> None:
        super().__init__()
        self.trunk = trunk
        self.head = Head(action_space, self.trunk.num_features, floor=floor, num_components=num_components)

    def forward(
        self, states: Float[Tensor, "B T S"], z: Float[Tensor, "B Z"], at: Places | None = None
    ) -> RowDistribution:
        """The law of each action's values; with `at`, of those after the N inputs at these places alone."""
        features, _ = self.trunk(states, z, at=at)
        return self.law(features)

    def law(self, features: Float[Tensor, "*batch H"]) -> RowDistribution:
        """The law of an action's values given the trunk's features."""
        origin = features.new_zeros(*features.shape[:-1], self.head.space.num_columns)
        return self.head(features, origin)
