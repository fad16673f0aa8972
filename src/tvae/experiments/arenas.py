"""Environments in which bots are tried, and what success and numbers of interest are in those we know."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.envs import zombie
from tvae.figures.overcooked import draw_overcooked
from tvae.figures.zombie import draw_zombie

Outcomes: TypeAlias = Mapping[str, NDArray[np.bool_]]
Measures: TypeAlias = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Arena:
    """Which environment, how it is made, and how many test episodes each bot plays."""

    env: str
    """Gymnasium id, with its module before a colon if that must be imported first, or MODULE:NAME of a parallel
    environment of PettingZoo."""
    options: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 1000


@dataclass(frozen=True)
class Knowledge:
    """What is known of an environment beyond its spaces."""

    success: Callable[[Demonstrations], Outcomes] = lambda episodes: {}
    """(E,) per label: whether each episode succeeds in the style of that label."""
    measures: Callable[[Demonstrations], Measures] = lambda episodes: {}
    """(E,) each: numbers worth reporting about episodes."""
    draw: Callable[[Axes, Trajectory, str], None] | None = None
    """How an episode is drawn in a colour; without it, by its signals."""


def knowledge_of(env: str) -> Knowledge:
    """What is known of the environment with this Gymnasium id; for a foreign one, what its info says."""
    return _KNOWN.get(env, Knowledge(success=_as_info_says))


def column_per_episode(
    episodes: Demonstrations, name: str, summary: Callable[[NDArray[Any]], Any]
) -> NDArray[np.float64]:
    """(E,) a step column of each episode in one number."""
    return np.array([summary(episode.steps[name]) for episode in episodes], dtype=np.float64)


def _as_info_says(episodes: Demonstrations) -> Outcomes:
    if "info.is_success" not in episodes.steps:
        return {}
    return {"all": column_per_episode(episodes, "info.is_success", np.max) > 0}


def _zombie(episodes: Demonstrations) -> Measures:
    return {"attacks_per_episode": column_per_episode(episodes, "info.attacks", lambda values: values[-1])}


def _pusht(episodes: Demonstrations) -> Measures:
    return {"best_coverage": column_per_episode(episodes, "info.coverage", np.max)}


def _overcooked(episodes: Demonstrations) -> Measures:
    soups = column_per_episode(episodes, "info.soups", lambda values: values[-1])
    return {"soups_per_1200_steps": 1200 * soups / episodes.lengths}


_KNOWN = {
    "tvae/ZombieAttack-v0": Knowledge(zombie.success, _zombie, draw_zombie),
    "tvae/PushT-v0": Knowledge(_as_info_says, _pusht),
    "tvae/Overcooked-v0": Knowledge(measures=_overcooked, draw=draw_overcooked),
}
