"""From raw rows to what a network sees, and back. Nowhere else do raw values change.

Three forms of a row:

- *raw*: as recorded, shape (..., C), one column per signal;
- *values*: raw with every continuous column standardised, (x - mean) / std; what heads give a law to;
- *features*: what enters a network, shape (..., F): standardised numbers, cos and sin of angles, +-1 for binary
  signals, one-hot categories.
"""

from __future__ import annotations

from typing import Self

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.spaces import FloatArray, Space

_MOST_ROWS = 1_000_000


class Normalizer(nn.Module):
    """Standardises the continuous signals of a space. Fit it on training data only.

    >>> from tvae.spaces import Angular, Continuous
    >>> space = Space((Continuous("x"), Angular("heading")))
    >>> normalizer = Normalizer.fit(space, np.array([[1.0, 0.0], [3.0, 0.0]]))
    >>> values = normalizer.values(torch.tensor([[3.0, 0.0]]))
    >>> values.tolist(), normalizer.features(values).tolist()
    ([[1.0, 0.0]], [[1.0, 1.0, 0.0]])
    """

    mean: Tensor
    std: Tensor
    exists: Tensor

    def __init__(self, space: Space) -> None:
        super().__init__()
        self.space = space
        self.register_buffer("mean", torch.zeros(space.num_columns))
        self.register_buffer("std", torch.ones(space.num_columns))
        self.register_buffer("exists", torch.from_numpy(space.category_mask), persistent=False)

    @classmethod
    def fit(cls, space: Space, rows: FloatArray) -> Self:
        """Mean and standard deviation of the continuous columns of `rows` (N, C); a constant column keeps std 1.

        Of more than a million rows, a million evenly spaced ones are used.
        """
        self = cls(space)
        if len(rows) > _MOST_ROWS:
            rows = rows[np.linspace(0, len(rows) - 1, _MOST_ROWS).astype(np.int64)]
        continuous = np.asarray(rows[:, space.continuous], dtype=np.float64)
        std = continuous.std(axis=0)
        constant = std <= 1e-9 * (1 + np.abs(continuous).max(axis=0, initial=0.0))
        columns = torch.from_numpy(space.continuous)
        self.mean[columns] = torch.from_numpy(continuous.mean(axis=0)).float()
        self.std[columns] = torch.from_numpy(np.where(constant, 1.0, std)).float()
        return self

    @property
    def num_features(self) -> int:
        """Width F of `features`."""
        return self.space.num_features

    def values(self, raw: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Standardised raw rows."""
        return (raw - self.mean) / self.std

    def raw(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """The inverse of `values`."""
        return values * self.std + self.mean

    def features(self, values: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch F"]:
        """What a network sees of standardised rows: numbers, then cos, sin, then +-1, then one-hot categories."""
        angles = values[..., self.space.angular]
        codes = values[..., self.space.categorical].long()
        one_hot = nn.functional.one_hot(codes, self.exists.shape[1])[..., self.exists]
        parts = (
            values[..., self.space.continuous],
            angles.cos(),
            angles.sin(),
            2 * values[..., self.space.binary] - 1,
            one_hot.to(values.dtype),
        )
        return torch.cat(parts, dim=-1)
