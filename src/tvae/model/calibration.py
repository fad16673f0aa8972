"""What is measured on training data rather than learned: which rows are looked at, and how much changes in a step."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.spaces import IntArray

MOST_ROWS = 1_000_000


def typical(change: Float[Tensor, "N C"]) -> Float[Tensor, " C"]:
    """Root mean square of each column; 1 for one that never changes."""
    typical = change.square().mean(0).sqrt()
    return torch.where(typical > 1e-6, typical, torch.ones_like(typical))


def spread(starts: IntArray, counts: IntArray) -> IntArray:
    """Rows, evenly spaced if there are too many, of episodes that hold `counts` rows from `starts` on."""
    ends = np.cumsum(counts)
    total = int(ends[-1])
    ordinal = np.linspace(0, total - 1, min(total, MOST_ROWS)).astype(np.int64)
    episode = np.searchsorted(ends, ordinal, side="right")
    rows: IntArray = ordinal - (ends - counts - starts)[episode]
    return rows
