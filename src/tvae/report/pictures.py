"""Pictures of episodes and of the latent space as SVG, and which episodes are pictured at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse
from numpy.typing import NDArray

from tvae.data.trajectory import Trajectory
from tvae.figures.latent import latent_plane, latent_space
from tvae.figures.markup import to_markup
from tvae.figures.palette import PAPER, style_colour, style_marker
from tvae.figures.trajectories import Draw, share_limits
from tvae.spaces import FloatArray, IntArray

_SIDE = 1.9
"""Inches a picture of an episode is wide and high."""


@dataclass(frozen=True)
class Sketches:
    """Pictures of episodes at the same scale, as SVG elements."""

    pictures: tuple[str, ...]
    keys: Mapping[Draw, tuple[Entry, ...]]
    """What the lines, marks and circles of each way to draw mean, as far as they have labels."""


@dataclass(frozen=True)
class Entry:
    """One line of a key."""

    sample: str
    """An SVG element."""
    name: str


def sketch(episodes: Sequence[tuple[Trajectory, Draw, str]]) -> Sketches:
    """Pictures of trajectories, each with the function that draws it and a label in words.

    All are drawn on the same axes, whose limits then fit all, and taken from there one by one: making axes
    for each would take most of the time.
    """
    figure = Figure((_SIDE, _SIDE), dpi=72)
    axes = figure.add_axes((0, 0, 1, 1))
    drawn: list[list[Artist]] = []
    for trajectory, draw, _ in episodes:
        before = set(axes.get_children())
        axes.xaxis.set_inverted(False)
        axes.yaxis.set_inverted(False)
        draw(axes, trajectory)
        drawn.append([artist for artist in axes.get_children() if artist not in before])
    share_limits([axes])
    axes.apply_aspect()
    named: dict[Draw, dict[str, Artist]] = {}
    for artists, (_, draw, _) in zip(drawn, episodes, strict=True):
        labels = ((str(artist.get_label()), artist) for artist in artists)
        named.setdefault(draw, {}).update({k: v for k, v in labels if k and not k.startswith("_")})
    return Sketches(
        tuple(to_markup(figure, label, only) for only, (_, _, label) in zip(drawn, episodes, strict=True)),
        {draw: _key(artists) for draw, artists in named.items()},
    )


def _key(named: Mapping[str, Artist]) -> tuple[Entry, ...]:
    """Samples of the lines, circles and marks: paths first, else in the order in which they were drawn."""
    entries = []
    for name, artist in sorted(named.items(), key=lambda item: not _is_path(item[1])):
        figure = Figure((0.3, 0.18), dpi=72)
        sample: Line2D | Ellipse
        if isinstance(artist, Line2D):
            across = [0.0, 1.0] if _is_path(artist) else [0.5]
            sample = Line2D(across, [0.5] * len(across))
        elif isinstance(artist, Circle):
            sample = Ellipse((0.5, 0.5), 0.48, 0.8)
        else:
            continue
        sample.update_from(artist)
        sample.set_clip_path(None)
        sample.set_transform(figure.transFigure)
        figure.add_artist(sample)
        entries.append(Entry(to_markup(figure, ""), name))
    return tuple(entries)


def _is_path(artist: Artist) -> bool:
    return isinstance(artist, Line2D) and artist.get_linestyle() != "None"


def glyph(style: int) -> str:
    """The style's marker in its colour, as an SVG element."""
    figure = Figure((0.2, 0.2))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.plot(0.5, 0.5, style_marker(style), color=style_colour(style), markersize=10, markeredgecolor=PAPER)
    return to_markup(figure, "")


@dataclass(frozen=True)
class LatentMap:
    """The latent space as an SVG element, and where in it (in its own units) each episode stands."""

    picture: str
    places: FloatArray
    """(N, 2)"""


def latent_map(means: FloatArray, assignment: IntArray, names: Sequence[str]) -> LatentMap:
    """The posterior means (N, Z) as a picture whose points a script can find again."""
    figure = latent_space(means, assignment, names)
    picture = to_markup(figure, f"Latent space: {len(means)} episodes, coloured by style")
    places = figure.axes[0].transData.transform(latent_plane(means, assignment).points)
    return LatentMap(picture, np.stack([places[:, 0], figure.bbox.height - places[:, 1]], axis=1))


def spread(assignment: IntArray, always: Sequence[int], limit: int) -> IntArray:
    """Positions of about `limit` episodes, from every style in proportion, and those that must be there.

    >>> spread(np.array([0, 0, 0, 0, 1, 1]), always=[1], limit=3).tolist()
    [0, 1, 2, 5]
    """
    order = np.argsort(assignment, kind="stable")
    even = order[np.linspace(0, len(order) - 1, min(limit, len(order))).round().astype(np.int64)]
    return np.union1d(even, np.asarray(always, dtype=np.int64))


def in_proportion(succeeded: NDArray[np.bool_], count: int) -> IntArray:
    """Positions of `count` outcomes (E,), failures in their true share, but at least one if there is one.

    >>> outcomes = np.array([True] * 90 + [False] * 10)
    >>> chosen = in_proportion(outcomes, 20)
    >>> len(chosen), int((~outcomes[chosen]).sum())
    (20, 2)
    """
    count = min(count, len(succeeded))
    failures, successes = np.flatnonzero(~succeeded), np.flatnonzero(succeeded)
    num_failures = round(count * len(failures) / len(succeeded))
    num_failures = min(max(num_failures, min(1, len(failures))), len(failures))
    parts = [
        part[np.linspace(0, len(part) - 1, wanted).round().astype(np.int64)]
        for part, wanted in ((failures, num_failures), (successes, min(count - num_failures, len(successes))))
    ]
    return np.sort(np.concatenate(parts))
