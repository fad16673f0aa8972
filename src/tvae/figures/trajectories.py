"""Any trajectory as a picture: its paths where observations have places in a plane, else signals over time.

A task with a better picture of itself gives its own `Draw` function, which `grid` and the report take alike.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from matplotlib.typing import LineStyleType
from numpy.typing import NDArray

from tvae.data.trajectory import Trajectory
from tvae.figures.canvas import SMALL_TEXT_SIZE, new_figure
from tvae.figures.lanes import Scales, draw_lanes, is_number, numbers_of
from tvae.figures.palette import ALERT, INK, MUTED, PAPER
from tvae.spaces import FloatArray, Space

Draw: TypeAlias = Callable[[Axes, Trajectory], None]
"""Draws one episode on axes, which may hold others already."""

_PLACE = re.compile(r"(?P<head>.*[._/ -])?(?P<axis>[xy])(?P<tail>[._/ -].*)?", re.IGNORECASE)
_NO_PLACE = {"velocity", "vel", "speed", "delta", "force", "acceleration", "acc", "orientation", "direction"}
_LINES: tuple[LineStyleType, ...] = ("-", (0, (4, 1.5)), (0, (1, 1.5)))
_EVENT_MARKERS = ("x", "+", "1", "2")


@dataclass(frozen=True)
class Plane:
    """Two columns that together are a place."""

    name: str
    x: int
    y: int


def planes(space: Space) -> tuple[Plane, ...]:
    """The places among the signals: pairs of columns whose names differ in an x and a y only.

    >>> from tvae.spaces import Continuous
    >>> agent = [Continuous(name) for name in ("agent_x", "agent_y", "velocity_x", "velocity_y", "energy")]
    >>> planes(Space(tuple(agent)))
    (Plane(name='agent', x=0, y=1),)
    """
    found = []
    columns = {name: column for column, name in enumerate(space.names)}
    for name, column in columns.items():
        match = _PLACE.fullmatch(name)
        if match is None or match["axis"] not in "xX":
            continue
        head, tail = match["head"] or "", match["tail"] or ""
        twin = columns.get(head + ("y" if match["axis"] == "x" else "Y") + tail)
        words = re.split(r"[._/ -]", (head + tail).lower())
        numbers = all(is_number(space.signals[c]) for c in (column, twin) if c is not None)
        if twin is not None and numbers and not _NO_PLACE.intersection(words):
            found.append(Plane((head + tail).strip("._/ -"), column, twin))
    return tuple(found)


def draw_trajectory(
    axes: Axes,
    trajectory: Trajectory,
    observation_space: Space,
    action_space: Space,
    colour: str,
    scales: Scales | None = None,
) -> None:
    """Paths in the plane, or the signals over time, with the steps marked at which a binary action was taken.

    A path begins at the open circle and ends at the full one; the first place's is in `colour`. Each signal over time
    has its own scale: `scales`, by default that of this trajectory.

    >>> from tvae.spaces import Binary, Continuous
    >>> place = Space((Continuous("x"), Continuous("y")))
    >>> walk = Trajectory(np.cumsum(np.ones((5, 2)), 0), np.array([[0.0], [1.0], [0.0], [0.0]]))
    >>> axes = new_figure(2, 2).add_subplot()
    >>> draw_trajectory(axes, walk, place, Space((Binary("jump"),)), "#0072b2")
    >>> axes.lines[-1].get_label(), axes.lines[-1].get_xydata().tolist()
    ('jump', [[2.0, 2.0]])
    """
    found = planes(observation_space)
    if not found:
        own = scales or Scales.of_rows(trajectory.observations, trajectory.actions)
        draw_lanes(axes, trajectory, observation_space, action_space, colour, own)
        return
    axes.set_aspect("equal")
    paths = [
        np.stack([numbers_of(observation_space, trajectory.observations, c) for c in (plane.x, plane.y)], 1)
        for plane in found
    ]
    for index in reversed(range(len(paths))):
        shade = MUTED if index else colour
        draw_path(axes, paths[index], shade, linestyle=_LINES[index % len(_LINES)], label=found[index].name)
    for marker, column in zip(_EVENT_MARKERS, action_space.binary, strict=False):
        at = paths[0][: len(trajectory)][trajectory.actions[:, column] == 1]
        draw_events(axes, at, marker=marker, label=action_space.names[column])


def draw_path(axes: Axes, path: FloatArray, colour: str, *, linestyle: LineStyleType = "-", label: str = "") -> None:
    """A path (N, 2): a line from an open circle to a full one."""
    axes.plot(*path.T, color=colour, linewidth=1.1, linestyle=linestyle, label=label)
    for name, end, face in (("start", path[:1], PAPER), ("end", path[-1:], colour)):
        axes.plot(*end.T, "o", color=colour, markersize=3.6, markerfacecolor=face, markeredgewidth=0.9, label=name)


def draw_events(axes: Axes, at: FloatArray, *, marker: str = "x", label: str = "") -> None:
    """A mark at each of these places (N, 2)."""
    if len(at):
        axes.plot(*at.T, marker, markersize=5, color=INK, markeredgewidth=1.3, label=label)


def grid(
    trajectories: Sequence[Trajectory],
    draw: Draw,
    titles: Sequence[str] = (),
    *,
    flagged: NDArray[np.bool_] | None = None,
    num_columns: int = 6,
) -> Figure:
    """Small multiples, all at the same scale; those flagged (N,) are framed, and their titles stand out.

    >>> from tvae.spaces import Continuous
    >>> place = Space((Continuous("x"), Continuous("y")))
    >>> walks = [Trajectory(np.cumsum(np.ones((5, 2)), 0) * k, np.zeros((4, 1))) for k in (1, 2)]
    >>> figure = grid(walks, lambda axes, walk: draw_path(axes, walk.observations, INK), ["short", "long"])
    >>> figure.axes[0].get_xlim() == figure.axes[1].get_xlim()
    True
    """
    if not trajectories:
        raise ValueError("a grid needs at least one trajectory, got none")
    num_columns = min(num_columns, len(trajectories))
    num_rows = ceil(len(trajectories) / num_columns)
    figure = new_figure(1.15 * num_columns, (1.3 if titles else 1.15) * num_rows)
    cells = [figure.add_subplot(num_rows, num_columns, index + 1) for index in range(len(trajectories))]
    for index, (axes, trajectory) in enumerate(zip(cells, trajectories, strict=True)):
        flag = flagged is not None and bool(flagged[index])
        draw(axes, trajectory)
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_facecolor("none")
        for spine in axes.spines.values():
            spine.set_visible(flag)
            spine.set_color(ALERT)
        if titles:
            colour = ALERT if flag else INK
            axes.set_title(titles[index], size=SMALL_TEXT_SIZE, color=colour, pad=2, parse_math=False)
    share_limits(cells)
    return figure


def share_limits(cells: Sequence[Axes]) -> None:
    """Give axes whose limits nobody chose those that show the data of all of them; a plane gets a square."""
    free = [axes for axes in cells if np.isfinite(axes.dataLim.get_points()).all()]
    if not free:
        return
    box = Bbox.union([axes.dataLim for axes in free])
    width, height = max(box.width, 1e-9), max(box.height, 1e-9)
    for axes in free:
        if axes.get_aspect() != "auto":
            width = height = max(width, height)
        horizontal, vertical = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
        if axes.get_autoscalex_on():
            axes.set_xbound(horizontal - 0.54 * width, horizontal + 0.54 * width)
        if axes.get_autoscaley_on():
            axes.set_ybound(vertical - 0.54 * height, vertical + 0.54 * height)
