"""Heads give proper laws: densities that integrate to 1, relative to their origin, finite at every extreme."""

import numpy as np
import pytest
import torch
from scipy import special, stats

from toys import ACTIONS, OBSERVATIONS
from tvae.device import seeded
from tvae.heads import Head
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

CPU = torch.device("cpu")
KINDS = {
    "continuous": Space((Continuous("x"),)),
    "angular": Space((Angular("heading"),)),
    "binary": Space((Binary("a"), Binary("b"))),
    "categorical": Space((Categorical("a", (0, 1, 2)), Categorical("b", ("x",)), Categorical("c", (5, 6)))),
    "mixed": Space((Binary("attack"), Angular("heading"), Categorical("tool", (0, 1, 2)), Continuous("force"))),
}


def head_of(space: Space, num_components: int = 1, *, floor: float = 0.02, gain: float = 1.0) -> Head:
    with seeded(7, CPU):
        head = Head(space, 4, floor=floor, num_components=num_components).double()
    with torch.no_grad():
        for parameter in head.parameters():
            parameter.mul_(gain)
    return head


def grid(space: Space) -> tuple[torch.Tensor, float]:
    """Rows that cover the space, and the volume for which each stands."""
    axes, volume = [], 1.0
    for signal in space.signals:
        match signal:
            case Continuous():
                axes.append(np.linspace(-30, 30, 401))
                volume *= 60 / 400
            case Angular():
                axes.append(np.linspace(-np.pi, np.pi, 120, endpoint=False))
                volume *= 2 * np.pi / 120
            case Binary():
                axes.append(np.arange(2.0))
            case Categorical(_, categories):
                axes.append(np.arange(float(len(categories))))
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, space.num_columns)
    return torch.from_numpy(mesh), volume


