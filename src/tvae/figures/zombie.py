"""The zombie task as a picture of its plane, computed back from the observed distances and bearings."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from tvae.data.trajectory import Trajectory
from tvae.figures.palette import MUTED, STYLE_COLOURS
from tvae.figures.trajectories import draw_events, draw_path
from tvae.spaces import FloatArray

_GOAL = np.array([5.0, 5.0])
_GOAL_RADIUS = 0.5
_ZOMBIE_RANGE = 1.0


def zombie_paths(observations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places of the agent and of the zombie, (N, 2) each, from observations (N, 4).

    The columns are the distance and bearing of the goal, and the distance and bearing of the zombie.

    >>> agent, zombie = zombie_paths(np.array([[50**0.5, np.pi / 4, 2.0, np.pi / 2]]))
    >>> bool(np.allclose(agent, [[0, 0]])), bool(np.allclose(zombie, [[0, 2]]))
    (True, True)
    """
    goal_distance, goal_bearing, zombie_distance, zombie_bearing = observations.T[:, :, None]
    agent = _GOAL - goal_distance * np.hstack([np.cos(goal_bearing), np.sin(goal_bearing)])
    return agent, agent + zombie_distance * np.hstack([np.cos(zombie_bearing), np.sin(zombie_bearing)])


def draw_zombie(axes: Axes, trajectory: Trajectory, colour: str = STYLE_COLOURS[0]) -> None:
    """The goal, the agent's path in `colour`, a cross an attack, the zombie's path, its range at the end.

    Actions have the columns `attack` and `heading`.

    >>> from tvae.figures.canvas import new_figure
    >>> axes = new_figure(2, 2).add_subplot()
    >>> seen = np.array([[7.1, 0.8, 2.0, 1.5], [6.6, 0.8, 1.3, 1.5]])
    >>> draw_zombie(axes, Trajectory(seen, np.array([[0.0, 0.8], [1.0, 0.8]])))
    >>> [line.get_label() for line in axes.lines]
    ['zombie', 'start', 'end', 'agent', 'start', 'end', 'attack']
    """
    agent, zombie = zombie_paths(trajectory.observations)
    axes.set_aspect("equal")
    circles = (("goal", _GOAL, _GOAL_RADIUS, "-"), ("the zombie's range", zombie[-1], _ZOMBIE_RANGE, ":"))
    for name, (x, y), radius, line in circles:
        circle = Circle((x, y), radius, fill=False, edgecolor=MUTED, linestyle=line, linewidth=0.8, label=name)
        axes.add_patch(circle)
    draw_path(axes, zombie, MUTED, linestyle=(0, (1, 1.5)), label="zombie")
    draw_path(axes, agent, colour, label="agent")
    draw_events(axes, agent[: len(trajectory)][trajectory.actions[:, 0] == 1], label="attack")
