"""How training went, term by term: policy, state, stop, KL, and the weight beta of the KL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tvae.figures.canvas import SMALL_TEXT_SIZE, TEXT_SIZE, new_figure, plain_axes
from tvae.figures.palette import INK, MUTED, STYLE_COLOURS
from tvae.spaces import FloatArray
from tvae.train.checkpoint import Record
from tvae.train.terms import Terms

_TERMS: tuple[tuple[str, Callable[[Terms], float]], ...] = (
    ("Policy: log-likelihood of actions", lambda terms: terms.policy),
    ("State: log-likelihood of next states", lambda terms: terms.state),
    ("Ahead: log-likelihood of states to come", lambda terms: terms.ahead),
    ("Stop: log-likelihood of the end", lambda terms: terms.stop),
    ("KL: what z tells", lambda terms: terms.kl),
)
_LOOKS = (("training", STYLE_COLOURS[5], "-"), ("held out", STYLE_COLOURS[0], "--"))


def training_curves(records: Sequence[Record]) -> Figure:
    """The terms of the bound, in nats per trajectory, on training and on held-out demonstrations.

    The terms of the end and of what is ahead are left out where they were never used, and a constant beta is said
    instead of drawn. Where the first tenth of training would flatten all the rest, the axis does not reach it and the
    panel says so.

    >>> before, after = Terms(-60.0, -9.0, 0.0, 1.0), Terms(-20.0, -4.0, 0.0, 2.0)
    >>> figure = training_curves([Record(0, 1.0, before, before), Record(100, 1.0, after, after)])
    >>> [axes.get_title(loc="left").split(":")[0] for axes in figure.axes]
    ['Policy', 'State', 'KL, with beta = 1']
    """
    if not records:
        raise ValueError("training curves need at least one record, got none")
    terms = [(title, of) for title, of in _TERMS if any(of(r.training) or of(r.held_out) for r in records)]
    constant = len({record.beta for record in records}) == 1
    count = len(terms) + (not constant)
    columns = 2 if count in {2, 4} else 3
    rows = ceil(count / columns)
    figure = new_figure(2.35 * columns, 1.75 * rows)
    panels = [figure.add_subplot(rows, columns, index + 1) for index in range(count)]
    steps = np.array([record.step for record in records])
    marker = "o" if len(records) == 1 else ""
    for axes, (title, value) in zip(panels, terms, strict=False):
        plain_axes(axes, title=title, y="nats")
        curves = np.array([[value(record.training), value(record.held_out)] for record in records])
        for column, (label, colour, line) in enumerate(_LOOKS):
            axes.plot(steps, curves[:, column], line, color=colour, linewidth=1.2, label=label, marker=marker)
        _leave_out_the_start(axes, curves)
    if constant:
        panels[-1].set_title(f"KL, with beta = {records[0].beta:g}", loc="left", size=TEXT_SIZE, color=INK)
    else:
        axes = plain_axes(panels[-1], title="beta: weight of the KL")
        axes.step(steps, [record.beta for record in records], where="post", color=INK, linewidth=1)
        axes.set_ylim(bottom=0)
    for axes in panels[-columns:]:
        axes.set_xlabel("training step", size=SMALL_TEXT_SIZE, color=MUTED)
    panels[0].legend(frameon=False, fontsize=SMALL_TEXT_SIZE, labelcolor=INK, loc="lower right")
    return figure


def _leave_out_the_start(axes: Axes, curves: FloatArray) -> None:
    """Fit the axis to the last nine tenths of curves (R, 2) where the whole would flatten them."""
    later = curves[len(curves) // 10 :]
    low, high = float(later.min()), float(later.max())
    if np.ptp(curves) > 4 * (high - low) > 0:
        margin = 0.06 * (high - low)
        axes.set_ylim(low - margin, high + margin)
        axes.text(0.03, 0.9, "starts off the scale", transform=axes.transAxes, size=6, color=MUTED)
