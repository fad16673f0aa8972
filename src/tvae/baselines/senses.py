"""What every network of a baseline reads, so that methods differ in how they learn and not in what they see.

Of a raw observation: its standardised features, and the proportions and relative directions that our own policy
decoder reads too (`tvae.model.perception`). Nothing of it is learnt.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.data.demonstrations import Demonstrations
from tvae.data.normalizer import Normalizer
from tvae.model.calibration import some_rows, spread, typical
from tvae.model.perception import Perception
from tvae.spaces import Space


class Senses(nn.Module):
    """Features of observations and values of actions; measured on demonstrations by `fit`.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(2)
    >>> senses = Senses.fit(demonstrations)
    >>> senses(torch.zeros(5, 4)).shape[-1] == senses.num_features
    True
    """

    unit: Tensor
    """(F,) the typical change of each feature in one step."""

    def __init__(self, observation_space: Space, action_space: Space) -> None:
        super().__init__()
        self.observations = Normalizer(observation_space)
        self.actions = Normalizer(action_space)
        self.perception = Perception(observation_space)
        self.num_features = observation_space.num_features + self.perception.num_features
        self.register_buffer("unit", torch.ones(self.num_features))

    @classmethod
    def fit(cls, demonstrations: Demonstrations) -> Senses:
        """Measured on these demonstrations."""
        senses = cls(demonstrations.observation_space, demonstrations.action_space)
        rows, actions = some_rows(demonstrations)
        senses.observations = Normalizer.fit(demonstrations.observation_space, rows)
        senses.actions = Normalizer.fit(demonstrations.action_space, actions)
        senses.perception.fit(rows)
        before = spread(demonstrations.observation_starts, demonstrations.lengths - 1 + demonstrations.final_observed)
        there, here = (senses(torch.from_numpy(demonstrations.observations[at]).float()) for at in (before + 1, before))
        senses.unit.copy_(typical(there - here))
        return senses

    def forward(self, observations: Float[Tensor, "*batch O"]) -> Float[Tensor, "*batch F"]:
        """Features of raw observations."""
        within = self.perception.within(observations)
        plain = self.observations.features(self.observations.values(within))
        return torch.cat([plain, self.perception(within)], dim=-1)

    def changes(self, now: Float[Tensor, "*batch F"], before: Float[Tensor, "*batch F"]) -> Float[Tensor, "*batch F"]:
        """The change of features since the last step, in units of a typical one, at most 20 of them."""
        return ((now - before) / self.unit).clamp(-20, 20)
