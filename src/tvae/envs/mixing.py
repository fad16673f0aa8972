"""Demonstrations that mix several styles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tvae.data.demonstrations import Demonstrations

Record: TypeAlias = Callable[[int, int], Demonstrations]
"""Records so many episodes of one style; all randomness comes from a seed, the second argument."""


def mixed(styles: Mapping[str, Record], num_episodes: int, seed: int) -> Demonstrations:
    """Equally many episodes of every style (the first have one more where they must), in random order.

    Each gets the attributes `episode`, its place in that order, and `label`, its style's name.

    Raises `ValueError` for fewer episodes than styles.
    """
    if num_episodes < len(styles):
        raise ValueError(
            f"{len(styles)} styles need num_episodes of at least {len(styles)}, got {num_episodes}"
        )
    *seeds, order_seed = np.random.default_rng(seed).integers(2**31, size=len(styles) + 1).tolist()
    counts = [len(part) for part in np.array_split(np.arange(num_episodes), len(styles))]
    parts = [record(count, s) for record, count, s in zip(styles.values(), counts, seeds, strict=True)]
    labelled = [(label, episode) for label, part in zip(styles, parts, strict=True) for episode in part]
    order = np.random.default_rng(order_seed).permutation(num_episodes)
    return Demonstrations.from_trajectories(
        (
            replace(trajectory, attributes={**trajectory.attributes, "episode": episode, "label": label})
            for episode, (label, trajectory) in enumerate(labelled[index] for index in order)
        ),
        parts[0].observation_space,
        parts[0].action_space,
    )
