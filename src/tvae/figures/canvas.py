"""Empty figures in the house style, and how a finished one is kept.

>>> figure = new_figure(3.4, 2.4)
>>> axes = plain_axes(figure.add_subplot(), title="How long episodes last", y="steps")
>>> [spine for spine in axes.spines if axes.spines[spine].get_visible()]
['left', 'bottom']
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tvae.figures.palette import INK, MUTED, PAPER
from tvae.files import appearing

SINGLE_COLUMN = 3.4
DOUBLE_COLUMN = 7.0
"""Widths of a figure on a page of two columns, in inches."""

TEXT_SIZE = 8.0
SMALL_TEXT_SIZE = 7.0


def new_figure(width: float, height: float) -> Figure:
    """A figure of `width` x `height` inches that makes room for its labels by itself."""
    return Figure((width, height), layout="constrained", facecolor=PAPER)


def plain_axes(axes: Axes, *, title: str = "", x: str = "", y: str = "") -> Axes:
    """The same axes with two thin spines, small quiet ticks, and these words, shown to the letter."""
    axes.set_facecolor("none")
    for side, spine in axes.spines.items():
        spine.set_visible(side in {"left", "bottom"})
        spine.set_color(MUTED)
        spine.set_linewidth(0.6)
    axes.tick_params(colors=MUTED, labelsize=SMALL_TEXT_SIZE, width=0.6, length=2.5)
    axes.set_title(title, loc="left", size=TEXT_SIZE, color=INK, parse_math=False)
    axes.set_xlabel(x, size=SMALL_TEXT_SIZE, color=MUTED, parse_math=False)
    axes.set_ylabel(y, size=SMALL_TEXT_SIZE, color=MUTED, parse_math=False)
    return axes


def save(figure: Figure, path: Path) -> None:
    """Write `path` + `.png` and `path` + `.svg`; equal figures give equal bytes.

    A dot in the name stays: `world_0.2` becomes `world_0.2.png` and `world_0.2.svg`.
    """
    with matplotlib.rc_context({"svg.hashsalt": "tvae"}):
        for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None, "Creator": None})):
            with appearing(path.with_name(f"{path.name}.{suffix}"), overwrite=True) as partial:
                figure.savefig(partial, format=suffix, dpi=200, metadata=metadata)
