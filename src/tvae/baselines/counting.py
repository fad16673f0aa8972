"""Environment steps, counted wherever a method takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray


class StepCounter:
    """How many environment steps were taken, all copies together.

    >>> import gymnasium
    >>> from tvae.envs.zombie import StraightWalk
    >>> from tvae.rollouts import rollout
    >>> steps = StepCounter()
    >>> envs = steps.of(gymnasium.make_vec("tvae/Navigation-v0", num_envs=3))
    >>> _ = envs.reset(seed=0)
    >>> _ = envs.step(np.zeros(3))
    >>> steps.count
    3
    """

    def __init__(self) -> None:
        self.count = 0

    def of(self, envs: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
        """The same environment, whose steps are counted from now on."""
        return _Counted(envs, self)


class _Counted(VectorWrapper):
    """Counts every step of every copy, but for those in which a copy only starts anew."""

    def __init__(self, envs: VectorEnv[Any, Any, Any], counter: StepCounter) -> None:
        super().__init__(envs)
        self._counter = counter
        self._restarts: NDArray[np.bool_] = np.zeros(envs.num_envs, dtype=np.bool_)

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        self._restarts = np.zeros(self.num_envs, dtype=np.bool_)
        return self.env.reset(**kwargs)

    def step(self, actions: Any) -> Any:
        self._counter.count += int((~self._restarts).sum())
        result = self.env.step(actions)
        self._restarts = result[2] | result[3]
        return result
