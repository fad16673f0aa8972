"""Where the episodes lie in the latent space: their posterior means, coloured by style."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tvae.figures.canvas import SMALL_TEXT_SIZE, new_figure, plain_axes
from tvae.figures.palette import INK, style_colour, style_marker
from tvae.spaces import FloatArray, IntArray

_GOLDEN = (5**0.5 - 1) / 2
_MOST_ELLIPSES = 60


@dataclass(frozen=True, eq=False)
class LatentPlane:
    """Latent means laid out on paper."""

    points: FloatArray
    """(N, 2)"""
    directions: FloatArray
    """(2, Z): the latent directions that became the two axes."""
    axis_names: tuple[str, str]


def latent_plane(means: FloatArray, assignment: IntArray) -> LatentPlane:
    """Lay means (N, Z) out: two as they are, more on their first two principal components.

    A single one becomes a strip: a row a style, spread so that equal means do not hide each other.

    >>> means = np.array([[0.0, 0.0, 1.0], [3.0, 0.0, 1.0], [3.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    >>> plane = latent_plane(means, np.zeros(4, dtype=np.int64))
    >>> plane.points.shape, plane.axis_names[0]
    ((4, 2), 'first principal component of z (90 % of the variance)')
    """
    num_features = means.shape[1]
    if num_features == 0 or len(means) == 0:
        raise ValueError(f"a latent space needs episodes and features, got means of shape {means.shape}")
    if num_features == 1:
        directions = np.array([[1.0], [0.0]])
        strip = np.stack([means[:, 0], _rows(means[:, 0], assignment)], axis=1)
        return LatentPlane(strip, directions, ("z_0", ""))
    if num_features == 2:
        return LatentPlane(means, np.eye(2), ("z_0", "z_1"))
    centred = means - means.mean(0)
    _, scales, components = np.linalg.svd(centred, full_matrices=False)
    directions = np.zeros((2, num_features))
    shares = np.zeros(2)
    for axis, component in enumerate(components[:2]):
        directions[axis] = component * (1 if component[np.abs(component).argmax()] > 0 else -1)
        shares[axis] = scales[axis] ** 2 / max(float((scales**2).sum()), 1e-300)
    first, second = (
        f"{order} principal component of z ({share:.0%} of the variance)".replace("%", " %")
        for order, share in zip(("first", "second"), shares, strict=True)
    )
    return LatentPlane(centred @ directions.T, directions, (first, second))


def _rows(values: FloatArray, assignment: IntArray) -> FloatArray:
    """(N,) heights: style 0 around 0, style 1 around -1, ...; neighbours along the strip far apart in it."""
    heights = np.empty(len(values))
    for style in np.unique(assignment):
        members = np.flatnonzero(assignment == style)
        rank = np.argsort(np.argsort(values[members], kind="stable"), kind="stable")
        heights[members] = -style + 0.6 * ((rank * _GOLDEN) % 1 - 0.5)
    return heights


def latent_space(
    means: FloatArray, assignment: IntArray, names: Sequence[str], *, deviations: FloatArray | None = None
) -> Figure:
    """The posterior means (N, Z) by style, and one standard deviation (N, Z) around some of them if given.

    `assignment` (N,) indexes `names`. Raises `ValueError` where Z or N is 0.

    >>> rng = np.random.default_rng(0)
    >>> figure = latent_space(rng.normal(size=(40, 2)), np.arange(40) % 2, ["attack", "avoid"])
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['attack (20)', 'avoid (20)']
    """
    plane = latent_plane(means, assignment)
    strip = means.shape[1] == 1
    styles = np.unique(assignment)
    figure = new_figure(4.6, 1.3 + 0.5 * len(styles) if strip else 4.2)
    axes = plain_axes(figure.add_subplot(), x=plane.axis_names[0], y=plane.axis_names[1])
    if deviations is not None and not strip:
        _draw_deviations(axes, plane, deviations, assignment)
    handles = draw_points(axes, plane.points, assignment)
    if strip:
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
    else:
        axes.set_aspect("equal", adjustable="datalim")
    _legend(figure, handles, [f"{names[style]} ({(assignment == style).sum():,})" for style in styles])
    return figure


def draw_points(axes: Axes, points: FloatArray, assignment: IntArray, *, size: float = 4.2) -> list[Line2D]:
    """Points (N, 2) in the colour and with the marker of their style, `size` points wide; a line for each style.

    >>> axes = new_figure(2, 2).add_subplot()
    >>> [line.get_marker() for line in draw_points(axes, np.zeros((3, 2)), np.array([0, 1, 1]))]
    ['o', '^']
    """
    return [
        axes.plot(
            *points[assignment == style].T,
            linestyle="",
            marker=style_marker(int(style)),
            markersize=size,
            markerfacecolor=style_colour(int(style)),
            markeredgewidth=0,  # an edge of its own would hide what lies at the same place
            alpha=0.85,
            rasterized=len(points) > 5000,
        )[0]
        for style in np.unique(assignment)
    ]


def _draw_deviations(axes: Axes, plane: LatentPlane, deviations: FloatArray, assignment: IntArray) -> None:
    """The ellipse of one standard deviation, the posterior's, seen along the plane, around some of the points."""
    some = np.linspace(0, len(deviations) - 1, min(len(deviations), _MOST_ELLIPSES)).astype(np.int64)
    scaled = plane.directions * deviations[some, None, :]
    variances, vectors = np.linalg.eigh(scaled @ scaled.transpose(0, 2, 1))
    radii = np.sqrt(variances.clip(0))
    axes.add_collection(
        EllipseCollection(
            2 * radii[:, 0],
            2 * radii[:, 1],
            np.degrees(np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0])),
            units="xy",
            offsets=plane.points[some],
            offset_transform=axes.transData,
            facecolors="none",
            edgecolors=[style_colour(int(style)) for style in assignment[some]],
            alpha=0.35,
            linewidths=0.5,
        )
    )
    reach = radii.max(1)[:, None]
    axes.update_datalim(np.concatenate([plane.points[some] - reach, plane.points[some] + reach]))


def _legend(figure: Figure, handles: Sequence[Line2D], labels: Sequence[str]) -> None:
    legend = figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=min(len(labels), 4),
        frameon=False,
        fontsize=SMALL_TEXT_SIZE,
        labelcolor=INK,
        handletextpad=0.2,
        columnspacing=1.2,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
