"""Where a run's demonstrations come from, so that they can be read again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tvae.data.demonstrations import Demonstrations
from tvae.data.segments import segment
from tvae.data.sources import load_demonstrations
from tvae.spaces import Space


@dataclass(frozen=True)
class Source:
    """A data set and how it is read."""

    path: str
    """File, directory or Minari id."""
    angular: tuple[str, ...] = ()
    """Columns that are angles."""
    continuous: tuple[str, ...] = ()
    """Columns that are numbers."""
    categorical: tuple[str, ...] = ()
    """Columns that are categories."""
    segment: int | None = None
    """Cut recordings into segments of at most so many steps."""

    def load(self, observation_space: Space | None = None, action_space: Space | None = None) -> Demonstrations:
        """Read the demonstrations; given spaces, such as a model's, must fit.

        `DataError` says what is wrong with them.
        """
        demonstrations = load_demonstrations(
            self.path,
            angular=self.angular,
            continuous=self.continuous,
            categorical=self.categorical,
            observation_space=observation_space,
            action_space=action_space,
        )
        return demonstrations if self.segment is None else segment(demonstrations, self.segment)

    def absolute(self) -> Source:
        """The same, found from any working directory."""
        here = Path(self.path)
        path = str(here.resolve()) if here.exists() else self.path
        return Source(path, self.angular, self.continuous, self.categorical, self.segment)
