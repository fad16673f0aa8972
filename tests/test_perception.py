"""How a policy sees a state."""

from __future__ import annotations

import numpy as np
import torch

from tvae.model.perception import NoPerception, Perception
from tvae.spaces import Angular, Binary, Continuous, Space

SPACE = Space((Angular("goal"), Continuous("range"), Continuous("x"), Angular("enemy"), Binary("alive")))
ROWS = np.array([[0.1, 0.5, -2.0, 1.0, 1.0], [3.0, 8.0, 4.0, -3.0, 0.0], [-2.0, 2.0, 1.0, 0.5, 1.0]])


def fitted() -> Perception:
    perception = Perception(SPACE)
    perception.fit(ROWS)
    return perception


def test_values_beyond_the_training_data_count_as_its_edge():
    row = torch.tensor([[9.0, 100.0, -7.0, -9.0, 1.0]])
    torch.testing.assert_close(fitted().within(row), torch.tensor([[9.0, 8.75, -2.6, -9.0, 1.0]]))  # and a tenth more
    inside = torch.from_numpy(ROWS).float()
    torch.testing.assert_close(fitted().within(inside), inside)
    assert torch.equal(NoPerception().within(row), row)
    assert NoPerception()(row).shape == (1, 0)


def test_proportions_of_positive_signals_alone():
    seen = fitted()(torch.from_numpy(ROWS).float())
    logs = np.log(ROWS[:, 1])
    np.testing.assert_allclose(seen[:, 0], (logs - logs.mean()) / logs.std(), atol=1e-6)
    assert seen[:, 1].tolist() == [0, 0, 0]  # x is negative somewhere
    assert fitted()(torch.tensor([[0.0, -1.0, 3.0, 0.0, 0.0]])).isfinite().all()


def test_a_positive_signal_that_reaches_zero_counts_as_little_less_than_its_least():
    perception = fitted()
    for value in (0.0, -0.25, 1e-6):  # the range of the logarithm is log 16, of which a tenth is log 1.32
        near = perception(perception.within(torch.tensor([[0.0, value, 0.0, 0.0, 1.0]])))
        torch.testing.assert_close(near, perception(torch.tensor([[0.0, 0.5 / 16**0.1, 0.0, 0.0, 1.0]])))
    assert (perception(torch.from_numpy(ROWS[:1]).float())[:, 0] > near[:, 0]).all()


def test_relative_directions_do_not_know_where_north_is():
    row = torch.from_numpy(ROWS[:1]).float()
    turned = row + torch.tensor([[0.7, 0.0, 0.0, 0.7, 0.0]])
    torch.testing.assert_close(fitted()(row), fitted()(turned))
    torch.testing.assert_close(fitted()(row)[0, 2:], torch.tensor([np.cos(0.9), np.sin(0.9)]).float())


def test_a_constant_signal_has_no_proportions():
    perception = Perception(Space((Continuous("x"),)))
    perception.fit(np.full((5, 1), 3.0))
    assert perception(torch.tensor([[3.0], [6.0]])).tolist() == [[0.0], [0.0]]
