"""How errors grow with the steps since the start."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from tvae.figures.canvas import SINGLE_COLUMN, new_figure, plain_axes
from tvae.figures.palette import INK, RULE, STYLE_COLOURS
from tvae.figures.panels import Band, above, draw_band

_LOOKS: tuple[tuple[str, LineStyleType], ...] = (
    (STYLE_COLOURS[0], "-"),
    (STYLE_COLOURS[1], (0, (5, 1.5))),
    (STYLE_COLOURS[2], (0, (5, 1.5, 1, 1.5))),
    (INK, (0, (1, 1.2))),
    (STYLE_COLOURS[3], (0, (3, 1))),
    (STYLE_COLOURS[4], (0, (5, 1, 1, 1, 1, 1))),
)


def horizon(methods: Mapping[str, Band], *, y: str, logarithmic: bool = False) -> Figure:
    """The error of each method over the steps 1 .. T, with its band; `y` says what it is, and its unit.

    Methods look different by their order; they may have different T. A logarithmic axis begins above 0.

    Raises `ValueError` for no method and for more than six.

    >>> band = Band(np.array([1.0, 2.0]), np.array([0.5, 1.5]), np.array([1.5, 2.5]))
    >>> figure = horizon({"T-VAE": band, "behavioural cloning": band}, y="distance")
    >>> [line.get_label() for line in figure.axes[0].lines]
    ['T-VAE', 'behavioural cloning']
    """
    if not 1 <= len(methods) <= len(_LOOKS):
        raise ValueError(f"errors over the horizon need 1 to {len(_LOOKS)} methods, got {len(methods)}")
    figure = new_figure(SINGLE_COLUMN, 2.5)
    axes = plain_axes(figure.add_subplot(), x="step", y=y)
    handles = []
    for (name, band), (colour, line) in zip(methods.items(), _LOOKS, strict=False):
        steps = np.arange(1.0, len(band.mean) + 1)
        handles.append(draw_band(axes, steps, band, colour=colour, line=line))
        handles[-1].set_label(name)
    axes.set_xlim(0, max(len(band.mean) for band in methods.values()))
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.tick_params(which="minor", left=False, labelleft=False)
    else:
        axes.set_ylim(bottom=0)
    axes.grid(axis="y", color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    above(figure, handles, columns=2)
    return figure
