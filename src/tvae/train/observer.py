"""Who is told of a training while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tvae.train.checkpoint import Progress, Record
from tvae.train.terms import Terms


@dataclass(frozen=True)
class Observer:
    """Who is told of a training's progress: `on_step` of every step, `on_record` of every evaluation.

    `on_policy_step` is told of every step of `tvae.train.policy.train_policy`, with the log-likelihood of an action;
    `on_end` where the training of the whole model ended; `on_note`, in words, what was decided after it.
    """

    on_step: Callable[[int, Terms], None] = lambda step, terms: None
    on_record: Callable[[Record], None] = lambda record: None
    on_policy_step: Callable[[int, float], None] = lambda step, nats: None
    on_end: Callable[[Progress], None] = lambda progress: None
    on_note: Callable[[str], None] = lambda note: None
