"""A small plane in which one episode of the zombie task unfolds, step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, Rectangle

from tvae.data.trajectory import Trajectory
from tvae.envs.zombie_dynamics import GOAL, GOAL_RADIUS, RANGE
from tvae.figures.canvas import SMALL_TEXT_SIZE
from tvae.figures.palette import ALERT, INK, MUTED, PAPER, RULE
from tvae.figures.zombie import zombie_paths
from tvae.spaces import FloatArray

MARGIN = 1.0
"""How far a plane reaches beyond the goal and every start; who goes farther leaves the picture."""
FADED = 0.3
"""Opacity of what the bot no longer sees."""
KEY_SIZE = (3.1, 0.9)
"""Width and height of `draw_key`, in inches."""

_ZOMBIE: Mapping[str, Any] = {"marker": "o", "linestyle": "", "color": INK, "markersize": 3.2, "markeredgewidth": 0}
_CORPSE: Mapping[str, Any] = {"marker": "x", "linestyle": "", "color": INK, "markersize": 4.2, "markeredgewidth": 1.1}
_ATTACK: Mapping[str, Any] = {
    "marker": "D",
    "linestyle": "",
    "markerfacecolor": PAPER,
    "markeredgecolor": INK,
    "markersize": 2.6,
    "markeredgewidth": 0.7,
}
_AGENT: Mapping[str, Any] = {"marker": "o", "markersize": 4, "markeredgecolor": PAPER, "markeredgewidth": 0.5}
_PAST: Mapping[str, Any] = {"alpha": FADED, "linewidth": 1.3}
_SEEN: Mapping[str, Any] = {"linewidth": 1.7, "solid_capstyle": "round"}
_GOAL: Mapping[str, Any] = {"facecolor": PAPER, "edgecolor": MUTED, "linewidth": 0.8}
_REACH: Mapping[str, Any] = {"fill": False, "edgecolor": MUTED, "linestyle": (0, (1, 1)), "linewidth": 0.8}
_SUCCESS: Mapping[str, Any] = {"edgecolor": MUTED, "linewidth": 0.8}
_FAILURE: Mapping[str, Any] = {"edgecolor": ALERT, "linewidth": 1.6}


def killing_step(episode: Trajectory) -> int | None:
    """The step (from 0) whose attack killed the zombie: the first at a distance below 1. None if it lived.

    >>> seen = np.array([[7.1, 0.8, 1.2, 1.5], [6.6, 0.8, 0.7, 1.5], [6.1, 0.8, 0.9, 1.5]])
    >>> killing_step(Trajectory(seen, np.array([[1.0, 0.8], [1.0, 0.8]])))
    1
    >>> killing_step(Trajectory(seen, np.array([[1.0, 0.8], [0.0, 0.8]]))) is None
    True
    """
    hits = np.flatnonzero((episode.actions[:, 0] == 1) & (episode.observations[: len(episode), 2] < RANGE))
    return int(hits[0]) if len(hits) else None


def square_around(episodes: Sequence[Trajectory]) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of a square that holds the goal and all starts, with a margin.

    >>> corners = square_around([Trajectory(np.array([[50**0.5, np.pi / 4, 2.0, np.pi / 2]]), np.zeros((1, 2)))])
    >>> [corner.round(6).tolist() for corner in corners]
    [[-1.0, -1.0], [6.0, 6.0]]
    """
    starts = chain.from_iterable(zombie_paths(episode.observations[:1]) for episode in episodes)
    places = np.concatenate([GOAL[None], *starts])
    low, high = places.min(0) - MARGIN, places.max(0) + MARGIN
    missing = float((high - low).max()) - (high - low)
    return low - missing / 2, high + missing / 2


