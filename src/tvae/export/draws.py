"""Draws as functions of uniform numbers, so that a graph draws without a random generator of its own.

Every function takes uniform numbers u in [0, 1) and uses arithmetic alone: no loop whose length depends on values. A 0
counts as the smallest step above it; a 1, which hosts may make of a number just below it in single precision, as the
largest number below it.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

SMALLEST = 2.0**-24
"""What a uniform number of single precision is at least below 1, and here above 0."""
CELLS = 64


def within(uniform: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Uniform numbers strictly between 0 and 1.

    >>> within(torch.tensor([0.0, 0.5, 1.0])).mul(2**24).tolist()
    [1.0, 8388608.0, 16777215.0]
    """
    return uniform.clamp(SMALLEST, 1 - SMALLEST)


def normal(radius: Float[Tensor, "*batch"], angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """A standard normal number of two uniform ones: sqrt(-2 ln(1 - u)) cos(2 pi v) (Box and Muller).

    >>> normal(torch.tensor([0.1, 0.5]), torch.tensor([0.3, 0.0])).mul(100).round().tolist()
    [-14.0, 118.0]
    """
    return torch.sqrt(-2 * torch.log(1 - within(radius))) * torch.cos(2 * math.pi * angle)


def von_mises(uniform: Float[Tensor, "*batch"], concentration: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """An angle in [-pi, pi] with a density in proportion to exp(k cos x), by inverting its distribution function.

    With x = 2 atan(tan(pi v) / sqrt(1 + 4 k)), v in +-1/2, the density of v is in proportion to
    exp(-2 k s) (1 + 4 k s), where s = sin^2(x / 2): a smooth even function, flat at k = 0 and never narrow, whatever
    k is. Its integral from the far end inward is taken on 64 cells of a half, a cell being filled evenly.

    >>> von_mises(torch.tensor([0.25, 0.75, 0.75]), torch.tensor([0.0, 0.0, 1e4])).mul(100).round().tolist()
    [-157.0, 157.0, 1.0]
    """
    k = concentration[..., None]
    middles = (torch.arange(CELLS, dtype=k.dtype, device=k.device) + 0.5) / CELLS  # from the far end inward
    towards = 1 / torch.tan(math.pi / 2 * middles).square()
    s = towards / (1 + 4 * k + towards)
    density = torch.exp(-2 * k * s) * (1 + 4 * k * s)
    up_to = density.cumsum(-1)
    u = within(uniform)
    outside = torch.minimum(2 * u, 2 - 2 * u)[..., None]
    filled = (outside * up_to[..., -1:] - (up_to - density)) / density  # inf where a density is too small for a number
    turned = torch.tan(math.pi / 2 * filled.clamp(0, 1).mean(-1))
    away = 2 * torch.atan(1 / (turned * torch.sqrt(1 + 4 * concentration)))
    return torch.where(uniform < 0.5, -away, away)


def category(uniform: Float[Tensor, "*#batch"], probabilities: Float[Tensor, "*#batch K"]) -> Int[Tensor, ...]:
    """The category in which u falls when they stand side by side, each as wide as it is probable.

    >>> category(torch.tensor([0.1, 0.5, 0.99]), torch.tensor([0.2, 0.0, 0.8])).tolist()
    [0, 2, 2]
    """
    behind = pad(probabilities[..., 1:].flip(-1).cumsum(-1).flip(-1), (0, 1))
    return (behind >= 1 - within(uniform)[..., None]).to(torch.int64).sum(-1)
