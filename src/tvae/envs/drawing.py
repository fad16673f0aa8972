"""Pictures of a world: an array of pixels, or a window that shows it live."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Frame: TypeAlias = NDArray[np.uint8]
"""(height, width, 3) red, green and blue from 0 to 255."""

Draw: TypeAlias = Callable[[Axes], None]

_SIZE = (4.0, 4.0)
_DOTS_PER_INCH = 100


def _whole(figure: Figure) -> Axes:
    """Axes as large as the figure, with equal units and nothing around them."""
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect("equal")
    axes.set_axis_off()
    return axes


def picture(draw: Draw) -> Frame:
    """What `draw` draws, as pixels.

    >>> picture(lambda axes: None).shape
    (400, 400, 3)
    """
    figure = Figure(figsize=_SIZE, dpi=_DOTS_PER_INCH)
    canvas = FigureCanvasAgg(figure)
    draw(_whole(figure))
    canvas.draw()  # type: ignore[no-untyped-call]  # of Matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # of Matplotlib
    return np.array(pixels, dtype=np.uint8)[..., :3]


class Window:
    """An interactive window, opened at the first picture."""

    def __init__(self, frames_per_second: float) -> None:
        self._seconds = 1 / frames_per_second
        self._figure: Figure | None = None

    def show(self, draw: Draw) -> None:
        """Show what `draw` draws, for the time of one frame."""
        if self._figure is None:
            with plt.ion():
                self._figure = plt.figure(figsize=_SIZE, dpi=_DOTS_PER_INCH)
        self._figure.clear()
        draw(_whole(self._figure))
        self._figure.canvas.draw_idle()
        self._figure.canvas.start_event_loop(self._seconds)

    def close(self) -> None:
        """Close the window if it is open."""
        if self._figure is not None:
            plt.close(self._figure)
            self._figure = None
