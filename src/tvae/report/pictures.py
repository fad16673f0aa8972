"""Pictures of episodes and of the latent space as SVG, and which episodes are pictured at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tvae.data.trajectory import Trajectory
from tvae.figures.canvas import SMALL_TEXT_SIZE
from tvae.figures.latent import latent_plane, latent_space
from tvae.figures.markup import to_markup
from tvae.figures.palette import INK, PAPER, style_colour, style_marker
from tvae.figures.trajectories import Draw, share_limits
from tvae.spaces import FloatArray, IntArray

_SIDE = 1.9
"""Inches a picture of an episode is wide and high."""


@dataclass(frozen=True)
class Sketches:
    """Pictures of episodes at the same scale."""

    pictures: tuple[str, ...]
    """SVG elements."""
    key: str
    """An SVG element that says what the lines and marks mean; empty where the pictures say it themselves."""


def sketch(episodes: Sequence[tuple[Trajectory, Draw, str]]) -> Sketches:
    """Pictures of trajectories, each with the function that draws it and a label in words."""
    cells: list[Axes] = []
    figures = [Figure((_SIDE, _SIDE)) for _ in episodes]
    for figure, (trajectory, draw, _) in zip(figures, episodes, strict=True):
        cells.append(figure.add_axes((0, 0, 1, 1)))
        draw(cells[-1], trajectory)
        cells[-1].set_axis_off()
    share_limits(cells)
    pictures = [to_markup(figure, label) for figure, (_, _, label) in zip(figures, episodes, strict=True)]
    return Sketches(tuple(pictures), _key(cells))


def _key(cells: Sequence[Axes]) -> str:
    """The labelled lines of all cells, each label once."""
    handles = {line.get_label(): line for axes in cells for line in axes.lines[::-1]}
    named = {label: line for label, line in handles.items() if label and not str(label).startswith("_")}
    if not named:
        return ""
    figure = Figure((0.85 * len(named), 0.22))
    legend = figure.legend(
        list(named.values()),
        [str(label) for label in named],
        loc="center left",
        bbox_to_anchor=(0, 0.5),
        ncols=len(named),
        frameon=False,
        fontsize=SMALL_TEXT_SIZE,
        labelcolor=INK,
        borderpad=0,
        columnspacing=1.5,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
    return to_markup(figure, "Key to the pictures: " + ", ".join(str(label) for label in named))


def glyph(style: int, name: str) -> str:
    """The style's marker in its colour, as an SVG element."""
    figure = Figure((0.2, 0.2))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.plot(0.5, 0.5, style_marker(style), color=style_colour(style), markersize=10, markeredgecolor=PAPER)
    return to_markup(figure, f"marker of {name}")


@dataclass(frozen=True)
class LatentMap:
    """The latent space as an SVG element, and where in it (in its own units) each episode stands."""

    picture: str
    places: FloatArray
    """(N, 2)"""


def latent_map(means: FloatArray, assignment: IntArray, names: Sequence[str]) -> LatentMap:
    """The posterior means (N, Z) as a picture whose points a script can find again."""
    figure = latent_space(means, assignment, names)
    picture = to_markup(figure, f"Latent space: {len(means)} episodes, coloured by style")
    places = figure.axes[0].transData.transform(latent_plane(means, assignment).points)
    return LatentMap(picture, np.stack([places[:, 0], figure.bbox.height - places[:, 1]], axis=1))


def spread(assignment: IntArray, always: Sequence[int], limit: int) -> IntArray:
    """Positions of about `limit` episodes, from every style in proportion, and those that must be there.

    >>> spread(np.array([0, 0, 0, 0, 1, 1]), always=[1], limit=3).tolist()
    [0, 1, 2, 5]
    """
    order = np.argsort(assignment, kind="stable")
    even = order[np.linspace(0, len(order) - 1, min(limit, len(order))).round().astype(np.int64)]
    return np.union1d(even, np.asarray(always, dtype=np.int64))


def in_proportion(succeeded: NDArray[np.bool_], count: int) -> IntArray:
    """Positions of `count` outcomes (E,), failures in their true share, but at least one if there is one.

    >>> outcomes = np.array([True] * 90 + [False] * 10)
    >>> chosen = in_proportion(outcomes, 20)
    >>> len(chosen), int((~outcomes[chosen]).sum())
    (20, 2)
    """
    count = min(count, len(succeeded))
    failures, successes = np.flatnonzero(~succeeded), np.flatnonzero(succeeded)
    num_failures = round(count * len(failures) / len(succeeded))
    num_failures = min(max(num_failures, min(1, len(failures))), len(failures))
    parts = [
        part[np.linspace(0, len(part) - 1, wanted).round().astype(np.int64)]
        for part, wanted in ((failures, num_failures), (successes, min(count - num_failures, len(successes))))
    ]
    return np.sort(np.concatenate(parts))
