"""How a policy sees a state: within what training has shown, in proportions, and in relative directions."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.spaces import FloatArray, Space

MARGIN = 0.1
SMALLEST = 1e-30
"""So that the logarithm of a signal that is not positive, which is weighed with 0, is a number."""


class Perception(nn.Module):
    """Raw rows of `space` within their range, and two further readings of them.

    - `within`: a continuous signal beyond the range of the training data, and a tenth of it on either side, counts as
      the nearest value within, so that far away a bot does what it would do at the edge of what it knows. The margin
      lets it see that it is beyond.
    - log x of a continuous signal that was positive in all of the training data, such as a distance, standardised:
      a step from 1 to 2 then counts like one from 2 to 4. Below the least of the training data, and a tenth of the
      range of the logarithm, it counts as that (x may be 0 there). 0 for any other continuous signal.
    - cos and sin of each angular signal relative to the first one: how far the enemy is off the way to the goal.

    >>> from tvae.spaces import Angular, Continuous
    >>> space = Space((Continuous("x"), Continuous("range"), Angular("goal"), Angular("enemy")))
    >>> perception = Perception(space)
    >>> perception.fit(np.array([[-1.0, 1.0, 0.0, 0.0], [1.0, np.e**2, 0.0, 0.0]]))
    >>> row = torch.tensor([3.0, np.e, 1.0, 1.0 + np.pi / 2])
    >>> [round(x, 2) for x in perception(row).tolist()], perception.within(row)[:2].round().tolist()
    ([0.0, 0.0, 0.0, 1.0], [1.0, 3.0])
    >>> round(perception(torch.zeros(4))[1].item(), 2)  # 1 + 2 MARGIN beyond
    -1.2
    """

    least: Tensor
    largest: Tensor
    log_mean: Tensor
    log_scale: Tensor
    _continuous: Tensor
    _angular: Tensor

    def __init__(self, space: Space) -> None:
        super().__init__()
        self.space = space
        count = len(space.continuous)
        self.num_features = count + 2 * max(0, len(space.angular) - 1)
        self.register_buffer("least", torch.full((space.num_columns,), -torch.inf))
        self.register_buffer("largest", torch.full((space.num_columns,), torch.inf))
        self.register_buffer("log_mean", torch.zeros(count))
        self.register_buffer("log_scale", torch.zeros(count))
        self.register_buffer("_continuous", torch.from_numpy(space.continuous), persistent=False)
        self.register_buffer("_angular", torch.from_numpy(space.angular), persistent=False)

    def fit(self, rows: FloatArray) -> None:
        """Measure raw rows (N, C)."""
        columns = self._continuous.cpu()
        values = np.asarray(rows[:, columns.numpy()], dtype=np.float64)
        self.least[columns] = self.least.new_tensor(values.min(0))
        self.largest[columns] = self.largest.new_tensor(values.max(0))
        positive = values.min(0) > 0
        logs = np.log(np.where(positive, values, 1.0))
        spread = logs.std(0)
        for buffer, found in (
            (self.log_mean, logs.mean(0)),
            (self.log_scale, np.where(positive & (spread > 1e-6), 1 / np.maximum(spread, 1e-6), 0.0)),
        ):
            buffer.copy_(torch.from_numpy(found))

    def within(self, raw: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """Raw rows within the range of the training data and its margin."""
        margin = MARGIN * (self.largest - self.least)
        return torch.minimum(torch.maximum(raw, self.least - margin), self.largest + margin)

    def smallest(self) -> Float[Tensor, " N"]:
        """What the logarithm of each continuous signal is taken of at least."""
        least, largest = (bound[self._continuous] for bound in (self.least, self.largest))
        positive = least.clamp_min(SMALLEST)
        return torch.where(least > 0, positive * (positive / largest) ** MARGIN, SMALLEST).clamp_min(SMALLEST)

    def forward(self, raw: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch F"]:
        """The further readings of raw rows that lie within the range."""
        logs = torch.maximum(raw.index_select(-1, self._continuous), self.smallest()).log()
        angles = raw.index_select(-1, self._angular)
        relative = angles[..., 1:] - angles[..., :1]
        return torch.cat([(logs - self.log_mean) * self.log_scale, relative.cos(), relative.sin()], dim=-1)


class NoPerception(nn.Module):
    """A row as it is, and nothing beside its plain features, as in the paper."""

    num_features = 0

    def fit(self, rows: FloatArray) -> None:
        """Nothing to measure."""

    def within(self, raw: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch C"]:
        """The same rows."""
        return raw

    def forward(self, raw: Float[Tensor, "*batch C"]) -> Float[Tensor, "*batch F"]:
        """(..., 0)"""
        return raw[..., :0]
