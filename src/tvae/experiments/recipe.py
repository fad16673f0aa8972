"""A run of one of our tasks, complete: its demonstrations, its configuration, and where its bots are tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.experiments.arenas import Arena


@dataclass(frozen=True)
class Recipe:
    """Everything about a run but its directory."""

    title: str
    demonstrations: Callable[[], Demonstrations]
    config: RunConfig
    arena: Arena
