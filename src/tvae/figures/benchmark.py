"""Methods side by side: a panel for each number, a dot with its interval for each method, an open one for one seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from tvae.figures.canvas import SMALL_TEXT_SIZE, new_figure, plain_axes
from tvae.figures.palette import INK, MUTED, PAPER, RULE, STYLE_COLOURS


@dataclass(frozen=True)
class Bar:
    """A method's mean, and its 95 % interval where there are several seeds."""

    name: str
    mean: float
    interval: Sequence[float] | None


def benchmark_figure(rows: Sequence[Mapping[str, Sequence[Bar]]], *, caption: str = "") -> Figure:
    """A row of panels for each task, all between 0 and 1, the methods from top to bottom; a caption below.

    >>> figure = benchmark_figure([{"Zombie: success": [Bar("walk", 0.0, None), Bar("T-VAE", 0.99, (0.98, 1.0))]}])
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['walk', 'T-VAE']
    """
    if not all(rows) or not rows:
        raise ValueError("a figure needs at least one panel in each of one or more rows, got none")
    heights = [0.7 + 0.21 * max(len(bars) for bars in row.values()) for row in rows]
    columns = max(len(row) for row in rows)
    figure = new_figure(4.2 * columns, sum(heights))
    grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
    placed = [(grid[i, j], *panel) for i, row in enumerate(rows) for j, panel in enumerate(row.items())]
    for place_of_panel, title, bars in placed:
        axes = plain_axes(figure.add_subplot(place_of_panel), title=title)
        places = np.arange(len(bars))
        axes.hlines(places, 0, 1, color=RULE, linewidth=0.6)
        for place, bar in zip(places.tolist(), bars, strict=True):
            if bar.interval is not None:
                low, high = np.clip(bar.interval, 0, 1)
                axes.hlines(place, low, high, color=INK, linewidth=1.4)
            inside = PAPER if bar.interval is None else STYLE_COLOURS[0]
            axes.plot(bar.mean, place, "o", color=STYLE_COLOURS[0], markerfacecolor=inside, markersize=4)
        axes.set_yticks(places, [bar.name for bar in bars], size=SMALL_TEXT_SIZE, color=INK)
        axes.set_ylim(len(bars) - 0.5, -0.5)
        axes.set_xlim(-0.03, 1.03)
    figure.supxlabel(caption, size=SMALL_TEXT_SIZE, color=MUTED, parse_math=False)
    return figure
