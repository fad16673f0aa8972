"""Paths of the test set, rebuilt from their latents by both decoders (figures 2 and 4 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tvae.figures.canvas import DOUBLE_COLUMN, SMALL_TEXT_SIZE, plain_axes
from tvae.figures.latent import draw_points, latent_plane
from tvae.figures.palette import MUTED
from tvae.figures.panels import (
    Landmark,
    above,
    draw_landmarks,
    draw_paths,
    landmark_handles,
    letter,
    limits,
    place,
    placed,
    style_handles,
)
from tvae.spaces import FloatArray, IntArray

_CAPTIONS = ("ground truth", "state decoder", "policy decoder")
_WIDEST = 1.3
_LEFT, _GAP, _TOP = 0.55, 0.26, 0.45
"""Inches left of the panels, between them, and above."""


def reconstructions(
    truth: Sequence[FloatArray],
    imagined: Sequence[FloatArray],
    acted: Sequence[FloatArray],
    labels: IntArray,
    means: FloatArray,
    names: Sequence[str],
    *,
    landmarks: Sequence[Landmark] = (),
) -> Figure:
    """Four panels: E recorded paths, the same imagined, the same acted, and the latent means (E, Z) behind them.

    Each of `truth`, `imagined` (by the state decoder) and `acted` (by the policy decoder in the environment) has
    a path (N_i, 2) for each of the E episodes, in one order; these three panels have one scale. `labels` (E,)
    are indices of `names`: the true types. Other than two latent features are laid out by `latent_plane`.

    Raises `ValueError` where the numbers of episodes differ.

    >>> paths = [np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[0.0, 0.0], [-1.0, 2.0]])]
    >>> figure = reconstructions(paths, paths, paths, np.array([0, 1]), np.eye(2), ["right", "left"])
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['(a) ground truth', '(b) state decoder', '(c) policy decoder', '(d) latent space']
    """
    counts = [len(truth), len(imagined), len(acted), len(labels), len(means)]
    if len({*counts}) != 1:
        raise ValueError(f"truth, imagined, acted, labels and means need as many episodes each, got {counts}")
    x, y = limits([*truth, *imagined, *acted], landmarks, widest=_WIDEST)
    ratio = (x[1] - x[0]) / (y[1] - y[0])
    many = means.shape[1] > 2
    bottom, before_last, right = (0.5, 0.72, 0.2) if many else (0.38, 0.55, 0.08)
    side = (DOUBLE_COLUMN - _LEFT - 2 * _GAP - before_last - right) / (3 * ratio + 1)
    figure = placed(DOUBLE_COLUMN, bottom + side + _TOP)
    planes = [place(figure, _LEFT + i * (ratio * side + _GAP), bottom, ratio * side, side) for i in range(3)]
    for axes, which, caption, paths in zip(planes, "abc", _CAPTIONS, (truth, imagined, acted), strict=True):
        letter(plain_axes(axes, x="x", y="y" if which == "a" else ""), which, caption)
        draw_landmarks(axes, landmarks)
        draw_paths(axes, paths, labels)
        axes.set(xlim=x, ylim=y, aspect="equal")
        axes.locator_params(nbins=4)
        axes.tick_params(labelleft=which == "a")
    _draw_latent_space(place(figure, DOUBLE_COLUMN - right - side, bottom, side, side), means, labels)
    above(figure, [*style_handles(names, np.unique(labels).tolist()), *landmark_handles(landmarks)])
    return figure


def _draw_latent_space(axes: Axes, means: FloatArray, labels: IntArray) -> None:
    plane = latent_plane(means, labels)
    letter(plain_axes(axes), "d", "latent space")
    draw_points(axes, plane.points, labels, size=3.0)
    axes.locator_params(nbins=4)
    axes.set_xlabel(_axis_name(plane.axis_names[0]), size=SMALL_TEXT_SIZE, color=MUTED, parse_math=True)
    axes.set_ylabel(_axis_name(plane.axis_names[1]), size=SMALL_TEXT_SIZE, color=MUTED, parse_math=True)
    if means.shape[1] == 1:
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
    else:
        axes.set_aspect("equal", adjustable="datalim")


def _axis_name(name: str) -> str:
    """`z_0` as a formula; a principal component and its share on two lines."""
    return f"${name}$" if name.startswith("z_") else name.replace(" of z (", "\n(")
