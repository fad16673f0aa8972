"""What an animation shows: episodes of one style's bot, and where they lie in the latent space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tvae.data.trajectory import Trajectory
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Scene:
    """Episodes of one style's bot, and where they and the demonstrations lie in the latent space.

    Raises `ValueError` if the parts do not fit together.
    """

    episodes: Sequence[Trajectory]
    """E episodes of the zombie task, each with the observation after its last action."""
    succeeded: NDArray[np.bool_]
    """(E,)"""
    z: FloatArray
    """(E, Z): the latent that the bot was given in each episode."""
    window: int | None
    """The most states, the present one among them, that the bot sees; None for all of them."""
    name: str
    """The name of the style."""
    style: int
    """Which style it is: its colour and marker."""
    background_means: FloatArray
    """(N, Z): posterior means of the demonstrations."""
    background_assignment: IntArray
    """(N,): the style of each demonstration, an index of `names`."""
    names: Sequence[str]
    """The names of all styles."""

    def __post_init__(self) -> None:
        count = len(self.episodes)
        if count == 0:
            raise ValueError("an animation needs at least one episode, got none")
        for index, episode in enumerate(self.episodes):
            if (episode.observations.shape, episode.actions.shape) != ((len(episode) + 1, 4), (len(episode), 2)):
                raise ValueError(
                    "episodes need observations (T + 1, 4) and actions (T, 2), got "
                    f"{episode.observations.shape} and {episode.actions.shape} in episode {index}"
                )
        if self.succeeded.shape != (count,):
            raise ValueError(f"{count} episodes need succeeded of shape ({count},), got {self.succeeded.shape}")
        if self.z.ndim != 2 or len(self.z) != count or self.z.shape[1] == 0:
            raise ValueError(f"{count} episodes need z of shape ({count}, Z) with Z at least 1, got {self.z.shape}")
        if self.background_means.ndim != 2 or self.background_means.shape[1] != self.z.shape[1]:
            raise ValueError(
                f"background_means need the shape (N, {self.z.shape[1]}), got {self.background_means.shape}"
            )
        if self.background_assignment.shape != (len(self.background_means),):
            raise ValueError(
                f"{len(self.background_means)} background_means need as many background_assignment, "
                f"got the shape {self.background_assignment.shape}"
            )
        styles = {self.style, *self.background_assignment.tolist()}
        if not 0 <= min(styles) <= max(styles) < len(self.names):
            raise ValueError(f"styles must be indices of the {len(self.names)} names, got {sorted(styles)}")
        if self.window is not None and self.window < 1:
            raise ValueError(f"window must be at least 1 state, got {self.window}")

    @cached_property
    def num_steps(self) -> int:
        """Number of actions of the longest episode."""
        return max(len(episode) for episode in self.episodes)


def in_proportion(succeeded: NDArray[np.bool_], count: int, rng: np.random.Generator) -> IntArray:
    """Positions of `count` of the episodes, ascending: as many successes as their rate gives, to the nearest.

    With n episodes, k of them successes, it draws floor(count k / n + 1/2) successes and fills up with
    failures, both uniformly without replacement. So a few failures among many episodes may give none.

    Raises `ValueError` unless 1 <= count <= n.

    >>> succeeded = np.arange(1000) < 963
    >>> chosen = in_proportion(succeeded, 25, np.random.default_rng(0))
    >>> len(chosen), int(succeeded[chosen].sum())
    (25, 24)
    """
    if not 1 <= count <= len(succeeded):
        raise ValueError(f"count must be from 1 to the number of episodes, {len(succeeded)}, got {count}")
    wins, losses = np.flatnonzero(succeeded), np.flatnonzero(~succeeded)
    num_wins = (2 * count * len(wins) + len(succeeded)) // (2 * len(succeeded))
    chosen = (rng.choice(wins, num_wins, replace=False), rng.choice(losses, count - num_wins, replace=False))
    return np.sort(np.concatenate(chosen))
