"""Actions as numbers between -1 and 1, for learners that give numbers and no laws, and back.

An angle is carried as (cos, sin), a binary signal as +-1, a category as one-hot (`tvae.data.normalizer`), each feature
stretched so that demonstrators fill -1 .. 1: y = (f - centre) / reach. What is read back is what such features are
closest to: by atan2, by the sign, by the largest.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.baselines.senses import Senses
from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.spaces import Space


def read_back(space: Space, features: Float[Tensor, "*batch F"]) -> Float[Tensor, "*batch C"]:
    """Values whose features (`tvae.data.normalizer`) these are closest to.

    >>> from tvae.spaces import Angular, Binary
    >>> read_back(Space((Binary("attack"), Angular("heading"))), torch.tensor([0.0, 2.0, 0.3])).tolist()
    [1.0, 1.5707963705062866]
    """
    num_continuous, num_angular = len(space.continuous), len(space.angular)
    sizes = [num_continuous, num_angular, num_angular, len(space.binary), *space.num_categories]
    numbers, cos, sin, signs, *one_hot = features.split(sizes, dim=-1)
    values = features.new_empty(*features.shape[:-1], space.num_columns)
    values[..., space.continuous] = numbers
    values[..., space.angular] = torch.atan2(sin, cos)
    values[..., space.binary] = (signs > 0).to(features.dtype)
    for column, weights in zip(space.categorical.tolist(), one_hot, strict=True):
        values[..., column] = weights.argmax(-1).to(features.dtype)
    return values


class Stretched(nn.Module):
    """Stretched features of action values, and back; measured on demonstrations by `fit`.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(8)
    >>> stretched = Stretched.fit(demonstrations, Senses.fit(demonstrations))
    >>> values = torch.tensor([[1.0, 0.5]])
    >>> torch.allclose(stretched.values(stretched(values)), values)
    True
    """

    centre: Tensor
    """(F,) half-way between the least and the largest of each feature of demonstrators' actions."""
    reach: Tensor
    """(F,) from there to either; 1 for a feature that never changes."""

    def __init__(self, senses: Senses) -> None:
        super().__init__()
        self.actions = senses.actions
        self.num_features = senses.actions.num_features
        self.register_buffer("centre", torch.zeros(self.num_features))
        self.register_buffer("reach", torch.ones(self.num_features))

    @classmethod
    def fit(cls, demonstrations: Demonstrations, senses: Senses) -> Stretched:
        """Measured on these demonstrations."""
        stretched = cls(senses)
        rows = demonstrations.actions[ranges(demonstrations.action_starts, demonstrations.lengths)]
        features = senses.actions.features(senses.actions.values(torch.from_numpy(rows).float()))
        least, largest = features.amin(0), features.amax(0)
        stretched.centre.copy_((largest + least) / 2)
        stretched.reach.copy_(torch.where(largest - least > 1e-6, (largest - least) / 2, 1.0))
        return stretched

    def forward(self, values: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch F"]:
        """Stretched features of action values."""
        return (self.actions.features(values) - self.centre) / self.reach

    def values(self, stretched: Float[Tensor, "*batch F"]) -> Float[Tensor, "*batch A"]:
        """The action values that these are closest to."""
        return read_back(self.actions.space, self.centre + self.reach * stretched)
