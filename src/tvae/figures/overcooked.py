"""A game of Overcooked as a picture: how often each cook has gone round the kitchen, and when a soup was delivered."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from tvae.data.trajectory import Trajectory
from tvae.figures.palette import INK, MUTED, STYLE_COLOURS
from tvae.spaces import FloatArray

_MIDDLE = (2.0, 2.0)
"""The counter in the middle of `coordination_ring`, in cells from the top left corner."""


def laps(x: FloatArray, y: FloatArray, middle: tuple[float, float] = _MIDDLE) -> FloatArray:
    """(T,) turns around `middle` since the first of the T places; positive is clockwise on a screen (y down).

    >>> laps(np.array([3.0, 2.0, 1.0, 2.0, 3.0]), np.array([2.0, 3.0, 2.0, 1.0, 2.0])).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    angle = np.unwrap(np.arctan2(y - middle[1], x - middle[0]))
    return (angle - angle[0]) / (2 * np.pi)


def draw_overcooked(axes: Axes, trajectory: Trajectory, colour: str = STYLE_COLOURS[0]) -> None:
    """Laps of the first cook (full line) and of the second (dashed) over the steps; a bar where a soup is delivered.

    Needs the step columns `info.x_0`, `info.y_0`, `info.x_1`, `info.y_1` and `reward`.

    >>> from tvae.figures.canvas import new_figure
    >>> axes = new_figure(2, 2).add_subplot()
    >>> columns = {f"info.{name}": np.array([3.0, 2.0]) for name in ("x_0", "y_0", "x_1", "y_1")}
    >>> game = Trajectory(np.zeros((2, 1)), np.zeros((2, 1)), {**columns, "reward": np.array([0.0, 20.0])})
    >>> draw_overcooked(axes, game)
    >>> [line.get_label() for line in axes.lines]
    ['laps of player 1', 'laps of player 0', 'soup']
    """
    for player, shade, style in ((1, MUTED, "--"), (0, colour, "-")):
        x, y = (np.asarray(trajectory.steps[f"info.{axis}_{player}"], dtype=np.float64) for axis in "xy")
        turned = laps(x, y)
        axes.plot(np.arange(len(turned)), turned, style, color=shade, linewidth=1.1, label=f"laps of player {player}")
    soups = np.flatnonzero(np.asarray(trajectory.steps["reward"]) > 0)
    if len(soups):
        axes.plot(soups, np.zeros(len(soups)), "|", color=INK, markersize=6, label="soup")
