"""What a decoder remembers: h_t from s_{1:t} and z. Two readings of "an LSTM over [s_t; z]".

- `PlainTrunk`: the LSTM alone, as the paper has it;
- `ReactiveTrunk`: the LSTM beside a short way from the present state and its last change to the head.

The recurrent state starts at zero, so z is all that is known of what came before.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, TypeAlias

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

LARGEST = 20.0
"""A change of more typical changes than this, which training may never have shown, counts as so many."""


Places: TypeAlias = tuple[Int[Tensor, " N"], Int[Tensor, " N"]]
"""Rows and columns of N entries of a batch of sequences (B, T)."""


class Memory(NamedTuple):
    """What a trunk carries from step to step."""

    hidden: Tensor
    """(1, B, H) of the LSTM."""
    cell: Tensor
    """(1, B, H) of the LSTM."""
    last: Tensor
    """(B, 1, S) the last input."""


class Trunk(nn.Module, ABC):
    """Features of s_{1:t} and z at every step t."""

    unit: Tensor
    recurrent: nn.LSTM

    def __init__(self, in_features: int, num_features: int) -> None:
        super().__init__()
        self.num_features = num_features
        """Width of what `forward` gives."""
        self.register_buffer("unit", torch.ones(in_features))

    @abstractmethod
    def forward(
        self,
        inputs: Float[Tensor, "B T S"],
        z: Float[Tensor, "B Z"],
        memory: Memory | None = None,
        at: Places | None = None,
    ) -> tuple[Float[Tensor, "*batch F"], Memory]:
        """Features (B, T, F) after each input, and the memory behind the last one.

        With `at`, the features (N, F) after the N inputs at these places alone: what is remembered has to go through
        all inputs, the rest has not.
        """


class PlainTrunk(Trunk):
    """An LSTM over [s_t; z]; dropout touches what it gives.

    >>> trunk = PlainTrunk(in_features=3, latent_features=2, hidden_features=8)
    >>> features, _ = trunk(torch.zeros(5, 7, 3), torch.zeros(5, 2))
    >>> features.shape[-1] == trunk.num_features == 8
    True
    """

    def __init__(
        self, in_features: int, latent_features: int, hidden_features: int, dropout: float = 0.0
    ) -> None:
        super().__init__(in_features, hidden_features)
        self.dropout = nn.Dropout(dropout)
        self.recurrent = nn.LSTM(in_features + latent_features, hidden_features, batch_first=True)

    def forward(
        self,
        inputs: Float[Tensor, "B T S"],
        z: Float[Tensor, "B Z"],
        memory: Memory | None = None,
        at: Places | None = None,
    ) -> tuple[Float[Tensor, "*batch F"], Memory]:
        joined = torch.cat([inputs, _at_every_step(z, inputs)], dim=-1)
        remembered, (hidden, cell) = self.recurrent(joined, None if memory is None else memory[:2])
        wanted = remembered if at is None else remembered[at]
        return self.dropout(wanted), Memory(hidden, cell, inputs[:, -1:])


class ReactiveTrunk(Trunk):
    """An LSTM over x_t = [s_t; d_t; z], where d_t = (s_t - s_{t-1}) / unit is the last change; d is 0 at the first.

    `unit` is the typical change in one step (1 for features of actions), and d_t at most 20 of it, so that a heading or
    a speed, which are small next to the span of the places where they occur, is seen as clearly as the place. x_t joins
    the LSTM's output in two further layers, and joins their output too: reacting to what is seen now needs no
    detour through memory, and following it ("go where it is") is linear. Dropout touches what is remembered and mixed,
    never x_t: who cannot see clearly cannot steer.

    z weighs every feature but itself by 1 + g(z), a feature-wise modulation (Perez et al. 2018, arXiv 1709.07871), so
    that a style has features of its own. Where z is only one more input, a style that meets a state which it never met
    in training does there what the other styles do. The last `num_done` inputs, which say what was done (`Events`),
    weigh them together with z, for the same reason: who is done does not do it again in a state where training has
    seen nobody who was done.

    >>> trunk = ReactiveTrunk(in_features=3, latent_features=2, hidden_features=8)
    >>> features, _ = trunk(torch.zeros(5, 7, 3), torch.zeros(5, 2))
    >>> features.shape[-1] == trunk.num_features == 8 + 3 + 3 + 2
    True
    """

    def __init__(
        self,
        in_features: int,
        latent_features: int,
        hidden_features: int,
        dropout: float = 0.0,
        *,
        num_done: int = 0,
    ) -> None:
        weighed = hidden_features + 2 * in_features
        seen = 2 * in_features + latent_features
        super().__init__(in_features, weighed + latent_features)
        self.dropout = nn.Dropout(dropout)
        self.recurrent = nn.LSTM(seen, hidden_features, batch_first=True)
        self.mix = nn.Sequential(
            nn.Linear(seen + hidden_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
        )
        self.num_done = num_done
        self.by_style = (
            nn.Sequential(
                nn.Linear(latent_features + num_done, hidden_features // 2),
                nn.SiLU(),
                nn.Linear(hidden_features // 2, weighed),
            )
            if latent_features + num_done
            else None
        )

    def forward(
        self,
        inputs: Float[Tensor, "B T S"],
        z: Float[Tensor, "B Z"],
        memory: Memory | None = None,
        at: Places | None = None,
    ) -> tuple[Float[Tensor, "*batch F"], Memory]:
        last = inputs[:, :1] if memory is None else memory.last
        changes = ((inputs - torch.cat([last, inputs[:, :-1]], dim=1)) / self.unit).clamp(-LARGEST, LARGEST)
        latent = _at_every_step(z, inputs)
        seen = torch.cat([inputs, changes, latent], dim=-1)
        remembered, (hidden, cell) = self.recurrent(seen, None if memory is None else memory[:2])
        after = Memory(hidden, cell, inputs[:, -1:])
        if at is not None:
            inputs, changes, latent, seen, remembered = (
                rows[at] for rows in (inputs, changes, latent, seen, remembered)
            )
        mixed = self.mix(torch.cat([seen, self.dropout(remembered)], dim=-1))
        weighed = torch.cat([self.dropout(mixed), inputs, changes], dim=-1)
        if self.by_style is not None and self.num_done:
            done = inputs[..., inputs.shape[-1] - self.num_done :]
            weighed = weighed * (1 + self.by_style(torch.cat([latent, done], dim=-1)))
        elif self.by_style is not None:
            weights = 1 + self.by_style(z)
            weighed = weighed * (weights[:, None] if at is None else weights[at[0]])
        return torch.cat([weighed, latent], dim=-1), after


def _at_every_step(z: Float[Tensor, "B Z"], inputs: Float[Tensor, "B T S"]) -> Float[Tensor, "B T Z"]:
    return z[:, None].expand(-1, inputs.shape[1], -1)
