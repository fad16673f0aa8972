"""The two decoders, p(s_{t+1} | s_{1:t}, z) and pi(a_t | s_{1:t}, z): an LSTM over [s_t; z] and a head each.

As a dynamics model the state decoder reads the action of each step too, p(s_{t+1} | s_{1:t}, a_{1:t}, z).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.spaces import Space

Memory: TypeAlias = tuple[Tensor, Tensor]
"""What an LSTM carries from step to step: hidden and cell state, (1, B, H) each."""


class RecurrentTrunk(nn.Module):
    """h_t from s_{1:t} and z; the recurrent state starts at zero, so z is all that is known of the past.

    The present input [s_t; z] joins the LSTM's output in one further layer, and joins that layer's output too, so
    that reacting to what is seen now needs no detour through memory, and following it ("go where it is") is linear.
    Dropout touches what is remembered and mixed, never the present input: who cannot see clearly cannot steer.
    """

    def __init__(self, state_features: int, latent_features: int, hidden_features: int, dropout: float) -> None:
        super().__init__()
        in_features = state_features + latent_features
        self.num_features = hidden_features + in_features
        self.dropout = nn.Dropout(dropout)
        self.recurrent = nn.LSTM(in_features, hidden_features, batch_first=True)
        self.mix = nn.Linear(in_features + hidden_features, hidden_features)

    def forward(
        self, states: Float[Tensor, "B T S"], z: Float[Tensor, "B Z"], memory: Memory | None = None
    ) -> tuple[Float[Tensor, "B T H"], Memory]:
        """Features (B, T, H) after each state, and the memory behind the last one."""
        inputs = torch.cat([states, z[:, None].expand(-1, states.shape[1], -1)], dim=-1)
        remembered, memory = self.recurrent(inputs, memory)
        mixed = torch.nn.functional.silu(self.mix(torch.cat([inputs, self.dropout(remembered)], dim=-1)))
        return torch.cat([self.dropout(mixed), inputs], dim=-1), memory


class Endless(nn.Module):
    """p(end_t | s_{1:t}, z) = 0: log-odds of minus infinity, for a model that does not know about ends."""

    def forward(self, features: Float[Tensor, "*batch H"]) -> Float[Tensor, "*batch 1"]:
        return features.new_full((*features.shape[:-1], 1), -math.inf)


class StateDecoder(nn.Module):
    """p(s_{t+1} | s_{1:t}, z), by the change of state, and optionally p(end_t | s_{1:t}, z).

    With `action_features` both laws are given a_{1:t} too.
    """

    def __init__(
        self,
        space: Space,
        latent_features: int,
        hidden_features: int,
        *,
        floor: float,
        stop: bool,
        dropout: float = 0.0,
        num_components: int = 1,
        action_features: int = 0,
    ) -> None:
        super().__init__()
        self.trunk = RecurrentTrunk(space.num_features + action_features, latent_features, hidden_features, dropout)
        self.head = Head(space, self.trunk.num_features, floor=floor, num_components=num_components)
        self.stop = nn.Linear(self.trunk.num_features, 1) if stop else Endless()

    def forward(
        self,
        inputs: Float[Tensor, "B T F"],
        values: Float[Tensor, "B T O"],
        z: Float[Tensor, "B Z"],
    ) -> tuple[RowDistribution, Float[Tensor, "B T"]]:
        """The law of each next state's values, and the log-odds that the episode ends with this step.

        `inputs` are features of the states, then of the actions if there are `action_features`; `values` are the
        states as standardised rows.
        """
        features, _ = self.trunk(inputs, z)
        return self.head(features, values), self.stop(features).squeeze(-1)


class PolicyDecoder(nn.Module):
    """pi(a_t | s_{1:t}, z)."""

    def __init__(
        self,
        state_features: int,
        action_space: Space,
        latent_features: int,
        hidden_features: int,
        *,
        floor: float,
        dropout: float = 0.0,
        num_components: int = 1,
    ) -> None:
        super().__init__()
        self.trunk = RecurrentTrunk(state_features, latent_features, hidden_features, dropout)
        self.head = Head(action_space, self.trunk.num_features, floor=floor, num_components=num_components)

    def forward(self, states: Float[Tensor, "B T S"], z: Float[Tensor, "B Z"]) -> RowDistribution:
        """The law of each action's values."""
        features, _ = self.trunk(states, z)
        return self.law(features)

    def law(self, features: Float[Tensor, "*batch H"]) -> RowDistribution:
        """The law of an action's values given the trunk's features."""
        origin = features.new_zeros(*features.shape[:-1], self.head.space.num_columns)
        return self.head(features, origin)
