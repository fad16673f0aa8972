"""What demonstrations hold, on one page: lengths of episodes, the distribution of every signal, a few episodes."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.figures.canvas import DOUBLE_COLUMN, TEXT_SIZE, new_figure, plain_axes
from tvae.figures.lanes import Scales
from tvae.figures.palette import MUTED, style_colour
from tvae.figures.trajectories import draw_trajectory
from tvae.spaces import Angular, Binary, Categorical, FloatArray, Signal

_COLUMNS = 4
_HEIGHT = 1.5
_BINS = 40
_MOST_BARS = 8
_FITTING = 16
"""Characters of a title that are as wide as a panel; longer names are written smaller."""
_MOST_EPISODES = 2_000
_MOST_ROWS = 200_000


def draw_overview(demonstrations: Demonstrations, *, most_signals: int = 24) -> Figure:
    r"""The lengths of all episodes, signals, and four episodes from first to last.

    Of more than `most_signals` signals it shows the first observations and the first actions, and says so above. Of
    more than 2,000 episodes or 200,000 rows, signals show as many, evenly chosen.

    >>> from tvae.data.arrays import from_arrays
    >>> figure = draw_overview(from_arrays([np.arange(4.0)] * 5, [np.array(["left", "right", "left", "left"])] * 5))
    >>> [axes.get_title(loc="left") for axes in figure.axes][:3]
    ['steps of 5 episodes', 'observation\n0', 'action\n0']
    """
    signals, left_out = _chosen(demonstrations, most_signals)
    few = np.unique(np.linspace(0, len(demonstrations) - 1, _COLUMNS).round().astype(np.int64))
    distributions = ceil((1 + len(signals)) / _COLUMNS)
    figure = new_figure(DOUBLE_COLUMN, _HEIGHT * (distributions + 1))
    grid = figure.add_gridspec(distributions + 1, _COLUMNS)
    if left_out:
        figure.suptitle(left_out, x=0.01, ha="left", fontsize=TEXT_SIZE, color=MUTED)
    lengths = plain_axes(figure.add_subplot(grid[0, 0]), title=f"steps of {len(demonstrations):,} episodes")
    lengths.hist(demonstrations.lengths, bins=_BINS, color=MUTED)
    for index, (name, signal, values) in enumerate(signals, start=1):
        axes = plain_axes(figure.add_subplot(grid[index // _COLUMNS, index % _COLUMNS]))
        size = TEXT_SIZE * min(1.0, _FITTING / len(signal.name))
        axes.set_title(name.replace(".", "\n", 1), loc="left", fontsize=size, parse_math=False)
        _draw_distribution(axes, signal, values)
    scales = Scales.of(demonstrations)
    for index, episode in enumerate(few.tolist()):
        trajectory = demonstrations[episode]
        title = f"episode {trajectory.attributes.get('episode', episode)}"
        axes = plain_axes(figure.add_subplot(grid[distributions, index]), title=title)
        draw_trajectory(
            axes, trajectory, demonstrations.observation_space, demonstrations.action_space, style_colour(0), scales
        )
    return figure


def _chosen(demonstrations: Demonstrations, most: int) -> tuple[list[tuple[str, Signal, FloatArray]], str]:
    """At most so many signals, half of them actions if there are enough; in words, what is left out."""
    seen, done = demonstrations.observation_space.num_columns, demonstrations.action_space.num_columns
    few_done = min(done, max(most // 2, most - seen))
    few_seen = min(seen, most - few_done)
    everything = list(_signals(demonstrations))
    if few_seen + few_done == len(everything):
        return everything, ""
    words = f"the first {few_seen} of {seen} observations and {few_done} of {done} actions"
    return [*everything[:few_seen], *everything[seen : seen + few_done]], words


def _signals(demonstrations: Demonstrations) -> Iterator[tuple[str, Signal, FloatArray]]:
    """The name, the kind and a sample of the values of each signal."""
    stride = ceil(len(demonstrations) / _MOST_EPISODES)
    some = demonstrations[::stride]
    for prefix, space, flat, starts, counts in (
        (
            "observation",
            some.observation_space,
            some.observations,
            some.observation_starts,
            some.lengths + some.final_observed,
        ),
        ("action", some.action_space, some.actions, some.action_starts, some.lengths),
    ):
        rows = ranges(starts, counts)
        sample = flat[rows[:: ceil(len(rows) / _MOST_ROWS)]]
        for column, signal in enumerate(space.signals):
            yield f"{prefix}.{signal.name}", signal, sample[:, column]


def _draw_distribution(axes: Axes, signal: Signal, values: FloatArray) -> None:
    axes.set_yticks([])
    match signal:
        case Categorical(_, categories):
            _draw_bars(axes, values, list(map(str, categories)))
        case Binary():
            _draw_bars(axes, values, ["no", "yes"])
        case Angular():
            axes.hist(np.angle(np.exp(1j * values)), bins=_BINS, range=(-np.pi, np.pi), color=style_colour(0))
            axes.set_xticks([-np.pi, 0, np.pi], ["−π", "0", "π"])
        case _:
            axes.hist(values, bins=_BINS, color=style_colour(0))


def _draw_bars(axes: Axes, values: FloatArray, names: list[str]) -> None:
    """The shares of the most frequent categories, the first on top."""
    counts = np.bincount(values.astype(np.int64), minlength=len(names))
    order = np.argsort(-counts, kind="stable")[:_MOST_BARS]
    axes.barh(np.arange(len(order)), counts[order] / counts.sum(), color=style_colour(0))
    axes.set_yticks(np.arange(len(order)), [names[place] for place in order], parse_math=False)
    axes.invert_yaxis()
