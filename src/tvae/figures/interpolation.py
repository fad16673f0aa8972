"""What the decoders make of a grid of latents (figure 3 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tvae.figures.canvas import DOUBLE_COLUMN, SMALL_TEXT_SIZE, plain_axes
from tvae.figures.palette import INK, MUTED, RULE, style_colour, style_marker
from tvae.figures.panels import (
    Landmark,
    Limits,
    above,
    draw_landmarks,
    landmark_handles,
    letter,
    limits,
    number,
    place,
    placed,
    style_handles,
)
from tvae.spaces import FloatArray, IntArray

Cells: TypeAlias = Sequence[Sequence[Sequence[FloatArray]]]
"""R rows of C cells, each with one or more paths (N_i, 2)."""

_BETWEEN = "between the styles"
_WIDEST = 1.5
_LEFT, _BOTTOM, _RIGHT, _TOP = 0.48, 0.52, 0.06, 0.45
"""Inches around the blocks."""


def interpolation(
    grid: FloatArray,
    imagined: Cells,
    acted: Cells,
    nearest: IntArray,
    names: Sequence[str],
    *,
    landmarks: Sequence[Landmark] = (),
) -> Figure:
    """A grid of latents (R, C, 2), each decoded by the state decoder (a) and by the policy decoder (b).

    z_0 rises from left to right, z_1 from the bottom to the top: `grid[0]` is the top row. A cell is drawn in
    the look of its style `nearest` (R, C), an index of `names`, or in black where that is -1, between the
    styles. All cells have one scale, which stands below.

    Raises `ValueError` where z_0 differs within a column or z_1 within a row, or shapes do not fit.

    >>> z_0, z_1 = np.meshgrid([-1.0, 1.0], [1.0, -1.0])
    >>> cells = [[[np.array([[0.0, 0.0], [a, b]])] for a, b in zip(*row)] for row in zip(z_0, z_1)]
    >>> figure = interpolation(np.stack([z_0, z_1], 2), cells, cells, np.array([[0, 1], [-1, 1]]), ["up", "side"])
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['up', 'side', 'between the styles']
    """
    _check(grid, imagined, acted, nearest)
    scale = _scale([path for cells in (imagined, acted) for row in cells for cell in row for path in cell], landmarks)
    num_rows, num_columns = nearest.shape
    height = (scale[1][1] - scale[1][0]) / (scale[0][1] - scale[0][0])
    width = (DOUBLE_COLUMN - 2 * _LEFT - _RIGHT) / 2
    high = width * height * num_rows / num_columns
    figure = placed(DOUBLE_COLUMN, _BOTTOM + high + _TOP)
    blocks = [place(figure, left, _BOTTOM, width, high) for left in (_LEFT, 2 * _LEFT + width)]
    for block, which, caption, cells in zip(
        blocks, "ab", ("state decoder", "policy decoder, in the environment"), (imagined, acted), strict=True
    ):
        _frame(letter(plain_axes(block), which, caption), grid, height)
        for row in range(num_rows):
            for column in range(num_columns):
                corner = (column, num_rows - 1 - row, 1, 1)
                axes = block.inset_axes(corner, transform=block.transData)
                _draw_cell(axes, cells[row][column], int(nearest[row, column]), landmarks, scale)
    handles = style_handles(names, [style for style in np.unique(nearest).tolist() if style >= 0])
    if (nearest < 0).any():
        handles.append(Line2D([], [], color=INK, linewidth=1.1, label=_BETWEEN))
    above(figure, [*handles, *landmark_handles(landmarks)])
    sides = [f"{number(low, 0)} to {number(high, 0)}" for low, high in scale]
    figure.text(
        1 - _RIGHT / DOUBLE_COLUMN,
        0.04 / figure.get_figheight(),
        f"every cell: x from {sides[0]}, y from {sides[1]}",
        ha="right",
        va="bottom",
        size=SMALL_TEXT_SIZE,
        color=MUTED,
    )
    return figure


def _scale(paths: Sequence[FloatArray], landmarks: Sequence[Landmark]) -> Limits:
    """Limits of a cell, which may be wider than high, and never is higher than wide."""
    x, y = limits(paths, landmarks, widest=_WIDEST)
    return (x, y) if x[1] - x[0] >= y[1] - y[0] else limits(paths, landmarks)


def _check(grid: FloatArray, imagined: Cells, acted: Cells, nearest: IntArray) -> None:
    if grid.ndim != 3 or grid.shape[2] != 2 or nearest.shape != grid.shape[:2]:
        raise ValueError(f"a grid (R, C, 2) needs nearest (R, C), got {grid.shape} and {nearest.shape}")
    if not (np.allclose(grid[:, :, 0], grid[:1, :, 0]) and np.allclose(grid[:, :, 1], grid[:, :1, 1])):
        raise ValueError("a grid needs one z_0 in each column and one z_1 in each row")
    for name, cells in (("imagined", imagined), ("acted", acted)):
        shape = [len(row) for row in cells]
        if shape != [nearest.shape[1]] * nearest.shape[0]:
            raise ValueError(f"{name} needs {nearest.shape[0]} rows of {nearest.shape[1]} cells, got rows of {shape}")


def _frame(block: Axes, grid: FloatArray, height: float) -> None:
    """The values of z_0 below the columns and of z_1 left of the rows, of cells `height` times as high as wide."""
    num_rows, num_columns = grid.shape[:2]
    block.set(xlim=(0, num_columns), ylim=(0, num_rows), aspect=height)
    block.set_xticks(np.arange(num_columns) + 0.5, [number(value, 1) for value in grid[0, :, 0]])
    block.set_yticks(np.arange(num_rows) + 0.5, [number(value, 1) for value in grid[::-1, 0, 1]])
    block.set_xlabel("$z_0$", size=SMALL_TEXT_SIZE, color=MUTED, parse_math=True)
    block.set_ylabel("$z_1$", size=SMALL_TEXT_SIZE, color=MUTED, parse_math=True)
    block.tick_params(length=0)
    for spine in block.spines.values():
        spine.set_visible(False)


def _draw_cell(
    axes: Axes, paths: Sequence[FloatArray], style: int, landmarks: Sequence[Landmark], scale: Limits
) -> None:
    colour = INK if style < 0 else style_colour(style)
    draw_landmarks(axes, landmarks)
    for path in paths:
        axes.plot(*path.T, color=colour, linewidth=0.9, alpha=1.0 if len(paths) == 1 else 0.6)
    if style >= 0 and paths:
        axes.plot(*paths[0][-1], color=colour, marker=style_marker(style), markersize=3.2)
    axes.set(xlim=scale[0], ylim=scale[1], aspect="equal", xticks=[], yticks=[], facecolor="none")
    for spine in axes.spines.values():
        spine.set(color=RULE, linewidth=0.6)
