"""What the figures of the paper share: lettered panels, many paths in one plane, bands, and legends above them.

>>> from tvae.figures.canvas import new_figure, plain_axes
>>> figure = new_figure(3.4, 2.4)
>>> axes = letter(plain_axes(figure.add_subplot()), "a", "ground truth")
>>> axes.get_title(loc="left")
'(a) ground truth'
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.typing import LineStyleType

from tvae.figures.canvas import SMALL_TEXT_SIZE, TEXT_SIZE
from tvae.figures.palette import INK, MUTED, PAPER, style_colour, style_marker
from tvae.spaces import FloatArray, IntArray

Limits: TypeAlias = tuple[tuple[float, float], tuple[float, float]]

_LANDMARK_LINES: tuple[LineStyleType, ...] = ((0, (3, 1.5)), (0, (1, 1.2)), (0, (4, 1.5, 1, 1.5)))
_MOST_VECTOR_POINTS = 50_000


@dataclass(frozen=True)
class Landmark:
    """A place of the world that a reader should see behind the paths; places of one name look alike."""

    name: str
    x: float
    y: float
    radius: float


class Band(NamedTuple):
    """A curve and how sure it is."""

    mean: FloatArray
    """(K,)"""
    low: FloatArray
    """(K,)"""
    high: FloatArray
    """(K,)"""


def placed(width: float, height: float) -> Figure:
    """A figure of `width` x `height` inches whose axes stay where `place` puts them."""
    return Figure((width, height), facecolor=PAPER)


def place(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """New axes `width` x `height` inches large, so far from the left and the bottom of a `placed` figure.

    Planes have to be placed: a layout that makes room by itself forgets labels of axes with a fixed aspect.

    >>> axes = place(placed(4, 2), 1, 0.5, 2, 1)
    >>> axes.get_position().get_points().tolist()
    [[0.25, 0.25], [0.75, 0.75]]
    """
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def number(value: float, digits: int = 1) -> str:
    """`value` to so many digits after the point, with a true minus sign, and no minus before a zero.

    >>> number(-1.25, 2), number(-0.01)
    ('−1.25', '0.0')
    """
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def letter(axes: Axes, which: str, caption: str) -> Axes:
    """The same axes with the title `(which) caption`, shown to the letter."""
    axes.set_title(f"({which}) {caption}", loc="left", size=TEXT_SIZE, color=INK, parse_math=False)
    return axes


def typical(paths: Sequence[FloatArray]) -> int:
    """Which of the paths (N_i, 2) passes nearest to the mean of all their half-way points.

    >>> typical([np.full((3, 2), height) for height in (0.0, 1.0, 5.0)])
    1
    """
    middles = np.array([path[len(path) // 2] for path in paths])
    return int(np.hypot(*(middles - middles.mean(0)).T).argmin())


def limits(paths: Sequence[FloatArray], landmarks: Sequence[Landmark] = (), *, widest: float = 1.0) -> Limits:
    """Limits of x and of y that show all the paths (N_i, 2) and landmarks, with a margin of 5 % on every side.

    The sides of the rectangle are in a ratio of at most `widest`; 1 is a square.

    >>> [(round(low, 6), round(high, 6)) for low, high in limits([np.array([[0.0, 0.0], [10.0, 4.0]])], widest=2.0)]
    [(-0.5, 10.5), (-0.75, 4.75)]
    """
    if not paths:
        raise ValueError("limits need at least one path, got none")
    places = np.array([[mark.x, mark.y] for mark in landmarks]).reshape(-1, 2)
    radii = np.array([[mark.radius] for mark in landmarks]).reshape(-1, 1)
    points = np.concatenate([*paths, places - radii, places + radii])
    low, high = points.min(0), points.max(0)
    sides = np.maximum(high - low, 1e-9) * 1.1
    sides = np.maximum(sides, sides.max() / widest)
    (left, bottom), (right, top) = ((low + high - sides) / 2).tolist(), ((low + high + sides) / 2).tolist()
    return (left, right), (bottom, top)


def draw_paths(axes: Axes, paths: Sequence[FloatArray], labels: IntArray) -> None:
    """Paths (N_i, 2) as thin translucent lines in the colours of their styles (E,), drawn in their order.

    The marker of a style stands once, half-way on its `typical` path.

    >>> axes = Figure().add_subplot()
    >>> draw_paths(axes, [np.eye(2), np.ones((3, 2))], np.array([0, 1]))
    >>> len(axes.collections[0].get_segments()), [line.get_marker() for line in axes.lines]
    (2, ['o', '^'])
    """
    if len(paths) != len(labels):
        raise ValueError(f"each path needs one label, got {len(paths)} paths and {len(labels)} labels")
    alpha = float(np.clip(40 / max(len(paths), 1), 0.3, 0.9))
    lines = LineCollection(
        list(paths),
        colors=[to_rgba(style_colour(int(style)), alpha) for style in labels],
        linewidths=0.5,
        capstyle="round",
        rasterized=sum(map(len, paths)) > _MOST_VECTOR_POINTS,
    )
    axes.add_collection(lines)
    for style in np.unique(labels):
        members = [path for path, label in zip(paths, labels, strict=True) if label == style]
        path = members[typical(members)]
        (marker,) = axes.plot(*path[len(path) // 2])
        _dress(marker, int(style))


def _dress(line: Line2D, style: int) -> Line2D:
    line.set(color=style_colour(style), marker=style_marker(style), markersize=5)
    line.set(markeredgecolor=PAPER, markeredgewidth=0.6)
    return line


def draw_landmarks(axes: Axes, landmarks: Sequence[Landmark]) -> None:
    """A quiet circle for each landmark, behind the paths; the line differs between names.

    >>> axes = Figure().add_subplot()
    >>> draw_landmarks(axes, [Landmark("goal", 5.0, 5.0, 0.5)])
    >>> axes.patches[0].center
    (5.0, 5.0)
    """
    for name, line in _lines(landmarks).items():
        for mark in landmarks:
            if mark.name == name:
                circle = Circle((mark.x, mark.y), mark.radius, fill=False, edgecolor=MUTED, linestyle=line)
                circle.set(linewidth=0.7, zorder=0.5, label=name)
                axes.add_patch(circle)


def _lines(landmarks: Sequence[Landmark]) -> dict[str, LineStyleType]:
    names = dict.fromkeys(mark.name for mark in landmarks)
    return {name: _LANDMARK_LINES[index % len(_LANDMARK_LINES)] for index, name in enumerate(names)}


def landmark_handles(landmarks: Sequence[Landmark]) -> list[Line2D]:
    """A line for the legend for each name of a landmark.

    >>> [line.get_label() for line in landmark_handles([Landmark("goal", x, 0.0, 0.5) for x in (1.0, 2.0)])]
    ['goal']
    """
    return [
        Line2D([], [], color=MUTED, linewidth=0.7, linestyle=line, label=name)
        for name, line in _lines(landmarks).items()
    ]


def style_handles(names: Sequence[str], styles: Sequence[int]) -> list[Line2D]:
    """A line with a marker for the legend for each of these styles, indices of `names`.

    >>> [(line.get_label(), line.get_marker()) for line in style_handles(["attack", "avoid"], [1])]
    [('avoid', '^')]
    """
    return [_dress(Line2D([], [], linewidth=1.1, label=names[style]), style) for style in styles]


def draw_band(axes: Axes, x: FloatArray, band: Band, *, colour: str, line: LineStyleType, marker: str = "") -> Line2D:
    """The mean (K,) over x (K,) as a line, and a translucent band from `low` to `high`; the line comes back.

    Raises `ValueError` where the shapes differ.

    >>> band = Band(np.array([1.0, 2.0]), np.array([0.5, 1.0]), np.array([1.5, 3.0]))
    >>> draw_band(Figure().add_subplot(), np.arange(2.0), band, colour=INK, line="--").get_ydata()
    array([1., 2.])
    """
    shapes = [np.shape(values) for values in band]
    if {*shapes} != {x.shape}:
        raise ValueError(f"a band over {x.shape} values needs a mean, low and high of that shape, got {shapes}")
    axes.fill_between(x, band.low, band.high, color=colour, alpha=0.18, linewidth=0)
    (mean,) = axes.plot(x, band.mean, color=colour, linestyle=line, linewidth=1.3, marker=marker, markersize=4)
    return mean


def above(
    figure: Figure, handles: Sequence[Artist], *, columns: int | None = None, handlelength: float = 2.0
) -> Legend:
    """A legend of these handles above all panels, in one row unless `columns` says how many stand in a row.

    A `handlelength`, in letters, of 3.5 shows how a line is dashed.

    >>> [text.get_text() for text in above(Figure(), style_handles(["attack"], [0])).get_texts()]
    ['attack']
    """
    legend = figure.legend(
        handles=list(handles),
        loc="outside upper left",
        ncols=columns or max(len(handles), 1),
        frameon=False,
        fontsize=SMALL_TEXT_SIZE,
        labelcolor=INK,
        handlelength=handlelength,
        handletextpad=0.5,
        columnspacing=1.4,
        borderaxespad=0.1,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
    return legend
