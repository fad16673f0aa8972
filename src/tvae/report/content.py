"""What a report says, as plain data. Whatever is empty or None is left out of the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.figures.trajectories import Draw
from tvae.spaces import FloatArray, IntArray
from tvae.train.checkpoint import Record


@dataclass(frozen=True, eq=False)
class StyleSection:
    """One playstyle."""

    name: str
    """What it is called, such as `style 0`."""
    weight: float
    """Its share of the demonstrations, in [0, 1]."""
    draw: Draw
    """Draws an episode of it; see `tvae.figures`."""
    label: str | None = None
    """What the user calls it, or the label that most of its episodes carry, where the data has labels."""
    sentences: tuple[str, ...] = ()
    """What sets it apart."""
    prototypes: tuple[int, ...] = ()
    """Positions of its most typical episodes in the demonstrations."""
    test_episodes: Demonstrations | None = None
    """Episodes that its bot played."""
    succeeded: NDArray[np.bool_] | None = None
    """(E,) which of the test episodes reached what is asked of the style."""

    def __post_init__(self) -> None:
        episodes = 0 if self.test_episodes is None else len(self.test_episodes)
        if self.succeeded is not None and len(self.succeeded) != episodes:
            raise ValueError(f"{self.name}: {episodes} test episodes need as many outcomes, got {len(self.succeeded)}")


@dataclass(frozen=True, eq=False)
class ReportContent:
    """A whole report.

    Two entries of `metrics` stand in the headline if they are there: `playstyles.ari` (or `ari`), the agreement of the
    found styles with the labels, and `success`, by a style's label or name. Each is a number, whose interval may stand
    at the same place in `ci95`, or, over seeds, `{"mean": m, "ci95": [low, high], "seeds": n}`. Without `success`, it
    is counted in the test episodes.

    Raises `ValueError` where arrays do not fit together.
    """

    title: str
    """What the demonstrations are called, such as the name of their file."""
    verdict: str
    """What was found, in one sentence."""
    demonstrations: Demonstrations
    """The N episodes that the styles were found in."""
    episode_ids: tuple[str, ...]
    """N names of episodes."""
    latent_means: FloatArray
    """(N, Z) means of q(z | tau)."""
    assignment: IntArray
    """(N,) index into `styles`."""
    probability: FloatArray
    """(N,) how probable the assigned style is."""
    styles: tuple[StyleSection, ...]
    command: str
    """What was typed."""
    version: str
    """Of tvae."""
    created: str
    """When, as people read it."""
    run: str = ""
    """What the run is called."""
    warnings: tuple[str, ...] = ()
    metrics: Mapping[str, Any] = field(default_factory=dict)
    """Nested, as in `metrics.json`."""
    records: tuple[Record, ...] = ()
    """How training went."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """The configuration of the run, as in `config.json`."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Of the other software."""

    def __post_init__(self) -> None:
        episodes = len(self.demonstrations)
        sizes = {
            "episode_ids": len(self.episode_ids),
            "latent_means": len(self.latent_means),
            "assignment": len(self.assignment),
            "probability": len(self.probability),
        }
        wrong = [f"{size} {name}" for name, size in sizes.items() if size != episodes]
        if wrong:
            raise ValueError(f"{episodes} demonstrations need as many of everything, got {', '.join(wrong)}")
        if not np.isfinite(self.latent_means).all():
            raise ValueError("latent means need finite numbers")
        if not self.styles or self.assignment.max() >= len(self.styles) or self.assignment.min() < 0:
            raise ValueError(
                f"assignments need a style from 0 to {len(self.styles) - 1}, got "
                f"{self.assignment.min()} to {self.assignment.max()}"
            )
