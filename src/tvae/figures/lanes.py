"""Signals over time, one lane below the other, each with its own scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from matplotlib.axes import Axes

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.figures.canvas import SMALL_TEXT_SIZE
from tvae.figures.palette import INK, MUTED
from tvae.spaces import Angular, Binary, Categorical, Continuous, FloatArray, Signal, Space

_MOST_LANES = 6
_MOST_STEPS = 150
_MOST_LETTERS = 24
_HEIGHT = 0.6
"""Of the signal in its lane, whose height is 1."""


@dataclass(frozen=True, eq=False)
class Scales:
    """The lowest and the highest value of each signal, as rows of a space hold them."""

    observations: FloatArray
    """(O, 2)"""
    actions: FloatArray
    """(A, 2)"""

    @classmethod
    def of(cls, demonstrations: Demonstrations) -> Scales:
        """Those over all demonstrations, so that their pictures can be compared.

        >>> from tvae.data.arrays import from_arrays
        >>> Scales.of(from_arrays([np.arange(4.0)] * 5, [np.ones(3)] * 5)).observations.tolist()
        [[0.0, 3.0]]
        """
        return cls.of_rows(demonstrations.observations, demonstrations.actions)

    @classmethod
    def of_rows(cls, observations: FloatArray, actions: FloatArray) -> Scales:
        """Those of rows (N, O) and (M, A)."""
        return cls(*(np.stack([rows.min(axis=0), rows.max(axis=0)], axis=1) for rows in (observations, actions)))


def is_number(signal: Signal) -> bool:
    """Whether its values are numbers on a line: continuous, or categories that are integers."""
    match signal:
        case Categorical():
            return all(isinstance(category, int) for category in signal.categories)
        case _:
            return isinstance(signal, Continuous)


def numbers_of(space: Space, rows: FloatArray, column: int) -> FloatArray:
    """A column's values (N,): of an integer category the integer itself, not its index."""
    signal = space.signals[column]
    if isinstance(signal, Categorical) and is_number(signal):
        return np.array(signal.categories, dtype=float)[rows[:, column].astype(np.int64)]
    return rows[:, column]


def draw_lanes(
    axes: Axes, trajectory: Trajectory, observation_space: Space, action_space: Space, colour: str, scales: Scales
) -> None:
    """A lane for each signal that varies in `scales`, the first `_MOST_LANES` of them, observations before actions.

    Above a lane stands the name of its signal, and to the right what its bottom and its top are.

    >>> from tvae.figures.canvas import new_figure
    >>> walk, space = Trajectory(np.array([[20.0], [40.0]]), np.zeros((1, 0))), Space((Continuous("height"),))
    >>> axes = new_figure(2, 2).add_subplot()
    >>> draw_lanes(axes, walk, space, Space(()), INK, Scales(np.array([[0.0, 80.0]]), np.zeros((0, 2))))
    >>> [text.get_text() for text in axes.texts], axes.lines[0].get_ydata().tolist()
    (['height', '0 to 80'], [0.15, 0.3])
    """
    lanes = [
        (signal, space, rows, column, ends[column], shade, role)
        for space, rows, ends, shade, role in (
            (observation_space, trajectory.observations, scales.observations, colour, "observations"),
            (action_space, trajectory.actions, scales.actions, MUTED, "actions"),
        )
        for column, signal in enumerate(space.signals)
        if ends[column][0] < ends[column][1]
    ][:_MOST_LANES]
    if not lanes:
        axes.text(0.5, 0.5, "nothing varies", ha="center", size=SMALL_TEXT_SIZE, color=MUTED)
    stride = ceil(len(trajectory) / _MOST_STEPS)
    for lane, (signal, space, rows, column, ends, shade, role) in enumerate(lanes):
        floor = -float(lane)
        values = numbers_of(space, rows, column)
        low, high = numbers_of(space, np.tile(ends[:, None], (1, column + 1)), column)
        steps = np.arange(len(values))[::stride]
        heights = (floor + _HEIGHT * (values - low) / max(high - low, 1e-300))[::stride]
        name = signal.name if len(signal.name) <= _MOST_LETTERS else signal.name[: _MOST_LETTERS - 1] + "…"
        axes.text(0, floor + 0.66, name, size=5.5, color=MUTED, parse_math=False)
        if is_number(signal):
            axes.text(
                0.98,
                floor + 0.66,
                f"{low:.4g} to {high:.4g}",
                size=5.0,
                color=MUTED,
                ha="right",
                transform=axes.get_yaxis_transform(),
            )
        match signal:
            case Binary():
                on = np.flatnonzero(values)
                axes.plot(on, np.full(len(on), floor + 0.3), "|", markersize=6, color=INK)
            case Angular():
                turned = np.abs(np.diff(values[::stride], prepend=values[0])) > np.pi
                axes.plot(steps, np.where(turned, np.nan, heights), color=shade, linewidth=0.9, label=role)
            case Continuous():
                axes.plot(steps, heights, color=shade, linewidth=0.9, label=role)
            case Categorical():
                axes.step(steps, heights, where="post", color=shade, linewidth=0.9, label=role)
    axes.set_ylim(-max(len(lanes), 1) + 0.9, 1)
