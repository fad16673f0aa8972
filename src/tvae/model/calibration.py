"""What is measured on training data rather than learned: which rows are looked at, and how much changes in a step."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.data.demonstrations import Demonstrations
from tvae.data.normalizer import Normalizer
from tvae.spaces import FloatArray, IntArray

MOST_ROWS = 1_000_000


def typical(change: Float[Tensor, "N C"]) -> Float[Tensor, " C"]:
    """Root mean square of each column; 1 for one that never changes."""
    typical = change.square().mean(0).sqrt()
    return torch.where(typical > 1e-6, typical, torch.ones_like(typical))


def spread(starts: IntArray, counts: IntArray) -> IntArray:
    """All rows of episodes that hold `counts` from `starts` on; of too many, those of evenly spaced episodes.

    Whole episodes are read, as what lies together comes from disk together; of these, again, evenly spaced rows if
    there are too many.
    """
    every = max(1, -(-int(counts.sum()) // MOST_ROWS))
    starts, counts = starts[::every], counts[::every]
    ends = np.cumsum(counts)
    total = int(ends[-1])
    ordinal = np.linspace(0, total - 1, min(total, MOST_ROWS)).astype(np.int64)
    episode = np.searchsorted(ends, ordinal, side="right")
    rows: IntArray = ordinal - (ends - counts - starts)[episode]
    return rows


def some_rows(demonstrations: Demonstrations) -> tuple[FloatArray, FloatArray]:
    """Observations and actions of all episodes, or of evenly spaced ones if there are too many."""
    lengths = demonstrations.lengths
    observed = spread(demonstrations.observation_starts, lengths + demonstrations.final_observed)
    acted = spread(demonstrations.action_starts, lengths)
    return demonstrations.observations[observed], demonstrations.actions[acted]


def typical_changes(
    normalizer: Normalizer, demonstrations: Demonstrations, steps: int = 1
) -> tuple[Float[Tensor, " C"], Float[Tensor, " F"]]:
    """The typical change of each value and each feature of an observation in so many steps; 1 where there are none.

    Angles change along the shorter arc. Computed in double, and where double is: not every accelerator knows it.
    """
    pairs = np.maximum(demonstrations.lengths - steps + demonstrations.final_observed, 0)
    rows = spread(demonstrations.observation_starts, pairs)
    normalizer = deepcopy(normalizer).cpu().double()
    observations = demonstrations.observations
    before, after = (normalizer.values(torch.from_numpy(observations[at])) for at in (rows, rows + steps))
    change = after - before
    angular = normalizer.space.angular
    change[:, angular] = torch.remainder(change[:, angular] + torch.pi, 2 * torch.pi) - torch.pi
    return typical(change), typical(normalizer.features(after) - normalizer.features(before))
