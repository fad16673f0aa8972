"""Episodes of one style of the zombie task as they unfold, beside the latent of each.

The grid shows what the bot sees of its past: the rolling window is in full colour, what lies before it faded.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tvae.figures.canvas import SMALL_TEXT_SIZE, TEXT_SIZE, plain_axes
from tvae.figures.latent import latent_plane
from tvae.figures.palette import ALERT, INK, MUTED, PAPER, style_colour, style_marker
from tvae.figures.scene import Scene
from tvae.figures.video import DOTS_PER_INCH, FRAMES_PER_SECOND
from tvae.figures.zombie_cell import KEY_SIZE, ZombieCell, draw_key, square_around
from tvae.spaces import FloatArray

_WIDTH, _HEIGHT = 7.0, 4.2
_GRID = (0.12, 0.4, 3.44)
"""Left, bottom and side of the square of episodes, in inches."""
_GAP = 0.05
_LATENT = (4.4, 1.74, 2.48)
"""Left, bottom and width of the latent plane, in inches; its height is what the words above it leave."""
_KEY = (3.82, 0.1)
"""Left and bottom, in inches."""
_TITLE, _CAPTION, _TOP, _LINE = 4.01, 0.21, 4.06, 0.16
"""Heights of the title, of the caption, of the first legend line, and between lines, in inches."""
_LIGHT = 0.35
"""How much of a style's colour the demonstrations keep; the rest is paper."""
_HELD_FRAMES = 15


def animate(scene: Scene, rate: float, total: int) -> FuncAnimation:
    """The episodes step by step, each framed when it ends; beside them the latent plane.

    `rate` is the share of `total` episodes that succeeded, of which the scene's are some: the caption says
    both counts. A frame a step, from the start to the end of the longest episode, then 1.5 seconds of rest.

    Raises `ValueError` for a rate outside [0, 1], or a total less than the number of episodes.

    >>> import tempfile
    >>> from tvae.data.trajectory import Trajectory
    >>> seen = np.array([[7.1, 0.8, 2.0, 1.5], [6.6, 0.8, 1.3, 1.5]])
    >>> episode, z = Trajectory(seen, np.array([[0.0, 0.8]])), np.array([[0.0, 1.0]])
    >>> scene = Scene([episode], np.array([True]), z, 2, "attack", 0, z, np.array([0]), ["attack"])
    >>> animate(scene, rate=0.963, total=1000).save(tempfile.mkdtemp() + "/attack.gif", writer="pillow")
    """
    if not 0 <= rate <= 1:
        raise ValueError(f"rate must be from 0 to 1, got {rate}")
    if total < len(scene.episodes):
        raise ValueError(f"total must be at least the {len(scene.episodes)} episodes shown, got {total}")
    figure = Figure((_WIDTH, _HEIGHT), dpi=DOTS_PER_INCH, facecolor=PAPER)
    cells = _cells(figure, scene)
    failures, places = _draw_latent(figure, scene)
    ends = np.array([len(episode) for episode in scene.episodes])
    _draw_words(figure, scene, rate, total)
    draw_key(figure.add_axes(_shares((*_KEY, *KEY_SIZE))), style_colour(scene.style), _limit(scene))
    right = (_GRID[0] + _GRID[2]) / _WIDTH
    counter = figure.text(right, _TITLE / _HEIGHT, "", ha="right", va="center", size=TEXT_SIZE, color=INK)

    def show(frame: int) -> list[Artist]:
        step = min(frame, scene.num_steps)
        counter.set_text(f"step {step} of {scene.num_steps}")
        for cell in cells:
            cell.show(step)
        failures.set_data(*places[~scene.succeeded & (ends <= step)].T)
        return []

    return FuncAnimation(
        figure,
        show,
        frames=scene.num_steps + 1 + _HELD_FRAMES,
        interval=1000 / FRAMES_PER_SECOND,
        cache_frame_data=False,
    )


def _cells(figure: Figure, scene: Scene) -> list[ZombieCell]:
    """A square of small planes, filled row by row, all at the same scale."""
    low, high = square_around(scene.episodes)
    across = ceil(sqrt(len(scene.episodes)))
    left, bottom, side = _GRID
    pitch = (side + _GAP) / across
    cells = []
    for index, (episode, succeeded) in enumerate(zip(scene.episodes, scene.succeeded, strict=True)):
        row, column = divmod(index, across)
        box = (left + column * pitch, bottom + side - row * pitch - (pitch - _GAP), pitch - _GAP, pitch - _GAP)
        axes = figure.add_axes(_shares(box))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        colour = style_colour(scene.style)
        cells.append(ZombieCell(axes, episode, window=_limit(scene), colour=colour, succeeded=bool(succeeded)))
    return cells


