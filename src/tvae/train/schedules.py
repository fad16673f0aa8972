"""How much the divergence KL(q(z | tau) || p(z)) weighs, as training goes on.

A schedule maps the progress of training, the latest KL and the weight before it to the next weight, so that a
resumed run needs to know nothing but that last weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable


@runtime_checkable
class KLSchedule(Protocol):
    """beta as a function of progress, KL and its own last value. A checkpoint knows it again by its `str`."""

    @property
    def settled(self) -> float:
        """The progress from which on scores of different steps can be compared, in [0, 1]."""
        ...

    def weight(self, progress: float, kl: float, previous: float) -> float:
        """beta at `progress` in [0, 1], given the last batch's `kl` in nats a trajectory and the `previous` beta."""
        ...


@dataclass(frozen=True)
class Constant:
    """The same beta throughout; 1 is the evidence lower bound itself."""

    beta: float = 1.0

    @property
    def settled(self) -> float:
        return 0.0

    def weight(self, progress: float, kl: float, previous: float) -> float:
        return self.beta


@dataclass(frozen=True)
class Piecewise:
    """Straight lines between (progress, beta) points.

    >>> raised_late = Piecewise(((0.0, 1.0), (0.4, 1.0), (0.6, 10.0)))
    >>> [raised_late.weight(p, kl=0.0, previous=1.0) for p in (0.2, 0.5, 0.9)]
    [1.0, 5.5, 10.0]
    """

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if not self.points or any(a[0] >= b[0] for a, b in pairwise(self.points)):
            raise ValueError(f"points need rising progress, got {self.points}")

    @property
    def settled(self) -> float:
        return self.points[-1][0]

    def weight(self, progress: float, kl: float, previous: float) -> float:
        first = self.points[0]
        if progress <= first[0]:
            return first[1]
        for (start, low), (end, high) in pairwise(self.points):
            if progress <= end:
                return low + (high - low) * (progress - start) / (end - start)
        return self.points[-1][1]


RAISED = Piecewise(((0.0, 1.0), (0.4, 1.0), (0.5, 1.5)))
"""The evidence lower bound until z has found its place; from then on a nat in z has to be worth one and a half."""


@dataclass(frozen=True)
class Budget:
    """Holds KL near `nats`: log beta rises while KL is above it and falls while it is below.

    log beta <- log beta + rate clip((KL - nats) / nats, -1, 1), kept between `lowest` and `highest`; until `begin` of
    the training, beta is 1 so that z first learns everything it can (Rezende and Viola 2018 and Shao et al. 2020
    control a VAE's divergence in the same spirit).
    """

    nats: float
    begin: float = 0.3
    rate: float = 0.01
    lowest: float = 0.1
    highest: float = 100.0

    def __post_init__(self) -> None:
        if not 0 < self.nats < math.inf:
            raise ValueError(f"a budget needs more than 0 nats, got {self.nats}")

    @property
    def settled(self) -> float:
        return min(1.0, self.begin + 0.4)

    def weight(self, progress: float, kl: float, previous: float) -> float:
        if progress < self.begin:
            return 1.0
        error = max(-1.0, min(1.0, (kl - self.nats) / self.nats))
        beta = math.exp(math.log(previous) + self.rate * error)
        return min(self.highest, max(self.lowest, beta))
