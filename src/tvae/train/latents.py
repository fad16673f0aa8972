"""What the policy is told of each episode while it learns alone: a z of the episode itself, or of its style."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from tvae.model.decoding import LatentSource
from tvae.spaces import FloatArray, IntArray


@runtime_checkable
class EpisodeLatents(Protocol):
    """Draws a z for each of some episodes: of the very episode (`tvae.evaluate.encoding.Posteriors`) or its style."""

    def __len__(self) -> int:
        """The number of episodes."""
        ...

    def draw(self, episodes: IntArray, rng: np.random.Generator) -> FloatArray:
        """(B, Z) for the episodes at these positions (B,)."""
        ...


@dataclass(frozen=True, eq=False)
class OfStyles:
    """z ~ q_k(z) of the style k of each episode, `assignment` (E,), as its bots get it: of any episode of that style.

    >>> from tvae.model.decoding import Fixed
    >>> latents = OfStyles([Fixed(np.array([-1.0])), Fixed(np.array([1.0]))], np.array([0, 1, 1]))
    >>> latents.draw(np.array([2, 0]), np.random.default_rng(0)).ravel().tolist()
    [1.0, -1.0]
    """

    styles: Sequence[LatentSource]
    assignment: IntArray

    def __len__(self) -> int:
        return len(self.assignment)

    def draw(self, episodes: IntArray, rng: np.random.Generator) -> FloatArray:
        """(B, Z)"""
        of = self.assignment[episodes]
        order = np.argsort(of, kind="stable")
        styles, counts = np.unique(of, return_counts=True)
        drawn = [self.styles[style].sample(int(count), rng) for style, count in zip(styles, counts, strict=True)]
        z: FloatArray = np.concatenate(drawn)[np.argsort(order, kind="stable")]
        return z
