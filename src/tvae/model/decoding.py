"""Decoding step by step, with all of the past or a rolling window of it.

A rolling window W forgets: at each step the recurrent state is reset and only the last W states (with z) are fed.
W = 1 makes a memoryless policy.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.distributions import RowDistribution
from tvae.model.arguments import counted
from tvae.model.events import SURE
from tvae.model.trunks import Memory, Trunk
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray

Choice: TypeAlias = Callable[[RowDistribution], Tensor]
"""How a row is chosen from its law: `sampled`, `most_likely`, or `Tempered` between the two."""


def sampled(law: RowDistribution) -> Tensor:
    """A draw."""
    return law.sample()


def most_likely(law: RowDistribution) -> Tensor:
    """The mode."""
    return law.mode()


@dataclass(frozen=True)
class Tempered:
    """A draw from the law in proportion to p^(1/T): T = 1 is `sampled`, and T towards 0 `most_likely`.

    What a policy has not quite learnt spreads its law: below 1 a bot errs less often than its demonstrators' law as
    learnt would have it, and varies less. `ValueError` for a temperature that is not positive.

    >>> from torch.distributions import Categorical
    >>> from tvae.distributions import Columns, Joint
    >>> law = Joint(1, (Columns(torch.tensor([0]), Categorical(logits=torch.tensor([[[0.0, 1.0]]]))),))
    >>> Tempered(0.01)(law).item()
    1.0
    """

    temperature: float

    def __post_init__(self) -> None:
        if not 0 < self.temperature < math.inf:
            raise ValueError(f"a temperature must be a positive number, got {self.temperature}")

    def __call__(self, law: RowDistribution) -> Tensor:
        """A draw of each row."""
        return law.tempered(self.temperature).sample()


@runtime_checkable
class LatentSource(Protocol):
    """Where each episode's z comes from, such as a playstyle."""

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        ...


class Fixed:
    """The same z in every episode, or row i of several in copy i of the environment.

    >>> Fixed(np.array([0.5, -1.0])).sample(3, np.random.default_rng(0)).shape
    (3, 2)
    """

    def __init__(self, z: FloatArray) -> None:
        self.z = np.atleast_2d(np.asarray(z, dtype=np.float64))

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        if len(self.z) == 1:
            return np.repeat(self.z, count, axis=0)
        if len(self.z) < count:
            raise ValueError(f"{count} copies of the environment need one z or as many, got {len(self.z)}")
        return self.z[:count]


class Recurrence:
    """Feeds a decoder the inputs of one step after another, remembering all of them or the last `window`."""

    def __init__(self, trunk: Trunk, z: Float[Tensor, "N Z"], window: int | None) -> None:
        window = None if window is None else counted("window", window, unit=" step")
        self._trunk = trunk
        self._z = z
        self._memory: Memory | None = None
        self._recent: deque[Tensor] | None = None if window is None else deque(maxlen=window)

    def step(self, states: Float[Tensor, "N S"]) -> Float[Tensor, "N H"]:
        """The decoder's features after the present states."""
        if self._recent is None:
            features, self._memory = self._trunk(states[:, None], self._z, self._memory)
        else:
            self._recent.append(states)
            features, _ = self._trunk(torch.stack(tuple(self._recent), dim=1), self._z)
        return features[:, -1]


def narrower(first: int | None, second: int | None) -> int | None:
    """The shorter of two windows; None is one without end.

    >>> narrower(4, None), narrower(None, None), narrower(4, 2)
    (4, None, 2)
    """
    given = [window for window in (first, second) if window is not None]
    return min(given, default=None)


class EventMemory:
    """Which events may occur in each episode, drawn once, and which are done.

    An event that occurred at hazards h_1, h_2, ... was due at one of these moments with the probability
    1 - prod_i (1 - h_i). From `SURE` on it counts as done.
    """

    def __init__(self, model: TrajectoryVAE, z: Float[Tensor, "N Z"], choice: Choice) -> None:
        self._events = model.events
        self._used = choice(model.events.occurrence(z)) > 0.5
        self._missed = torch.ones_like(self._used, dtype=z.dtype)

    @property
    def done(self) -> Float[Tensor, "N E"]:
        """(N, number of events): 1 where an event has occurred, and surely when it was due."""
        return (self._missed <= 1 - SURE).to(self._missed.dtype)

    def law(self, law: RowDistribution) -> RowDistribution:
        """The law of actions in which nothing occurs that does not occur in the episode."""
        return self._events.given(law, self._used)

    def note(self, law: RowDistribution, actions: Float[Tensor, "N A"]) -> None:
        """Remember the events among actions that were drawn from `law`."""
        if self._events.num_events:
            self._missed = self._missed * (1 - self._events.hazard(law) * self._events.of(actions))


def tensor_of(model: TrajectoryVAE, rows: FloatArray) -> Tensor:
    """Rows as the model's kind of tensor, where its weights are."""
    return model.observation_normalizer.mean.new_tensor(rows)


def latent_of(model: TrajectoryVAE, z: FloatArray, count: int) -> Float[Tensor, "N Z"]:
    """`tensor_of` for the z of `count` episodes; `ValueError` if they are of another shape or no finite numbers."""
    z = np.asarray(z, dtype=np.float64)
    if z.shape != (count, model.latent_features):
        raise ValueError(f"{count} episodes need z of the shape {(count, model.latent_features)}, got {z.shape}")
    if not np.isfinite(z).all():
        raise ValueError(f"z needs finite numbers, got {z[~np.isfinite(z).all(axis=1)][0]}")
    return tensor_of(model, z)
