"""Recorded zombie episodes beside what the decoders make of them (figure 5 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tvae.data.trajectory import Trajectory
from tvae.figures.canvas import DOUBLE_COLUMN, SMALL_TEXT_SIZE, TEXT_SIZE
from tvae.figures.palette import INK, MUTED, PAPER, RULE, style_colour
from tvae.figures.panels import above, place, placed
from tvae.figures.trajectories import share_limits
from tvae.figures.zombie import draw_zombie

_ROWS = ("(a) ground truth", "(b) state decoder", "(c) policy decoder")
_LEFT, _GAP, _BETWEEN, _TOP = 0.22, 0.07, 0.14, 0.45
"""Inches left of the cells, between them, more of it between two styles, and above."""


def zombie_reconstructions(
    truth: Sequence[Sequence[Trajectory]],
    imagined: Sequence[Sequence[Trajectory]],
    acted: Sequence[Sequence[Trajectory]],
    names: Sequence[str],
) -> Figure:
    """A block for each style, in it a column for each example, and a row for each of truth and the two decoders.

    `truth[i]`, `imagined[i]` and `acted[i]` are the k examples of the style `names[i]`; the episodes of a column
    should begin with the same zombie. All cells have one scale.

    Raises `ValueError` where the numbers of examples differ.

    >>> import numpy as np
    >>> seen = np.array([[7.1, 0.8, 2.0, 1.5], [6.6, 0.8, 1.3, 1.5]])
    >>> episodes = [[Trajectory(seen, np.array([[0.0, 0.8], [1.0, 0.8]]))]] * 2
    >>> figure = zombie_reconstructions(episodes, episodes, episodes, ["attack", "avoid"])
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['attack', 'avoid', '', '', '', '']
    """
    counts = [[len(examples) for examples in episodes] for episodes in (truth, imagined, acted)]
    wanted = [counts[0][0] if counts[0] else 0] * len(names)
    if counts != [wanted] * 3 or not sum(wanted):
        raise ValueError(f"each of {len(names)} styles needs as many examples in all three rows, got {counts}")
    num_examples = wanted[0]
    step = (DOUBLE_COLUMN - _LEFT - _BETWEEN * (len(names) - 1)) / sum(wanted)
    side = step - _GAP
    figure = placed(DOUBLE_COLUMN, 3 * step + _TOP)
    cells = []
    for row, episodes in enumerate((truth, imagined, acted)):
        for style, examples in enumerate(episodes):
            for column, episode in enumerate(examples):
                left = _LEFT + style * _BETWEEN + (style * num_examples + column) * step
                axes = place(figure, left, _GAP + (2 - row) * step, side, side)
                _draw_cell(axes, episode, style_colour(style))
                if row == column == 0:
                    axes.set_title(
                        names[style], loc="left", size=TEXT_SIZE, color=style_colour(style), parse_math=False
                    )
                if style == column == 0:
                    axes.set_ylabel(_ROWS[row], size=SMALL_TEXT_SIZE, color=INK)
                cells.append(axes)
    share_limits(cells)
    above(figure, _handles())
    return figure


def _draw_cell(axes: Axes, episode: Trajectory, colour: str) -> None:
    draw_zombie(axes, episode, colour)
    axes.set(xticks=[], yticks=[], facecolor="none")
    for spine in axes.spines.values():
        spine.set(color=RULE, linewidth=0.6)


def _handles() -> list[Line2D]:
    def mark(label: str, marker: str, *, face: str = INK, size: float = 4) -> Line2D:
        return Line2D([], [], color=INK, marker=marker, markersize=size, markerfacecolor=face, ls="", label=label)

    return [
        Line2D([], [], color=INK, linewidth=1.1, label="agent"),
        Line2D([], [], color=MUTED, linewidth=1.1, linestyle=(0, (1, 1.5)), label="zombie"),
        mark("start", "o", face=PAPER),
        mark("end", "o"),
        mark("attack", "x", size=5),
        Line2D([], [], color=MUTED, linewidth=0.8, label="goal"),
        Line2D([], [], color=MUTED, linewidth=0.8, linestyle=":", label="the zombie's range at the end"),
    ]