def _shares(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Left, bottom, width and height in inches as shares of the figure."""
    left, bottom, width, height = box
    return left / _WIDTH, bottom / _HEIGHT, width / _WIDTH, height / _HEIGHT


def _draw_latent(figure: Figure, scene: Scene) -> tuple[Line2D, FloatArray]:
    """The marks of failures, none as yet, and where each episode's z lies in the plane, (E, 2)."""
    points, places, names = _places(scene)
    styles = np.unique(scene.background_assignment).tolist()
    left, bottom, width = _LATENT
    height = _TOP - _LINE * (1 + max(len(styles), 2)) - bottom
    axes = plain_axes(figure.add_axes(_shares((left, bottom, width, height))))
    demonstrations = [
        axes.plot(
            *points[scene.background_assignment == style].T,
            linestyle="",
            marker=style_marker(style),
            markersize=3.2,
            color=_light(style_colour(style)),
            markeredgewidth=0,
            label=_short(scene.names[style], 24),
        )[0]
        for style in styles
    ]
    (shown,) = axes.plot(
        *places.T,
        linestyle="",
        marker=style_marker(scene.style),
        markersize=6,
        color=style_colour(scene.style),
        markeredgecolor=PAPER,
        markeredgewidth=0.6,
        label="each",
    )
    (failures,) = axes.plot([], [], "x", color=ALERT, markersize=6, markeredgewidth=1.5, label="failed")
    axes.set_xlabel(names[0].replace(" (", "\n("))
    axes.set_ylabel(names[1].replace(" (", "\n("))
    if scene.z.shape[1] == 1:
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
    else:
        axes.set_aspect("equal", adjustable="datalim")
    _legend(figure, demonstrations, "z of demonstrations", left - 0.5)
    _legend(figure, [shown, failures], "z of the episodes shown", left + 1.18)
    return failures, places


def _light(colour: str) -> tuple[float, float, float]:
    red, green, blue = (1 - _LIGHT * (1 - channel) for channel in to_rgb(colour))
    return red, green, blue


def _legend(figure: Figure, handles: Sequence[Line2D], title: str, left: float) -> None:
    """A column of words whose top left corner is `left` inches from the left."""
    legend = figure.legend(
        handles=handles,
        title=title,
        loc="upper left",
        bbox_to_anchor=(left / _WIDTH, (_TOP + 0.05) / _HEIGHT),
        borderpad=0,
        borderaxespad=0,
        handletextpad=0.2,
        frameon=False,
        fontsize=SMALL_TEXT_SIZE,
        labelcolor=INK,
        alignment="left",
    )
    legend.get_title().set(fontsize=SMALL_TEXT_SIZE, color=MUTED)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _places(scene: Scene) -> tuple[FloatArray, FloatArray, tuple[str, str]]:
    """The demonstrations (N, 2) and the episodes (E, 2) in the plane of the demonstrations, and its axes."""
    means, z = scene.background_means, scene.z
    if z.shape[1] > 2:
        plane = latent_plane(means, scene.background_assignment)
        return plane.points, (z - means.mean(0)) @ plane.directions.T, plane.axis_names
    assignment = np.concatenate([scene.background_assignment, np.full(len(z), scene.style)])
    plane = latent_plane(np.concatenate([means, z]), assignment)
    return plane.points[: len(means)], plane.points[len(means) :], plane.axis_names


def _draw_words(figure: Figure, scene: Scene, rate: float, total: int) -> None:
    words = f"{_short(scene.name, 14)}: {_memory(scene)}"
    figure.text(_GRID[0] / _WIDTH, _TITLE / _HEIGHT, words, va="center", size=TEXT_SIZE, color=INK, parse_math=False)
    shown, count = int(scene.succeeded.sum()), len(scene.episodes)
    words = f"{shown} of {count} shown succeed; {_percent(rate)} of {total:,} do."
    figure.text(_GRID[0] / _WIDTH, _CAPTION / _HEIGHT, words, va="center", size=TEXT_SIZE, color=INK)


def _short(name: str, most: int) -> str:
    return name if len(name) <= most else name[: most - 1] + "…"


def _limit(scene: Scene) -> int | None:
    """The window, where it ever hides a state."""
    return None if scene.window is None or scene.window >= scene.num_steps else scene.window


def _memory(scene: Scene) -> str:
    match _limit(scene):
        case None:
            return "remembers everything"
        case 1:
            return "sees the present state (W = 1)"
        case window:
            return f"sees its last {window} states (W = {window})"


def _percent(rate: float) -> str:
    """One decimal; 0 % and 100 % are kept for none and all.

    >>> [_percent(rate) for rate in (0.963, 1.0, 0.9996)]
    ['96.3 %', '100 %', 'over 99.9 %']
    """
    if rate in {0, 1}:
        return f"{100 * rate:.0f} %"
    if not 0.0005 <= rate < 0.9995:
        return "under 0.1 %" if rate < 0.5 else "over 99.9 %"
    return f"{100 * rate:.1f} %"
