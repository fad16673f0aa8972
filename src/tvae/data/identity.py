"""What tells demonstrations from others."""

from __future__ import annotations

import hashlib
import json

import numpy as np

from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations

_MOST_STEPS = 20_000


def identity(demonstrations: Demonstrations) -> str:
    """Sizes, and a digest of lengths, signals and evenly spaced episodes of at most about 20,000 steps.

    >>> from tvae.data.arrays import from_arrays
    >>> walks = [np.zeros(4), np.ones(4)]
    >>> one, other = (identity(from_arrays(order, walks)) for order in (walks, walks[::-1]))
    >>> one[:20], one == other
    ('2 episodes, 8 steps ', False)
    """
    spaces = demonstrations.observation_space, demonstrations.action_space
    digest = hashlib.sha256(json.dumps([space.to_json() for space in spaces]).encode())
    digest.update(demonstrations.lengths.tobytes())
    for episode in evenly(demonstrations, _MOST_STEPS):
        digest.update(np.ascontiguousarray(episode.observations).tobytes())
        digest.update(np.ascontiguousarray(episode.actions).tobytes())
    sizes = f"{len(demonstrations)} episodes, {demonstrations.num_steps} steps"
    return f"{sizes} (SHA-256 {digest.hexdigest()[:12]})"