@pytest.mark.parametrize("num_components", [1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_densities_integrate_to_1(kind: str, num_components: int):
    space = KINDS[kind]
    head = head_of(space, num_components)
    rows, volume = grid(space)
    features = torch.linspace(-1, 1, 4, dtype=torch.float64).expand(len(rows), -1)
    law = head(features, torch.full_like(rows, 0.4))
    assert law.log_prob(rows).exp().sum().item() * volume == pytest.approx(1, abs=1e-6)


def test_parameters_are_those_of_the_table():
    """m = origin + unit output, s = unit (floor + softplus(.)), k = 1 / s^2: against scipy."""
    head = head_of(KINDS["mixed"], floor=0.1)
    head.unit.copy_(torch.tensor([1.0, 0.5, 1.0, 3.0]))
    features = torch.tensor([0.3, -1.0, 2.0, 0.5], dtype=torch.float64)
    mean, spread, x, y, width, odds, *weights = head.parameters_of_law(features).detach().numpy()
    row, origin = np.array([1.0, -2.0, 2.0, 0.7]), np.array([0.0, 1.5, 0.0, -4.0])
    law = head(features, torch.from_numpy(origin))
    heading = stats.vonmises((0.5 * (0.1 + np.logaddexp(0, width))) ** -2, loc=1.5 + np.arctan2(y, 1 + x))
    expected = [
        stats.bernoulli(special.expit(odds)).logpmf(1),
        heading.logpdf(-2.0),
        stats.multinomial(1, special.softmax(weights)).logpmf([0, 0, 1]),
        stats.norm(-4 + 3 * mean, 3 * (0.1 + np.logaddexp(0, spread))).logpdf(0.7),
    ]
    np.testing.assert_allclose(law.log_prob_by_column(torch.from_numpy(row)).detach(), expected)


def test_change_is_measured_from_the_origin_in_units():
    """Moving the origin moves the law; a unit stretches it."""
    space = Space((Continuous("x"), Angular("heading")))
    head, features = head_of(space), torch.ones(4, dtype=torch.float64)
    row, shift = torch.tensor([1.0, 0.5], dtype=torch.float64), torch.tensor([5.0, 2.0], dtype=torch.float64)
    here = head(features, torch.zeros_like(row)).log_prob(row)
    torch.testing.assert_close(here, head(features, shift).log_prob(row + shift))
    head.unit.copy_(torch.tensor([10.0, 1.0]))
    stretched = head(features, torch.zeros_like(row)).log_prob(row * torch.tensor([10.0, 1.0]))
    torch.testing.assert_close(stretched, here - np.log(10))


def test_unknown_angle_points_to_the_origin():
    head = head_of(Space((Angular("heading"),)), gain=0.0)
    assert head(torch.zeros(4, dtype=torch.float64), torch.tensor([2.5], dtype=torch.float64)).mode().item() == 2.5


@pytest.mark.parametrize("num_components", [1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_draws_agree_with_the_density(kind: str, num_components: int):
    """Each column of the draws against its marginal on the grid."""
    space = KINDS[kind]
    head = head_of(space, num_components)
    features = torch.linspace(-1, 1, 4, dtype=torch.float64)
    rows, volume = grid(space)
    mass = head(features.expand(len(rows), -1), torch.zeros_like(rows)).log_prob(rows).exp() * volume
    with seeded(11, CPU):
        draws = head(features.expand(4_000, -1), torch.zeros(4_000, space.num_columns, dtype=torch.float64)).sample()
    for column, signal in enumerate(space.signals):
        places, index = np.unique(rows[:, column], return_inverse=True)
        marginal = np.bincount(index, mass.detach().numpy())
        if isinstance(signal, Continuous | Angular):
            middle = places + (places[1] - places[0]) / 2
            cumulative = np.cumsum(marginal)
            values = draws[:, column].numpy()
            assert stats.kstest(values, lambda v, m=middle, c=cumulative: np.interp(v, m, c)).pvalue > 1e-3
        elif len(places) > 1:
            counts = np.bincount(draws[:, column].long(), minlength=len(places))
            assert stats.chisquare(counts, marginal / marginal.sum() * 4_000).pvalue > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_mode_is_a_mode(kind: str):
    space = KINDS[kind]
    head = head_of(space)
    features = torch.linspace(-1, 1, 4, dtype=torch.float64)
    rows, _ = grid(space)
    law = head(features.expand(len(rows), -1), torch.zeros_like(rows))
    best = head(features, torch.zeros(space.num_columns, dtype=torch.float64))
    assert best.log_prob(best.mode()) >= law.log_prob(rows).max() - 1e-12


@pytest.mark.parametrize("away", [0.0, 1e3])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e4])
@pytest.mark.parametrize("gain", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("num_components", [1, 2])
def test_extremes_stay_finite_in_single_precision(gain: float, unit: float, away: float, num_components: int):
    for space in (OBSERVATIONS, ACTIONS):
        head = head_of(space, num_components, floor=0.02, gain=gain).float()
        head.unit.fill_(unit)
        features = torch.eye(4).repeat(2, 1) * torch.tensor([[1.0]] * 4 + [[-1.0]] * 4)
        rows = torch.zeros(8, space.num_columns)
        rows[:, space.continuous] = away
        rows[:, space.angular] = 3.0
        features.requires_grad_()
        density = head(features, torch.zeros_like(rows)).log_prob(rows)
        density.sum().backward()
        assert density.isfinite().all()
        assert features.grad.isfinite().all()
        assert all(parameter.grad.isfinite().all() for parameter in head.parameters())


def test_one_law_has_no_weights_that_never_learn():
    assert {name.split(".")[0] for name, _ in Head(ACTIONS, 4, floor=0.1).named_parameters()} == {"parameters_of_law"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"floor": 0.0}, "floor must be positive, got 0.0"), ({"floor": 0.1, "num_components": 0}, "at least 1, got 0")],
)
def test_nonsense_is_refused(arguments: dict, message: str):
    with pytest.raises(ValueError, match=message):
        Head(ACTIONS, 4, **arguments)
