"""What values an episode may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tvae.data.trajectory import Attribute, DataError, Trajectory
from tvae.spaces import Space


def attribute_values(name: str, values: list[Attribute]) -> NDArray[Any]:
    """(E,) one value an episode; numbers and text do not mix.

    >>> attribute_values("level", [3, 1]).tolist()
    [3, 1]
    """
    array = np.array(values)
    mixed = array.dtype.kind == "U" and not all(isinstance(value, str) for value in values)
    if array.dtype.kind not in "biufU" or mixed or array.ndim != 1:
        kinds = ", ".join(sorted({type(value).__name__ for value in values}))
        raise DataError(f"attribute {name!r} needs text, numbers or booleans, of one kind; got {kinds}")
    return array


def check(trajectory: Trajectory, observation_space: Space, action_space: Space, episode: Attribute) -> None:
    """Raise `DataError` naming episode, step and column where a value does not fit its space."""
    for what, space, rows in (
        ("observation", observation_space, trajectory.observations),
        ("action", action_space, trajectory.actions),
    ):
        if rows.shape[1] != space.num_columns:
            raise DataError(
                f"episode {episode}: {what}s need {space.num_columns} columns "
                f"({', '.join(space.names)}), got {rows.shape[1]}"
            )
        problem = space.first_problem(rows)
        if problem is not None:
            raise DataError(
                f"episode {episode}, step {problem.row}, column {what}.{problem.column}: {problem.message}"
            )
