"""The model as a diagram: encoder, latent and both decoders, and what is connected only at test time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from tvae.figures.canvas import DOUBLE_COLUMN, SMALL_TEXT_SIZE, TEXT_SIZE
from tvae.figures.palette import INK, MUTED, PAPER, RULE, STYLE_COLOURS
from tvae.figures.panels import above, place, placed

_HEIGHT = 3.1
_NETWORK = "#eceef0"
_LATENT = "#d6e8f4"
_TEST = STYLE_COLOURS[0]
_DASHES = (0, (3, 1.6))

_Point: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class _Box:
    """A box by its middle and its sides, in inches."""

    x: float
    y: float
    width: float
    height: float = 0.28

    @property
    def left(self) -> _Point:
        return self.x - self.width / 2, self.y

    @property
    def right(self) -> _Point:
        return self.x + self.width / 2, self.y

    @property
    def top(self) -> _Point:
        return self.x, self.y + self.height / 2

    @property
    def bottom(self) -> _Point:
        return self.x, self.y - self.height / 2


def architecture() -> Figure:
    """The encoder on the left, z in the middle, the state decoder above and the policy decoder below on the right.

    Full arrows are there in training, on recorded trajectories. At test time the dashed ones give the decoders
    their states and z: the state decoder reads its own, the policy decoder those of the environment.

    >>> figure = architecture()
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['training, on recorded trajectories', 'test time only']
    """
    figure = placed(DOUBLE_COLUMN, _HEIGHT)
    axes = place(figure, 0, 0, DOUBLE_COLUMN, _HEIGHT)
    axes.set(xlim=(0, DOUBLE_COLUMN), ylim=(0, _HEIGHT), aspect="equal")
    axes.set_axis_off()
    latent = _draw_latent(axes, _draw_encoder(axes))
    _draw_state_decoder(axes, latent)
    _draw_policy_decoder(axes, latent)
    above(
        figure,
        [
            Line2D([], [], color=INK, linewidth=0.9, label="training, on recorded trajectories"),
            Line2D([], [], color=_TEST, linewidth=0.9, linestyle=_DASHES, label="test time only"),
        ],
    )
    return figure


def _draw_encoder(axes: Axes) -> _Box:
    """From the recorded trajectory at the bottom to the posterior's parameters at the top, which come back."""
    _draw_part(axes, _Box(1.28, 1.44, 2.44, 2.76), "encoder: a bidirectional LSTM")
    pooled = _box(axes, _Box(1.28, 1.62, 2.16), "mean over the valid steps")
    posterior = _box(axes, _Box(1.28, 2.16, 1.0), r"$\mu,\ \log\,\sigma^2$")
    _arrow(axes, pooled.top, posterior.bottom)
    cells = []
    for x, index in ((0.45, "1"), (1.07, "2"), (2.11, "T")):
        pair = _box(axes, _Box(x, 0.32, 0.5), rf"$s_{index},\ a_{index}$")
        cells.append(_box(axes, _Box(x, 0.96, 0.44, 0.36), "LSTM", fill=_NETWORK))
        _arrow(axes, pair.top, cells[-1].bottom)
        _arrow(axes, cells[-1].top, (x, pooled.bottom[1]))
    for y in (0.32, 0.96):
        _write(axes, 1.59, y, r"$\cdots$")
    for start, end in ((cells[0].right[0], cells[1].left[0]), (1.29, 1.5), (1.68, cells[2].left[0])):
        _arrow(axes, (start, 1.03), (end, 1.03))
        _arrow(axes, (end, 0.89), (start, 0.89))
    return posterior


def _draw_latent(axes: Axes, posterior: _Box) -> _Box:
    """z: from the posterior in training, of a style at test time; and the prior, to which the KL is."""
    latent = _Box(3.1, 1.4, 0.44, 0.44)
    look = {"facecolor": _LATENT, "edgecolor": INK, "linewidth": 0.8, "zorder": 2}
    axes.add_patch(Circle((latent.x, latent.y), latent.width / 2, **look))
    axes.text(latent.x, latent.y, "$z$", ha="center", va="center", size=11, color=INK)
    prior = _box(axes, _Box(3.1, 2.66, 0.92), r"prior $p(z)$")
    style = _box(axes, _Box(3.1, 0.56, 0.98, 0.4), "$z$ of a style\nthat was found", test=True)
    corner = (latent.x, posterior.y)
    _arrow(axes, posterior.right, corner, latent.top)
    axes.plot(*zip(prior.bottom, corner, strict=True), color=MUTED, linewidth=0.9, linestyle=(0, (1, 1.3)))
    _write(axes, 2.58, 2.26, r"$q(z\,|\,\tau)$", align="left")
    _write(axes, 3.16, 2.38, "KL", align="left", colour=MUTED)
    _arrow(axes, style.top, latent.bottom, test=True)
    return latent


