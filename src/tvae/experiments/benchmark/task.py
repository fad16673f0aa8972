"""What a benchmark must know of a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tvae.baselines.contract import Envs, World
from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.spaces import IntArray


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task of the benchmark."""

    env: str
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the environment is made with."""
    episodes: int = 1000
    """Fresh episodes of each bot, where no other number is asked for."""
    labels: tuple[str, ...]
    """Of its styles; none where nobody has a name for what demonstrations differ in."""
    world: World
    demonstrations: Callable[[Path, int], Demonstrations]
    """Of the folder of recordings and a seed: what methods learn from."""
    test: Callable[[Path, int], Demonstrations]
    """Likewise: those held out, which no method has seen."""
    config: RunConfig
    """Our own."""
    shown: Callable[[Demonstrations], IntArray]
    """(E,) which label's style each episode shows; all 0 where there are no labels."""
    succeeded: Callable[[Demonstrations], NDArray[np.bool_]]
    """(E, K) whether each episode succeeds in the style of each label; (E, 1) where there are no labels."""
    numbers: Callable[[Demonstrations, str], Mapping[str, float]] = lambda episodes, label: {}
    """Further numbers about episodes as those of a label."""
    overall: Callable[[Demonstrations], Mapping[str, float]] = lambda episodes: {}
    """Further numbers about episodes at will."""
    quality: str = "at_will.success"
    """The number that tells how good those are who cannot be asked for a style."""
    as_demonstrated: Callable[[Demonstrations, Demonstrations], Demonstrations] = lambda episodes, test: episodes
    """Episodes cut to where demonstrators would have ended; the second are those held out."""
    apart: Callable[[Demonstrations], Demonstrations] = lambda demonstrations: demonstrations
    """Those of the demonstrations in which no step comes twice."""

    def envs(self, count: int) -> Envs:
        """So many copies of the environment."""
        return gymnasium.make_vec(self.env, num_envs=count, **self.options)