class ZombieCell:
    """One episode on axes of its own: `show` brings it to any step, and leaves it there once it has ended.

    The states among the latest `window` (None for all) are in full `colour`. A frame says that the episode has
    ended; a failure's stands out, with a word.

    >>> from matplotlib.figure import Figure
    >>> seen = np.array([[7.1, 0.8, 2.0, 1.5], [6.6, 0.8, 0.7, 1.5], [6.1, 0.8, 0.9, 1.5]])
    >>> episode = Trajectory(seen, np.array([[0.0, 0.8], [1.0, 0.8]]))
    >>> cell = ZombieCell(Figure().add_subplot(), episode, window=1, colour=INK, succeeded=False)
    >>> cell.show(2)
    >>> cell.flag.get_visible(), cell.corpse.get_visible(), len(cell.seen.get_xdata())
    (True, True, 1)
    """

    def __init__(self, axes: Axes, episode: Trajectory, *, window: int | None, colour: str, succeeded: bool) -> None:
        self._length, self._window, self._succeeded = len(episode), window or len(episode) + 1, succeeded
        self._agent, self._zombie = zombie_paths(episode.observations)
        self._attacks = np.flatnonzero(episode.actions[:, 0] == 1)
        self._killing = killing_step(episode)
        self._spines = list(axes.spines.values())
        axes.set(xticks=[], yticks=[], facecolor=(*to_rgb(RULE), 0.25))
        axes.xaxis.set_visible(False)  # an empty axis still takes time in every frame
        axes.yaxis.set_visible(False)
        axes.add_patch(Circle((GOAL[0], GOAL[1]), GOAL_RADIUS, **_GOAL))
        (self.chase,) = axes.plot([], [], color=INK, alpha=FADED, linewidth=0.6)
        (self.past,) = axes.plot([], [], color=colour, **_PAST)
        (self.seen,) = axes.plot([], [], color=colour, **_SEEN)
        (self.corpse,) = axes.plot([], [], **_CORPSE)
        (self.attacks,) = axes.plot([], [], **_ATTACK)
        (self.zombie,) = axes.plot([], [], **_ZOMBIE)
        self.reach = Circle((0, 0), RANGE, **_REACH)
        axes.add_patch(self.reach)
        (self.agent,) = axes.plot([], [], color=colour, **_AGENT)
        flag = {"boxstyle": "square,pad=0.2", "facecolor": ALERT, "edgecolor": ALERT, "linewidth": 0.5}
        self.flag = axes.text(
            0.035, 0.955, "failed", transform=axes.transAxes, ha="left", va="top", size=5.5, color=PAPER, bbox=flag
        )

    def show(self, step: int) -> None:
        """Show what is the case after `step` actions."""
        now = min(step, self._length)
        oldest = max(0, now - self._window + 1)
        dead = self._killing is not None and self._killing < now
        self.past.set_data(*self._agent[: oldest + 1].T)
        self.seen.set_data(*self._agent[oldest : now + 1].T)
        self.agent.set_data(*self._agent[now : now + 1].T)
        self.attacks.set_data(*self._agent[self._attacks[self._attacks < now]].T)
        self.chase.set_data(*self._zombie[: now + 1].T)
        self.zombie.set_data(*self._zombie[now : now + 1].T)
        self.corpse.set_data(*self._zombie[now : now + 1].T)
        self.reach.set_center((float(self._zombie[now, 0]), float(self._zombie[now, 1])))
        self.corpse.set_visible(dead)
        self.zombie.set_visible(not dead)
        self.reach.set_visible(not dead)
        ended = now == self._length
        self.flag.set_visible(ended and not self._succeeded)
        for spine in self._spines:
            spine.set_visible(ended)
            spine.set(**(_SUCCESS if self._succeeded else _FAILURE))


def draw_key(axes: Axes, colour: str, window: int | None) -> None:
    """What the marks of a `ZombieCell` mean, on axes of `KEY_SIZE` inches, which become their units.

    >>> from matplotlib.figure import Figure
    >>> axes = Figure().add_subplot()
    >>> draw_key(axes, INK, window=4)
    >>> [text.get_text() for text in axes.texts][:3]
    ['bot and the states it sees', 'states it no longer sees', 'attack']
    """
    width, height = KEY_SIZE
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    rows = [height * (row + 0.5) / 4 for row in reversed(range(4))]
    left, right = 0.14, 1.8
    first, second, third, fourth = rows
    axes.plot([left - 0.12, left + 0.08], [first, first], color=colour, **_SEEN)
    axes.plot(left + 0.08, first, color=colour, **_AGENT)
    words = [(left, first, "bot and its path" if window is None else "bot and the states it sees")]
    attack, goal = (second, third) if window is None else (third, fourth)
    if window is not None:
        axes.plot([left - 0.12, left + 0.12], [second, second], color=colour, **_PAST)
        words.append((left, second, "states it no longer sees"))
    axes.plot(left, attack, **_ATTACK)
    axes.add_patch(Circle((left, goal), 0.05, **_GOAL))
    axes.plot(right, first, **_ZOMBIE)
    axes.add_patch(Circle((right, first), 0.08, **_REACH))
    axes.plot(right, second, **_CORPSE)
    axes.add_patch(Rectangle((right - 0.07, third - 0.07), 0.14, 0.14, fill=False, **_SUCCESS))
    axes.add_patch(Rectangle((right - 0.07, fourth - 0.07), 0.14, 0.14, fill=False, **_FAILURE))
    words += [(left, attack, "attack"), (left, goal, "goal"), (right, first, "zombie and its range")]
    words += [(right, second, "dead zombie"), (right, third, "succeeded"), (right, fourth, "failed")]
    for x, y, word in words:
        axes.text(x + 0.2, y, word, va="center", size=SMALL_TEXT_SIZE, color=INK)
