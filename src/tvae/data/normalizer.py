"""From raw rows to what a network sees, and back. Nowhere else do raw values change.

Three forms of a row:

- *raw*: as recorded, shape (..., C), one column per signal;
- *values*: raw with every continuous column standardised, (x - mean) / std; what heads give a law to;
- *features*: what enters a network, shape (..., F): standardised numbers, cos and sin of angles, +-1 for binary
  signals, one-hot categories.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.spaces import FloatArray, Space

_CONSTANT = 1e-9
"""A spread below this share of the largest value is none."""
_RESOLUTION = 1e-6
"""A spread below this share of the largest value is lost in single precision."""


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
    _continuous: Tensor
    _angular: Tensor
    _binary: Tensor
    _categorical: Tensor
    _categories: Tensor

    def __init__(self, space: Space) -> None:
        super().__init__()
        self.space = space
        self.register_buffer("mean", torch.zeros(space.num_columns))
        self.register_buffer("std", torch.ones(space.num_columns))
        for kind in ("continuous", "angular", "binary", "categorical"):
            self.register_buffer(f"_{kind}", torch.from_numpy(getattr(space, kind)), persistent=False)
        categories = np.flatnonzero(space.category_mask)
        self.register_buffer("_categories", torch.from_numpy(categories), persistent=False)

    @classmethod
    def fit(cls, space: Space, rows: FloatArray) -> Normalizer:
        """Mean and standard deviation of the continuous columns of `rows` (N, C); a constant column keeps std 1.

        Where single precision could not tell values apart, std is as large as what it can.
        """
        self = cls(space)
        continuous = np.asarray(rows[:, space.continuous], dtype=np.float64)
        std = continuous.std(axis=0)
        largest = np.abs(continuous).max(axis=0, initial=0.0)
        std = np.where(std <= _CONSTANT * largest, 1.0, np.maximum(std, _RESOLUTION * largest))
        columns = torch.from_numpy(space.continuous)
        self.mean[columns] = torch.from_numpy(continuous.mean(axis=0)).float()
        self.std[columns] = torch.from_numpy(std).float()
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
        parts = []
        if len(self._continuous):
            parts.append(values.index_select(-1, self._continuous))
        if len(self._angular):
            angles = values.index_select(-1, self._angular)
            parts.extend((angles.cos(), angles.sin()))
        if len(self._binary):
            parts.append(2 * values.index_select(-1, self._binary) - 1)
        if len(self._categorical):
            codes = values.index_select(-1, self._categorical).long()
            one_hot = nn.functional.one_hot(codes, self.space.category_mask.shape[1]).flatten(-2)
            parts.append(one_hot.index_select(-1, self._categories).to(values.dtype))
        return torch.cat(parts, dim=-1)
