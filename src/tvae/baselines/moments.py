"""Moments of acting as networks see them that judge or choose actions step by step.

A moment is the present state with its last change, x_t = [s_t; d_t], as in `tvae.baselines.chunks`, the action, and the
code of the episode: what a policy without memory sees and does. Features of actions are standardised on the
demonstrations, so that a turn of a tenth of a radian counts where all turns are that small.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from tvae.baselines.boxes import BoxActions
from tvae.baselines.chunks import ChunkData
from tvae.baselines.senses import Senses
from tvae.data.demonstrations import Demonstrations
from tvae.spaces import FloatArray

_FARTHEST = 5.0
"""Of a feature of an action from its mean, in standard deviations."""


@dataclass(frozen=True, eq=False)
class Moments:
    """N moments."""

    states: Float[Tensor, "N X"]
    """x_t"""
    actions: Float[Tensor, "N Y"]
    """Features of a_t."""
    codes: Float[Tensor, "N Z"]
    """Of the episodes; 0 wide where there are none."""

    def __len__(self) -> int:
        return len(self.states)

    @property
    def told(self) -> Moments:
        """The same, whose codes are seen as part of the state."""
        return Moments(torch.cat([self.states, self.codes], dim=-1), self.actions, self.codes)

    @property
    def pairs(self) -> Float[Tensor, "N XY"]:
        """[x_t; a_t]"""
        return torch.cat([self.states, self.actions], dim=-1)

    def at(self, which: Tensor) -> Moments:
        """Those at these positions, or where this is true."""
        return Moments(self.states[which], self.actions[which], self.codes[which])

    def drawn(self, count: int) -> Moments:
        """Any of them, by torch's generator."""
        return self.at(torch.randint(len(self), (count,)))

    @staticmethod
    def joined(parts: Sequence[Moments]) -> Moments:
        """One after another."""
        return Moments(
            torch.cat([part.states for part in parts]),
            torch.cat([part.actions for part in parts]),
            torch.cat([part.codes for part in parts]),
        )


class Sight:
    """How moments are seen, measured on demonstrations; and the moments of these, all episodes one after another.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(4)
    >>> sight = Sight(demonstrations)
    >>> len(sight.demonstrated) == len(sight.episodes) == int(demonstrations.lengths.sum())
    True
    """

    def __init__(self, demonstrations: Demonstrations) -> None:
        self.senses, self.box = Senses.fit(demonstrations), BoxActions(demonstrations)
        data = ChunkData(demonstrations, self.senses, num_actions=1)
        chunk = data.at(np.arange(len(data)))
        features = self.senses.actions.features(chunk.actions[:, 0])
        self._mean, self._std = features.mean(0), features.std(0).clamp_min(1e-3)
        self.demonstrated = Moments(chunk.inputs, self._standardised(features), torch.zeros(len(data), 0))
        lengths = torch.from_numpy(demonstrations.lengths)
        self.episodes: Int[Tensor, " N"] = torch.repeat_interleave(torch.arange(len(lengths)), lengths)
        """Which demonstration each moment is of."""
        self.weights: Float[Tensor, " N"] = 1 / lengths[self.episodes]
        """Of each moment, so that demonstrations weigh the same, however long they are."""

    def _standardised(self, features: Tensor) -> Tensor:
        return ((features - self._mean) / self._std).clamp(-_FARTHEST, _FARTHEST)

    @property
    def num_state_features(self) -> int:
        """Width of x_t."""
        return 2 * self.senses.num_features

    def state(self, now: Float[Tensor, "N F"], before: Float[Tensor, "N F"]) -> Float[Tensor, "N X"]:
        """x_t of the features of the present observation and those of the last, the same where there is none."""
        return torch.cat([now, self.senses.changes(now, before)], dim=-1)

    def action(self, rows: FloatArray) -> Float[Tensor, "N Y"]:
        """Features of raw actions (N, A)."""
        values = self.senses.actions.values(torch.from_numpy(rows).float())
        return self._standardised(self.senses.actions.features(values))

    def told(self, codes: FloatArray) -> Sight:
        """The same, whose demonstrated moments see the codes (E, Z) of their demonstrations as part of the state."""
        told, own = copy(self), self.demonstrated
        each = torch.from_numpy(codes).float()[self.episodes]
        told.demonstrated = Moments(own.states, own.actions, each).told
        return told

    def drawn(self, count: int) -> Moments:
        """Demonstrated moments by torch's generator, of each demonstration as often, however long it is."""
        return self.demonstrated.at(torch.multinomial(self.weights, count, replacement=True))
