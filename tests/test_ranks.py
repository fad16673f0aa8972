"""Ordered categories as an encoder reads them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from toys import ACTIONS, noise, untrained
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.model.ranks import Ranks
from tvae.spaces import Binary, Categorical, Continuous, Space

GRID = Space((Categorical("x", (1, 2, 3)), Continuous("speed"), Categorical("y", (1, 2, 3))))
WALK = Space((Binary("go"),))
ROUND = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
"""Once around the middle of the grid: x to the right, y downwards."""


def walks(*laps: float) -> Demonstrations:
    """Of 41 places each, so many laps, backwards where negative, standing at their ends."""
    episodes = []
    for count in laps:
        steps = np.minimum(np.arange(41), round(8 * abs(count))) * int(np.sign(count))
        places = np.array(ROUND)[steps % 8]
        rows = np.column_stack([places[:, 0], np.zeros(41), places[:, 1]]).astype(np.float64)
        episodes.append(Trajectory(rows, np.zeros((40, 1))))
    return Demonstrations.from_trajectories(episodes, GRID, WALK)


def areas(ranks: Ranks, demonstrations: Demonstrations) -> np.ndarray:
    batch = batch_of(demonstrations, np.arange(len(demonstrations)))
    return ranks.areas(ranks(batch.observations), batch.mask).numpy()


@pytest.mark.parametrize(
    ("signal", "ordered"),
    [
        (Categorical("x", (0, 1, 2)), True),
        (Categorical("x", (-4, 7, 8)), True),
        (Categorical("x", (0, 1)), False),
        (Categorical("x", (0, 2, 1)), False),
        (Categorical("x", ("a", "b", "c")), False),
        (Categorical("x", (1, "b", 3)), False),
        (Continuous("x"), False),
    ],
)
def test_which_signals_are_read(signal, ordered):
    assert Ranks(Space((signal,))).num_features == 2 * ordered


def test_areas_are_linear_in_laps():
    laps = np.array([0, 1, 2.5, -1, 4, -3, 4.5])
    demonstrations = walks(*laps)
    ranks = Ranks(GRID)
    ranks.fit(demonstrations)
    found = areas(ranks, demonstrations)[:, 0]
    np.testing.assert_allclose(found, laps * (found[1] / laps[1]), atol=0.05 * found[1])
    assert found.std() == pytest.approx(1, abs=1e-5)


def test_ranks_and_changes_are_in_standard_deviations():
    demonstrations = walks(2, -1)
    ranks = Ranks(GRID)
    ranks.fit(demonstrations)
    batch = batch_of(demonstrations, np.arange(2))
    read = ranks(batch.observations)
    np.testing.assert_allclose(read[..., :2].mean((0, 1)), 0, atol=1e-6)
    np.testing.assert_allclose(read[..., :2].std((0, 1), correction=0), 1, atol=1e-6)
    assert (read[:, 0, 2:] == 0).all()
    torch.testing.assert_close(read[:, 1:, 2:], read[:, 1:, :2] - read[:, :-1, :2])


def test_who_never_moves_sweeps_nothing():
    still = walks(0, 0)
    ranks = Ranks(GRID)
    ranks.fit(still)
    assert all(value.isfinite().all() for value in ranks.state_dict().values())
    assert (areas(ranks, still) == 0).all()


def test_what_has_no_order_leaves_a_model_as_it_would_be():
    space = Space((Continuous("x"), Categorical("held", ("a", "b", "c"))))
    model = untrained(noise([3], observation_space=space))
    assert model.ranks.state_dict() == {}
    assert model.encoder.of_summary is None


def test_padding_changes_no_posterior():
    demonstrations = noise([5, 9, 2], observation_space=GRID, action_space=ACTIONS)
    model = untrained(demonstrations)
    assert model.encoder.of_summary is not None
    with torch.no_grad():
        together = model.posterior(batch_of(demonstrations, np.arange(3))).mean
        for index in range(3):
            alone = model.posterior(batch_of(demonstrations, np.array([index]))).mean
            torch.testing.assert_close(together[index : index + 1], alone, rtol=1e-5, atol=1e-5)
