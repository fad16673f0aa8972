"""Demonstrations that mix several styles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tvae.data.demonstrations import Demonstrations


def mixed(parts: Mapping[str, Demonstrations], seed: int) -> Demonstrations:
    """All episodes of all parts, in random order.

    Each gets the attributes `episode`, its place in that order, and `label`, the name of its part. The parts
    have the same spaces, and there is at least one.
    """
    labelled = [(label, trajectory) for label, part in parts.items() for trajectory in part]
    order = np.random.default_rng(seed).permutation(len(labelled))
    first = next(iter(parts.values()))
    return Demonstrations.from_trajectories(
        (
            replace(trajectory, attributes={**trajectory.attributes, "episode": episode, "label": label})
            for episode, (label, trajectory) in enumerate(labelled[index] for index in order)
        ),
        first.observation_space,
        first.action_space,
    )
