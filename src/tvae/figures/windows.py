"""Success against the length of the window that a bot sees (figure 8 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import ascii_lowercase

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import LineStyleType

from tvae.figures.canvas import DOUBLE_COLUMN, SINGLE_COLUMN, new_figure, plain_axes
from tvae.figures.palette import INK, MUTED, PAPER, RULE, style_colour
from tvae.figures.panels import Band, above, draw_band, letter

_LOOKS: tuple[tuple[LineStyleType, str], ...] = (("--", "o"), ("-", "s"), (":", "D"), ("-.", "^"))


@dataclass(frozen=True)
class WindowedBot:
    """A bot to compare with, at the one window that it needs."""

    name: str
    style: str
    window: int
    success: float
    """Share of episodes, 0 .. 1."""


def windows(
    lengths: Sequence[int], curves: Mapping[str, Mapping[str, Band]], *, bots: Sequence[WindowedBot] = ()
) -> Figure:
    """A panel for each style: the share of successes (K,) at the K window lengths, a curve for each way of training.

    `curves` gives for each style the bands of the same curves, shares from 0 to 1. The lengths stand at even
    distances. A bot is an open star in the panel of its style.

    Raises `ValueError` where the styles' curves differ, or where a bot's style or window is not shown.

    >>> band = Band(np.array([0.2, 0.9]), np.array([0.1, 0.8]), np.array([0.3, 1.0]))
    >>> figure = windows([1, 30], {"attack": {"whole episodes": band}, "avoid": {"whole episodes": band}})
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['(a) attack', '(b) avoid']
    """
    names = [tuple(by_name) for by_name in curves.values()]
    if not names or len({*names}) != 1 or len(names[0]) > len(_LOOKS):
        raise ValueError(f"each style needs the same curves, at most {len(_LOOKS)}, got {names}")
    for bot in bots:
        if bot.style not in curves or bot.window not in lengths:
            raise ValueError(f"{bot} needs a style among {[*curves]} and a window among {[*lengths]}")
    figure = new_figure(DOUBLE_COLUMN if len(curves) > 1 else SINGLE_COLUMN, 2.3)
    panels = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    places = np.arange(len(lengths), dtype=np.float64)
    for index, (axes, (style, by_name)) in enumerate(zip(panels, curves.items(), strict=True)):
        letter(
            plain_axes(axes, x="window length W", y="" if index else "successful episodes"),
            ascii_lowercase[index],
            style,
        )
        for (line, marker), band in zip(_LOOKS, by_name.values(), strict=False):
            mean = draw_band(axes, places, band, colour=style_colour(index), line=line, marker=marker)
            mean.set(markerfacecolor=_face(line, style_colour(index)), zorder=3)
        for bot in bots:
            if bot.style == style:
                (star,) = axes.plot(lengths.index(bot.window), bot.success)
                _as_star(star)
        _frame(axes, lengths)
    above(figure, _handles(names[0], bots), handlelength=3.5)
    return figure


def _as_star(line: Line2D) -> Line2D:
    line.set(marker="*", markersize=9, markerfacecolor=PAPER, markeredgecolor=INK, linestyle="", zorder=4)
    return line


def _face(line: LineStyleType, colour: str) -> str:
    return colour if line == "-" else PAPER


def _frame(axes: Axes, lengths: Sequence[int]) -> None:
    axes.set_xticks(range(len(lengths)), [str(length) for length in lengths])
    axes.set(xlim=(-0.3, len(lengths) - 0.7), ylim=(0, 1.04))
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0 %", "25 %", "50 %", "75 %", "100 %"])
    axes.grid(axis="y", color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)


def _handles(names: Sequence[str], bots: Sequence[WindowedBot]) -> list[Line2D]:
    curves = []
    for (line, marker), name in zip(_LOOKS, names, strict=False):
        curves.append(Line2D([], [], color=MUTED, linestyle=line, marker=marker, markersize=4, label=name))
        curves[-1].set_markerfacecolor(_face(line, MUTED))
    stars = dict.fromkeys(bot.name for bot in bots)
    return [*curves, *(_as_star(Line2D([], [], label=name)) for name in stars)]
