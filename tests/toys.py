"""Small demonstrations and models that the tests of the model share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.device import seeded
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

OBSERVATIONS = Space(
    (
        Categorical("room", ("hall", "attic", "cellar")),
        Continuous("x"),
        Angular("bearing"),
        Binary("alive"),
        Continuous("y"),
        Categorical("door", (0, 1)),
    )
)
ACTIONS = Space((Binary("attack"), Angular("heading"), Categorical("tool", (1, 2, 3, 4)), Continuous("force")))
ONE = Space((Continuous("x"),))


def rows(space: Space, count: int, random: np.random.Generator) -> np.ndarray:
    """Any rows of a space: numbers around 3 with spread 2, angles, categories and buttons, uniform."""
    values = 3 + 2 * random.normal(size=(count, space.num_columns))
    values[:, space.angular] = random.uniform(-np.pi, np.pi, (count, len(space.angular)))
    values[:, space.binary] = random.integers(0, 2, (count, len(space.binary)))
    for column, number in zip(space.categorical, space.num_categories, strict=True):
        values[:, column] = random.integers(0, number, count)
    return values


def noise(
    lengths: Sequence[int],
    final: Sequence[bool] | None = None,
    *,
    observation_space: Space = OBSERVATIONS,
    action_space: Space = ACTIONS,
    seed: int = 0,
) -> Demonstrations:
    """Demonstrations of these lengths without any sense; with all final observations if not said otherwise."""
    random = np.random.default_rng(seed)
    ends = [True] * len(lengths) if final is None else final
    episodes = (
        Trajectory(rows(observation_space, length + end, random), rows(action_space, length, random))
        for length, end in zip(lengths, ends, strict=True)
    )
    return Demonstrations.from_trajectories(episodes, observation_space, action_space)


def two_styles(count: int, length: int = 10, seed: int = 0) -> Demonstrations:
    """Walks on a line: half of them to the left, half to the right, with steps of about 1."""
    random = np.random.default_rng(seed)

    def walk(index: int) -> Trajectory:
        side = 1.0 if index % 2 else -1.0
        moves = side + 0.1 * random.normal(size=(length, 1))
        places = np.concatenate([[[0.0]], np.cumsum(moves, axis=0)])
        return Trajectory(places + 0.1 * random.normal(), moves, attributes={"label": "right" if index % 2 else "left"})

    return Demonstrations.from_trajectories((walk(index) for index in range(count)), ONE, ONE)


def untrained(demonstrations: Demonstrations, *, seed: int = 0, **arguments: Any) -> TrajectoryVAE:
    """A calibrated model with small nets and first weights that depend on the seed alone, in evaluation mode."""
    with seeded(seed, torch.device("cpu")):
        model = TrajectoryVAE(
            demonstrations.observation_space,
            demonstrations.action_space,
            **{"hidden_features": 8, **arguments},
        )
    model.calibrate(demonstrations)
    return model.eval()
