"""How much of the past a bot should see: the shortest window that loses nothing.

What a policy can read off the past, it will use, also where it is no cause of what was done: a zombie that stands
still is a dead one as long as nobody shows a zombie that waits. A bot that sees less has less to be fooled by
(de Haan et al. 2019, arXiv 1905.11979, call this causal confusion). So of the windows

    W = 1, 2, 4, ... up to that of the training

the shortest one is kept under which held-out actions are hardly less likely than under the longest:

    mean_i d_i + 2 sd(d_i) / sqrt(E) >= -0.02 mean_i T_i,

    d_i = log p_W(a_1:T of trajectory i) - log p_longest(a_1:T of trajectory i)

with the same z ~ q(z | tau_i) in both: a longer memory has to be worth 0.02 nats a step.
"""

from __future__ import annotations

import numpy as np

from tvae.data.batches import batch_of, evenly, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.device import seeded
from tvae.model.elbo import policy_log_likelihood
from tvae.model.inference import inferring
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import rolling
from tvae.spaces import FloatArray

_STANDARD_ERRORS = 2.0
_WORTH = 0.02
"""Nats a step that a longer window has to be worth."""
_MOST_STEPS = 20_000
"""Held-out steps that are looked at; of more, evenly spaced episodes."""


def shortest_sufficient_window(
    model: TrajectoryVAE, held_out: Demonstrations, *, shortest: int = 1, seed: int = 0
) -> int | None:
    """The window of at least `shortest` that a bot needs; None for a model that was trained on whole trajectories.

    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Continuous, Space
    >>> x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> walks = Demonstrations.from_trajectories([Trajectory(np.zeros((9, 1)), np.ones((8, 1)))] * 4, x, dx)
    >>> shortest_sufficient_window(TrajectoryVAE(x, dx, window=1), walks)
    1
    """
    if model.window is None:
        return None
    some = evenly(held_out, _MOST_STEPS)
    best = _log_probability(model, some, model.window, seed)
    for window in candidates(model.window, shortest):
        assert window is not None
        lost = _log_probability(model, some, window, seed) - best
        allowed = -_WORTH * some.lengths.mean()
        if lost.mean() + _STANDARD_ERRORS * lost.std() / np.sqrt(len(lost)) >= allowed:
            return window
    return model.window


def candidates(window: int | None, shortest: int) -> tuple[int | None, ...]:
    """The windows among which a policy's is chosen, shortest first: at least `shortest`, at most that of the training.

    >>> [candidates(window, 1) for window in (1, 6, None)], candidates(6, 2), candidates(4, 9)
    ([(1,), (1, 2, 4, 6), (None,)], (2, 4, 6), (4,))
    """
    if window is None:
        return (None,)
    powers = (2**power for power in range((window - 1).bit_length()))
    return (*(length for length in powers if length >= shortest), window)


def _log_probability(model: TrajectoryVAE, demonstrations: Demonstrations, window: int, seed: int) -> FloatArray:
    """(E,) log-probability of the actions of each trajectory under a rolling window."""
    found = np.zeros(len(demonstrations))
    with inferring(model), seeded(seed, model.device):
        for episodes in ordered_batches(demonstrations, 32):
            batch = batch_of(demonstrations, episodes, model.device)
            z = model.posterior(batch).sample()
            policy = policy_log_likelihood(model, batch, z, rolling(batch.lengths, window))
            found[episodes] = policy.cpu().double().numpy()
    return found
