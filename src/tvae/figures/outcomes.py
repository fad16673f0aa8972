"""What came of the zombie episodes of each style's bot, against its demonstrations (figure 7 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tvae.figures.canvas import DOUBLE_COLUMN, SMALL_TEXT_SIZE, new_figure, plain_axes
from tvae.figures.palette import INK, MUTED, RULE, style_colour
from tvae.figures.panels import above, letter, number
from tvae.spaces import FloatArray

REACHED = 0.5
"""The goal is reached at a smaller distance."""

_CAPTIONS = {
    "attacked": "attacked?",
    "zombie_dead": "zombie dead?",
    "closest_goal": "closest to goal",
    "closest_zombie": "closest to zombie",
}
_BIN_WIDTHS = (0.05, 0.1, 0.25)
_MOST_BINS = 40
_HEADROOM = 1.3
_ALPHA = 0.75


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What came of E episodes.

    Raises `ValueError` for no episode, and where the four fields do not speak of as many.
    """

    attacked: NDArray[np.bool_]
    """(E,) whether the agent attacked at least once."""
    zombie_dead: NDArray[np.bool_]
    """(E,)"""
    closest_goal: FloatArray
    """(E,) least distance of the agent to the goal."""
    closest_zombie: FloatArray
    """(E,) least distance of the agent to the living zombie."""

    def __post_init__(self) -> None:
        shapes = [values.shape for values in (self.attacked, self.zombie_dead, self.closest_goal, self.closest_zombie)]
        if shapes != [(len(self.attacked),)] * 4 or not len(self.attacked):
            raise ValueError(f"outcomes need four arrays (E,) of at least one episode, got {shapes}")


@dataclass(frozen=True, eq=False)
class StyleOutcomes:
    """A style's bot and its demonstrations."""

    name: str
    bots: Outcomes
    demonstrations: Outcomes
    wasserstein: Mapping[str, float]
    """The Wasserstein-1 distance of the two by the field of `Outcomes`, as it was measured; some may be missing."""


def outcomes(styles: Sequence[StyleOutcomes]) -> Figure:
    """A row for each style: attacked, zombie dead, closest distance to the goal and to the zombie, as shares.

    The bots are filled in the style's colour, the demonstrations are the black outline; W_1 is the Wasserstein-1
    distance of the two. The goal counts as reached left of the dashed line. Shaded are the distances to the zombie from
    the 2.5 to the 97.5 percentile of the demonstrations.

    Raises `ValueError` for no style, and for a distance of something else.

    >>> some = Outcomes(np.array([True, False]), np.array([True, False]), np.array([0.4, 2.0]), np.array([0.9, 1.5]))
    >>> figure = outcomes([StyleOutcomes("attack", some, some, {"attacked": 0.0})])
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['$W_1$ = 0.00']
    """
    if not styles:
        raise ValueError("outcomes need at least one style, got none")
    for style in styles:
        if not style.wasserstein.keys() <= _CAPTIONS.keys():
            raise ValueError(f"distances need names among {[*_CAPTIONS]}, got {[*style.wasserstein]}")
    figure = new_figure(DOUBLE_COLUMN, 1.45 * len(styles) + 0.5)
    rows = figure.subplots(len(styles), 4, sharex="col", squeeze=False)
    for column, field in enumerate(("closest_goal", "closest_zombie"), start=2):
        edges = _edges([getattr(side, field) for style in styles for side in (style.bots, style.demonstrations)])
        for index, style in enumerate(styles):
            axes = plain_axes(rows[index, column])
            colour = style_colour(index)
            _draw_distances(axes, getattr(style.bots, field), getattr(style.demonstrations, field), edges, colour)
    for index, style in enumerate(styles):
        for column, field in enumerate(("attacked", "zombie_dead")):
            axes = plain_axes(rows[index, column])
            _draw_shares(axes, getattr(style.bots, field), getattr(style.demonstrations, field), style_colour(index))
        _draw_reached(rows[index, 2])
        _draw_range(rows[index, 3], style.demonstrations.closest_zombie)
        rows[index, 0].set_ylabel(f"{style.name}\nshare of episodes", size=SMALL_TEXT_SIZE, color=INK, parse_math=False)
        for axes, field in zip(rows[index], _CAPTIONS, strict=True):
            if field in style.wasserstein:
                _draw_distance(axes, style.wasserstein[field])
    for axes, which, caption in zip(rows[0], "abcd", _CAPTIONS.values(), strict=True):
        letter(axes, which, caption)
    for axes in rows[-1, 2:]:
        axes.set_xlabel("distance", size=SMALL_TEXT_SIZE, color=MUTED)
    above(figure, _handles(styles))
    return figure


def _edges(samples: Sequence[FloatArray]) -> FloatArray:
    """Edges of bins from 0 over all samples, the goal's radius among them."""
    highest = max(1.2 * REACHED, *(float(sample.max()) for sample in samples))
    width = next((width for width in _BIN_WIDTHS if highest < _MOST_BINS * width), REACHED)
    count = int(highest / width) + 1
    return np.linspace(0, width * count, count + 1)


def _draw_shares(axes: Axes, bots: NDArray[np.bool_], demonstrations: NDArray[np.bool_], colour: str) -> None:
    acted, shown = float(bots.mean()), float(demonstrations.mean())
    axes.bar([0, 1], [1 - acted, acted], width=0.6, color=colour, alpha=_ALPHA)
    axes.bar([0, 1], [1 - shown, shown], width=0.6, fill=False, edgecolor=INK)
    axes.set(xlim=(-0.6, 1.6), ylim=(0, _HEADROOM), yticks=[0, 0.5, 1])
    axes.set_xticks([0, 1], ["no", "yes"])


def _draw_distances(axes: Axes, bots: FloatArray, demonstrations: FloatArray, edges: FloatArray, colour: str) -> None:
    acted, shown = (np.histogram(values, edges)[0] / len(values) for values in (bots, demonstrations))
    axes.stairs(acted, edges, fill=True, color=colour, alpha=_ALPHA)
    axes.stairs(shown, edges, color=INK, linewidth=1.0)
    highest = float(max(acted.max(), shown.max()))
    axes.set(xlim=(0, edges[-1]), ylim=(0, _HEADROOM * highest))
    axes.locator_params(axis="y", nbins=4)


def _draw_reached(axes: Axes) -> None:
    axes.axvline(REACHED, ymax=1 / _HEADROOM, color=INK, linewidth=0.9, linestyle="--")


def _draw_range(axes: Axes, distances: FloatArray) -> None:
    low, high = np.percentile(distances, [2.5, 97.5])
    axes.axvspan(low, high, ymax=1 / _HEADROOM, color=RULE, alpha=0.6, linewidth=0, zorder=0)


def _draw_distance(axes: Axes, distance: float) -> None:
    text = f"$W_1$ = {number(distance, 2)}"
    axes.text(0.98, 0.97, text, ha="right", va="top", transform=axes.transAxes, size=SMALL_TEXT_SIZE, color=MUTED)


def _handles(styles: Sequence[StyleOutcomes]) -> list[Patch | Line2D]:
    bots = [
        Patch(color=style_colour(index), alpha=_ALPHA, label=f"bots, {style.name}")
        for index, style in enumerate(styles)
    ]
    return [
        *bots,
        Patch(fill=False, edgecolor=INK, label="demonstrations"),
        Line2D([], [], color=INK, linewidth=0.9, linestyle="--", label="goal reached"),
        Patch(color=RULE, alpha=0.6, label="demonstrated, 2.5 to 97.5 percentile"),
    ]