def _draw_state_decoder(axes: Axes, latent: _Box) -> None:
    _draw_part(axes, _Box(5.4, 2.22, 3.08, 1.2), "state decoder")
    states, decoder, law = _draw_decoder(axes, 1.96, r"$p(s_{t+1}\,|\,s_{1{:}t},\,z)$")
    _arrow(axes, latent.right, (decoder.x, latent.y), decoder.bottom)
    _arrow(axes, law.top, (law.x, 2.38), (states.x, 2.38), states.top, test=True)
    _write(axes, decoder.x, 2.46, r"$s_{t+1}$, its own", colour=_TEST)


def _draw_policy_decoder(axes: Axes, latent: _Box) -> None:
    _draw_part(axes, _Box(5.4, 0.63, 3.08, 1.14), "policy decoder")
    states, decoder, law = _draw_decoder(axes, 0.76, r"$\pi(a_t\,|\,s_{1{:}t},\,z)$")
    _arrow(axes, (decoder.x, latent.y), decoder.top)
    environment = _box(axes, _Box(decoder.x, 0.26, 0.94, 0.26), "environment", test=True)
    _arrow(axes, law.bottom, (law.x, environment.y), environment.right, test=True)
    _arrow(axes, environment.left, (states.x, environment.y), states.bottom, test=True)
    _write(axes, 6.02, 0.35, r"$a_t$", colour=_TEST)
    _write(axes, 4.56, 0.36, r"$s_{t+1}$", colour=_TEST)


def _draw_decoder(axes: Axes, y: float, law: str) -> tuple[_Box, _Box, _Box]:
    """The states so far, the LSTM that reads them, and the law that it gives, from left to right."""
    states = _box(axes, _Box(4.36, y, 0.78), r"$s_1, \ldots, s_t$")
    decoder = _box(axes, _Box(5.2, y, 0.5, 0.36), "LSTM", fill=_NETWORK)
    given = _box(axes, _Box(6.26, y, 1.22), law)
    _arrow(axes, states.right, decoder.left)
    _arrow(axes, decoder.right, given.left)
    return states, decoder, given


def _draw_part(axes: Axes, box: _Box, title: str) -> None:
    axes.add_patch(_patch(box, 0.06, "none", RULE))
    _write(axes, box.left[0] + 0.08, box.top[1] - 0.13, title, align="left", colour=MUTED)


def _box(axes: Axes, box: _Box, text: str, *, fill: str = PAPER, test: bool = False) -> _Box:
    patch = _patch(box, 0.04, fill, _TEST if test else INK)
    patch.set_linestyle(_DASHES if test else "-")
    axes.add_patch(patch)
    axes.text(box.x, box.y, text, ha="center", va="center", size=TEXT_SIZE, color=INK, linespacing=1.1)
    return box


def _patch(box: _Box, corner: float, fill: str, edge: str) -> FancyBboxPatch:
    return FancyBboxPatch(
        (box.left[0], box.bottom[1]),
        box.width,
        box.height,
        boxstyle=f"round,pad=0,rounding_size={corner}",
        facecolor=fill,
        edgecolor=edge,
        linewidth=0.8,
        zorder=0 if fill == "none" else 2,
    )


def _arrow(axes: Axes, *points: _Point, test: bool = False) -> None:
    """A polyline through the points, with a full head at the last one."""
    way = np.array(points)
    forward = (way[-1] - way[-2]) / np.hypot(*(way[-1] - way[-2]))
    aside = np.array([-forward[1], forward[0]])
    base = way[-1] - 0.075 * forward
    colour = _TEST if test else INK
    head = Polygon(np.array([way[-1], base + 0.03 * aside, base - 0.03 * aside]), facecolor=colour, linewidth=0)
    way[-1] = base
    axes.plot(*way.T, color=colour, linewidth=0.9, linestyle=_DASHES if test else "-", zorder=1)
    axes.add_patch(head)


def _write(axes: Axes, x: float, y: float, text: str, *, align: str = "center", colour: str = INK) -> None:
    axes.text(x, y, text, ha=align, va="center", size=SMALL_TEXT_SIZE, color=colour)
