"""One recorded or generated episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from numpy.typing import NDArray

from tvae.errors import TvaeError
from tvae.spaces import FloatArray

Attribute: TypeAlias = str | int | float | bool
"""A fact about a whole episode, such as its label or the pair of players."""


class DataError(TvaeError):
    """Data that cannot be used; the message says what was needed, what came, and where."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A trajectory tau = (s_1, a_1, ..., s_T, a_T) and, where it was recorded, s_{T+1}.

    Raises `DataError` if it is empty or its arrays do not fit together.

    >>> import numpy as np
    >>> walk = Trajectory(observations=np.zeros((4, 2)), actions=np.ones((3, 1)))
    >>> len(walk), walk.has_final_observation
    (3, True)
    """

    observations: FloatArray
    """(T, O), or (T + 1, O) with the observation after the last action: raw values, one column per signal."""
    actions: FloatArray
    """(T, A): raw values, one column per signal."""
    steps: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Further columns of T values, such as `reward`, `terminated`, `truncated`."""
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    """Facts about the whole episode, such as `episode`, `label`, `group`."""

    def __post_init__(self) -> None:
        if self.observations.ndim != 2 or self.actions.ndim != 2:
            raise DataError(
                "observations and actions need the shapes (steps, signals), "
                f"got {self.observations.shape} and {self.actions.shape}"
            )
        length = len(self.actions)
        if length == 0:
            raise DataError("an episode needs at least one action, got none")
        if len(self.observations) not in {length, length + 1}:
            raise DataError(
                f"{length} actions need {length} or {length + 1} observations, got {len(self.observations)}"
            )
        for name, values in self.steps.items():
            if len(values) != length:
                raise DataError(f"step column {name!r} needs {length} values, got {len(values)}")

    def __len__(self) -> int:
        """Number of actions T."""
        return len(self.actions)

    @property
    def has_final_observation(self) -> bool:
        """Whether the observation after the last action was recorded."""
        return len(self.observations) == len(self.actions) + 1
