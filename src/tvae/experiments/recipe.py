"""A task of ours: its demonstrations, its environment, what success means there, and a configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory

Success: TypeAlias = Callable[[Demonstrations], Mapping[str, NDArray[np.bool_]]]
"""(E,) per label: whether each episode is a success in the style of that label."""
Measures: TypeAlias = Callable[[Demonstrations], Mapping[str, NDArray[np.float64]]]
"""(E,) each: numbers of interest about episodes, such as attacks."""
Draw: TypeAlias = Callable[[Axes, Trajectory], None]


@dataclass(frozen=True)
class Arena:
    """Where bots are tried: an environment and, where the task defines them, success and measures."""

    env: str
    """Gymnasium id, with its module before a colon if it must be imported first."""
    options: Mapping[str, Any] = field(default_factory=dict)
    success: Success | None = None
    measures: Measures | None = None
    episodes: int = 1000


@dataclass(frozen=True)
class Recipe:
    """Everything about a run but its directory."""

    title: str
    demonstrations: Callable[[], Demonstrations]
    config: RunConfig
    arena: Arena
    draw: Draw | None = None
