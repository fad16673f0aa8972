"""Which sessions, and which places in them, are least like a reference such as the held-out demonstrations.

A session is judged by its log-likelihood a step, log p(tau | s_1, z) / T at its posterior mean, and a step by its own
log-likelihood (`tvae.evaluate.scores`). Of both, `share` is the share of the reference that is as unlikely
(`share_as_unlikely`): below 0.01 for one in a hundred of the reference's own. The signal named with a step is the one
that falls furthest below its median in the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.evaluate.scores import Scores, share_as_unlikely
from tvae.spaces import IntArray


@dataclass(frozen=True)
class Place:
    """A step of a session."""

    session: int
    """Position among the sessions."""
    step: int
    nats: float
    """Log-likelihood of the step."""
    share: float
    """Share of the reference's steps that are as unlikely."""
    signal: int
    """Column of `Scores.signals` that is furthest below its usual value."""


@dataclass(frozen=True)
class UnlikeSession:
    """A session, and the least likely of its steps."""

    session: int
    """Position among the sessions."""
    nats_per_step: float
    share: float
    """Share of the reference's sessions that are as unlikely."""
    worst: Place


def unlike_sessions(scores: Scores, reference: Scores, count: int) -> tuple[UnlikeSession, ...]:
    """The `count` sessions with the lowest log-likelihood a step, lowest first; fewer where there are fewer.

    >>> from tvae.evaluate.scores import Scores
    >>> def walks(*actions):  # two steps each, of which only the action has a term
    ...     action = np.array(actions)
    ...     rest = np.zeros(len(action))
    ...     lengths = np.full(len(action) // 2, 2)
    ...     return Scores(lengths, action, action[:, None], rest, rest[:, None], rest, np.zeros((len(lengths), 0)))
    >>> found = unlike_sessions(walks(0.0, -1.0, -9.0, 0.0), walks(0.0, 0.0, 0.0, 0.0), count=1)[0]
    >>> found.session, found.nats_per_step, found.share, found.worst.step
    (1, -4.5, 0.3333333333333333, 0)
    """
    per_step = scores.per_step
    order = np.argsort(per_step, kind="stable")[:count]
    shares = share_as_unlikely(per_step[order], reference.per_step)
    steps = scores.steps
    rows = [
        start + int(np.argmin(steps[start : start + length]))
        for start, length in zip(scores.starts[order], scores.lengths[order], strict=True)
    ]
    worst = _places(scores, reference, np.array(rows, dtype=np.int64))
    return tuple(
        UnlikeSession(int(session), float(per_step[session]), float(share), place)
        for session, share, place in zip(order, shares, worst, strict=True)
    )


def unlike_places(scores: Scores, reference: Scores, count: int) -> tuple[Place, ...]:
    """The `count` least likely steps of all sessions, least likely first; fewer where there are fewer."""
    return _places(scores, reference, np.argsort(scores.steps, kind="stable")[:count])


def _places(scores: Scores, reference: Scores, rows: IntArray) -> tuple[Place, ...]:
    starts, nats, signals = scores.starts, scores.steps[rows], scores.signals[rows]
    sessions = np.searchsorted(starts, rows, side="right") - 1
    shares = share_as_unlikely(nats, reference.steps)
    recorded = ~np.isnan(reference.signals).all(axis=0)
    usual = np.zeros(reference.signals.shape[1])
    usual[recorded] = np.nanmedian(reference.signals[:, recorded], axis=0)
    lowest = np.where(np.isnan(signals), np.inf, signals - usual).argmin(axis=1)
    return tuple(
        Place(int(session), int(row - starts[session]), float(value), float(share), int(signal))
        for session, row, value, share, signal in zip(sessions, rows, nats, shares, lowest, strict=True)
    )
