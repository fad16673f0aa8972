"""Places on a grid and other ordered categories, as an encoder reads them: numbers, their changes, and areas."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from tvae.data.batches import batch_of, evenly, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.model.calibration import MOST_ROWS
from tvae.nets import masked_mean
from tvae.spaces import Categorical, Signal, Space

_NOTHING = 1e-9


class Ranks(nn.Module):
    """What the one-hot features of ordered categories do not say: that 2 lies between 1 and 3, and which way one went.

    Read are the categorical signals of `space` with at least three categories that are integers in ascending order,
    such as a place on a grid or a count. With r_t their ranks in standard deviations, an encoder is told

    - r_t and r_t - r_{t-1} at each step, which is 0 at the first (`forward`);
    - for the whole trajectory, of each pair i < j of them, the mean over its steps of

          a_t = r_i,t (r_j,t - r_j,t-1) - r_j,t (r_i,t - r_i,t-1)

      in standard deviations of the pair that varies most over the training data (`areas`): twice the Levy area that
      the path sweeps around the middle, by the number of steps. Laps around something are linear in it.

    Levels and areas are the first two levels of the signature of a path, in which every continuous function of the path
    is nearly linear (Lyons 1998; Chevyrev & Kormilitzin 2016, arXiv 1603.03788). A recurrent net has to learn the
    products from examples instead, and what it learns from few people does not hold for others.

    >>> from tvae.spaces import Continuous
    >>> space = Space((Categorical("x", (1, 2)), Categorical("y", (1, 2, 3)), Categorical("held", ("a", "b", "c"))))
    >>> Ranks(space).num_features, Ranks(Space((Continuous("x"),))).num_features
    (2, 0)
    """

    mean: Tensor
    deviation: Tensor
    area_unit: Tensor
    columns: Tensor
    first: Tensor
    second: Tensor

    def __init__(self, space: Space) -> None:
        super().__init__()
        columns = np.array([i for i, signal in enumerate(space.signals) if _is_ordered(signal)], dtype=np.int64)
        first, second = np.triu_indices(len(columns), 1)
        self.num_features = 2 * len(columns)
        """Width of what `forward` gives."""
        self.num_areas = len(first)
        """Width of what `areas` gives."""
        # Where there is nothing to read, nothing is saved: models of other spaces are what they would be without.
        there = len(columns) > 0
        self.register_buffer("mean", torch.zeros(len(columns)), persistent=there)
        self.register_buffer("deviation", torch.ones(len(columns)), persistent=there)
        self.register_buffer("area_unit", torch.ones(()), persistent=there)
        for name, indices in (("columns", columns), ("first", first), ("second", second)):
            self.register_buffer(name, torch.from_numpy(indices), persistent=False)

    def fit(self, demonstrations: Demonstrations) -> None:
        """Measure training data; of more than a million steps, evenly spaced episodes."""
        if not self.num_features:
            return
        some = evenly(demonstrations, MOST_ROWS)
        batches = [batch_of(some, episodes, self.mean.device) for episodes in ordered_batches(some, 64)]
        rows = torch.cat([batch.observations[batch.mask] for batch in batches]).index_select(-1, self.columns)
        self.mean.copy_(rows.mean(0))
        self.deviation.copy_(_spread(rows))
        self.area_unit.fill_(1.0)
        if self.num_areas:
            areas = torch.cat([self.areas(self(batch.observations), batch.mask) for batch in batches])
            spread = areas.std(0, correction=0).max()
            self.area_unit.copy_(spread if spread > _NOTHING else torch.ones_like(spread))

    def forward(self, raw: Float[Tensor, "B T C"]) -> Float[Tensor, "B T F"]:
        """Ranks of raw rows, then their changes."""
        ranks = (raw.index_select(-1, self.columns) - self.mean) / self.deviation
        return torch.cat([ranks, torch.diff(ranks, dim=1, prepend=ranks[:, :1])], dim=-1)

    def areas(self, read: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B A"]:
        """The mean areas of each trajectory, from what `forward` gave, over the steps where `mask` is true."""
        ranks, changes = read.chunk(2, dim=-1)
        one, other = (x.index_select(-1, self.first) for x in (ranks, changes))
        second, moved = (x.index_select(-1, self.second) for x in (ranks, changes))
        return masked_mean(one * moved - second * other, mask) / self.area_unit


def _is_ordered(signal: Signal) -> bool:
    """Whether there are more than two categories, all integers, in ascending order."""
    if not isinstance(signal, Categorical) or len(signal.categories) < 3:
        return False
    numbers = [category for category in signal.categories if isinstance(category, int)]
    return numbers == list(signal.categories) and numbers == sorted(numbers)


def _spread(rows: Float[Tensor, "N C"]) -> Float[Tensor, " C"]:
    """The standard deviation of each column; 1 for one that never changes."""
    spread = rows.cpu().double().std(0, correction=0).to(rows)
    return torch.where(spread > _NOTHING, spread, torch.ones_like(spread))
