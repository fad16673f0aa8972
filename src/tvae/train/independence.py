"""How far z and the world's start depend on each other, estimated from one batch.

Two kernels k(z_i, z_j) = exp(-|z_i - z_j|^2 / (2 m)), l(s_i, s_j) alike, m the median of the squared distances within a
group, and their unbiased Hilbert-Schmidt independence criterion

    HSIC = 1 / (n (n - 3)) sum_{i != j} K'_ij L'_ij,

(Gretton et al. 2005, "Measuring statistical dependence with Hilbert-Schmidt norms"; without bias by Song et al. 2012,
"Feature selection via dependence maximization"), where K' is K with a diagonal of zeros, centred so that all of its
rows and columns add up to zero (Szekely and Rizzo 2014, "Partial distance correlation with methods for
dissimilarities"). On average it is 0 for what is independent, at any n > 3. It is an inner product of such matrices,
so that over groups g of n_g rows

    rho = <K, L> / sqrt(<K, K> <L, L>),    <K, L> = sum_g n_g HSIC_g(K, L)

lies between -1 and 1, and -1/2 log(1 - rho) is a number of nats: with linear kernels of one feature each, rho would be
a squared correlation, and that the information which Gaussian variables have about each other.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

FEWEST = 4
"""A group of fewer rows says nothing."""
_MOST_TOLD = 0.999
"""The largest rho, so that the nats are finite."""
_NOTHING = 1e-9
"""<K, K> below this is that of what does not vary, but for rounding."""
_CLOSE = 1e-12
"""The smallest m: where most rows are the same, the kernel says whether two are."""


def start_nats(
    z: Float[Tensor, "B Z"], start: Float[Tensor, "B F"], group: Int[Tensor, " B"]
) -> Float[Tensor, ""]:
    """-1/2 log(1 - rho) of z and the features of the start, within groups; about 0, and as often below it, for nothing.

    0 where no group has four rows, or where in all that have one of the two does not vary. Bandwidths count as
    constants of the gradient.

    >>> from tvae.device import seeded
    >>> with seeded(0, torch.device("cpu")):
    ...     z, other = torch.randn(400, 2), torch.randn(400, 2)
    >>> everyone = torch.zeros(400, dtype=torch.int64)
    >>> [round(start_nats(z, start, everyone).item(), 1) for start in (z + other, other)]
    [0.3, 0.0]
    """
    both, of_z, of_start = z.new_zeros(()), z.new_zeros(()), z.new_zeros(())
    for number in group.unique().tolist():
        rows = torch.nonzero(group == number).squeeze(-1)
        if len(rows) >= FEWEST:
            left, right = centred(kernel(z[rows])), centred(kernel(start[rows]))
            weight = 1 / (len(rows) - 3)
            both = both + weight * (left * right).sum()
            of_z = of_z + weight * left.square().sum()
            of_start = of_start + weight * right.square().sum()
    if min(of_z.item(), of_start.item()) < _NOTHING:
        return 0 * z.sum()
    rho = both / (of_z * of_start).sqrt()
    return -0.5 * torch.log1p(-rho.clamp(max=_MOST_TOLD))


def kernel(rows: Float[Tensor, "N F"]) -> Float[Tensor, "N N"]:
    """exp(-|x_i - x_j|^2 / (2 m)), m the median of the squared distances of two different rows.

    >>> kernel(torch.tensor([[0.0], [1.0], [2.0]])).log().tolist()
    [[0.0, -0.5, -2.0], [-0.5, 0.0, -0.5], [-2.0, -0.5, 0.0]]
    """
    squares = (rows[:, None] - rows).square().sum(-1)
    above = torch.ones_like(squares, dtype=torch.bool).triu(1)
    median = squares.detach()[above].median()
    return torch.exp(-0.5 * squares / median.clamp_min(_CLOSE))


def centred(kernel: Float[Tensor, "N N"]) -> Float[Tensor, "N N"]:
    """The kernel without its diagonal, centred so that every row and column adds up to 0; N must be above 2.

    K'_ij = K_ij - r_i / (N - 2) - r_j / (N - 2) + r / ((N - 1) (N - 2)) for i != j, where r_i = sum_j K_ij and
    r = sum_i r_i; 0 on the diagonal.

    >>> pairs = torch.tensor([[9.0, 1, 0, 0], [1, 9, 0, 0], [0, 0, 9, 1], [0, 0, 1, 9]])
    >>> centred(pairs).mul(3).round().int().tolist()
    [[0, 2, -1, -1], [2, 0, -1, -1], [-1, -1, 0, 2], [-1, -1, 2, 0]]
    """
    count = len(kernel)
    off = 1 - torch.eye(count, dtype=kernel.dtype, device=kernel.device)
    outside = kernel * off
    rows = outside.sum(1) / (count - 2)
    return off * (outside - rows[:, None] - rows + rows.sum() / (count - 1))
