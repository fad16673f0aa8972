"""Laws of single columns and of rows, against scipy."""

import numpy as np
import pytest
import torch
from scipy import special, stats
from torch.distributions import Bernoulli, Categorical, Independent, Normal

from tvae.device import seeded
from tvae.distributions import Columns, Joint, Mixture, VonMises, most_likely, tempered

CPU = torch.device("cpu")
CONCENTRATIONS = [1e-8, 1e-3, 0.2, 1.0, 7.0, 60.0, 999.0, 1_001.0, 2_500.0, 1e6]


def von_mises(mean: float, concentration: float, dtype: torch.dtype = torch.float64) -> VonMises:
    return VonMises(torch.tensor(mean, dtype=dtype), torch.tensor(concentration, dtype=dtype))


@pytest.mark.parametrize("concentration", CONCENTRATIONS)
def test_von_mises_density_is_that_of_scipy(concentration: float):
    angles = np.linspace(-np.pi, np.pi, 41)
    expected = stats.vonmises(concentration, loc=0.5).logpdf(angles)
    ours = von_mises(0.5, concentration).log_prob(torch.from_numpy(angles))
    np.testing.assert_allclose(ours, expected, rtol=1e-7, atol=1e-7)
    single = von_mises(0.5, concentration, torch.float32).log_prob(torch.from_numpy(angles).float())
    np.testing.assert_allclose(single, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("concentration", CONCENTRATIONS)
def test_von_mises_gradient_is_exact_in_single_precision(concentration: float):
    """d log p / d log k = k (cos x - I1(k) / I0(k)), here at x = 1 / sqrt(k) from the mean."""
    log_k = torch.tensor(np.log(concentration), dtype=torch.float32, requires_grad=True)
    away = min(1.0, concentration**-0.5)
    VonMises(torch.tensor(0.0), log_k.exp()).log_prob(torch.tensor(away)).backward()
    k = np.float64(concentration)
    small = 1 / (2 * k) + 1 / (8 * k**2) + 1 / (8 * k**3)  # 1 - I1/I0 for large k
    ratio = special.i1e(k) / special.i0e(k) if k < 1e3 else 1 - small
    np.testing.assert_allclose(log_k.grad, k * (np.cos(away) - ratio), rtol=1e-4, atol=2e-4)


@pytest.mark.parametrize("concentration", CONCENTRATIONS)
@pytest.mark.parametrize("mean", [0.0, 3.1, -40.0])
def test_von_mises_draws_follow_the_density(concentration: float, mean: float):
    law = VonMises(torch.full((20_000,), mean), torch.tensor(concentration))
    with seeded(0, CPU):
        angles = law.sample().double().numpy()
    assert (np.abs(angles) <= np.pi + 1e-6).all()
    away = (angles - mean + np.pi) % (2 * np.pi) - np.pi
    exact = stats.vonmises(concentration) if concentration < 1e5 else stats.norm(scale=concentration**-0.5)
    assert stats.kstest(away, exact.cdf).pvalue > 1e-3


def test_von_mises_draws_of_many_laws_at_once():
    means, concentrations = torch.tensor([[0.0], [2.0]]), torch.tensor([1.0, 50.0, 1e4])
    with seeded(1, CPU):
        angles = VonMises(means, concentrations).sample((8_000,))
    assert angles.shape == (8_000, 2, 3)
    for row, mean in enumerate((0.0, 2.0)):
        for column, concentration in enumerate((1.0, 50.0, 1e4)):
            away = (angles[:, row, column].numpy() - mean + np.pi) % (2 * np.pi) - np.pi
            assert stats.kstest(away, stats.vonmises(concentration).cdf).pvalue > 1e-3


def test_von_mises_of_no_number_ends():
    nothing = VonMises(torch.tensor(torch.nan), torch.tensor(1.0), validate_args=False)
    assert nothing.sample().isnan()
    spread = VonMises(torch.tensor(0.0), torch.tensor(torch.nan), validate_args=False)
    assert spread.sample().isnan()


@pytest.mark.parametrize("turns", [-3, 1, 2])
def test_angles_that_differ_by_full_turns_are_the_same(turns: int):
    law, angles = von_mises(1.0, 12.0), torch.linspace(-3, 3, 13, dtype=torch.float64)
    torch.testing.assert_close(law.log_prob(angles), law.log_prob(angles + 2 * torch.pi * turns))
    turned = von_mises(1.0 + 2 * torch.pi * turns, 12.0)
    torch.testing.assert_close(law.log_prob(angles), turned.log_prob(angles))


def joint(lead: tuple[int, ...] = ()) -> Joint:
    """Columns: category of 3, number, button, angle, number, category of 2 (in the same padded law)."""
    random = torch.Generator().manual_seed(5)

    def some(*shape: int) -> torch.Tensor:
        return torch.randn(*lead, *shape, generator=random, dtype=torch.float64)

    logits = some(2, 3)
    logits[..., 1, 2] = -torch.inf
    return Joint(
        6,
        (
            Columns(torch.tensor([1, 4]), Normal(some(2), some(2).exp())),
            Columns(torch.tensor([3]), VonMises(some(1), some(1).exp())),
            Columns(torch.tensor([2]), Bernoulli(logits=some(1), validate_args=False)),
            Columns(torch.tensor([0, 5]), Categorical(logits=logits, validate_args=False)),
        ),
    )


ROW = torch.tensor([2.0, 0.3, 1.0, -2.0, -0.5, 1.0], dtype=torch.float64)


def test_joint_is_the_product_of_its_columns():
    law = joint()
    number, angle, button, category = (part.law for part in law.parts)
    expected = [
        special.log_softmax(category.logits[0])[2],
        stats.norm(number.loc[0], number.scale[0]).logpdf(0.3),
        stats.bernoulli(button.probs[0].item()).logpmf(1),
        stats.vonmises(angle.concentration[0], loc=angle.loc[0]).logpdf(-2.0),
        stats.norm(number.loc[1], number.scale[1]).logpdf(-0.5),
        special.log_softmax(category.logits[1])[1],
    ]
    np.testing.assert_allclose(law.log_prob_by_column(ROW), expected)
    np.testing.assert_allclose(law.log_prob(ROW), sum(expected))


def test_draws_of_a_joint_have_its_marginals():
    law = joint()
    wide = Joint(
        6, tuple(Columns(p.columns, p.law.expand((20_000, *p.law.batch_shape))) for p in law.parts[:1] + law.parts[2:])
    )
    with seeded(2, CPU):
        rows = wide.sample().numpy()
    number, _, button, category = (part.law for part in law.parts)
    for index, column in enumerate((1, 4)):
        exact = stats.norm(number.loc[index], number.scale[index])
        assert stats.kstest(rows[:, column], exact.cdf).pvalue > 1e-3
    counts = np.bincount(rows[:, 2].astype(int), minlength=2)
    chance = special.expit(button.logits[0].item())
    assert stats.chisquare(counts, [20_000 * (1 - chance), 20_000 * chance]).pvalue > 1e-3
    counts = np.bincount(rows[:, 0].astype(int), minlength=3)
    assert stats.chisquare(counts, 20_000 * category.probs[0].numpy()).pvalue > 1e-3
    assert set(rows[:, 5]) == {0.0, 1.0}


def test_mode_of_a_joint_is_nowhere_beaten():
    law = joint((50,))
    best = law.log_prob(law.mode())
    with seeded(3, CPU):
        for _ in range(200):
            assert (law.log_prob(law.sample()) <= best + 1e-12).all()


def test_fair_coin_falls_on_0():
    assert most_likely(Bernoulli(logits=torch.zeros(2))).tolist() == [0.0, 0.0]


def test_law_without_known_mode_is_refused():
    with pytest.raises(TypeError, match="no mode is known for a Independent"):
        most_likely(Independent(Normal(torch.zeros(2), torch.ones(2)), 1))


def test_mixture_is_the_weighted_sum_of_its_components():
    law = Mixture(Categorical(logits=torch.tensor([0.0, 1.0, -2.0], dtype=torch.float64)), joint((3,)))
    expected = special.logsumexp(law.weights.logits + law.components.log_prob(ROW.expand(3, 6)))
    np.testing.assert_allclose(law.log_prob(ROW), expected)


def test_mixture_draws_whole_rows_of_one_component():
    """Two far corners: both columns must come from the same one, with the frequency of its weight."""
    corners = torch.tensor([[0.0, 0.0], [100.0, 100.0]])
    components = Joint(2, (Columns(torch.tensor([0, 1]), Normal(corners, torch.ones(2, 2))),))
    weights = Categorical(probs=torch.tensor([0.3, 0.7]))
    far = Joint(2, (Columns(torch.tensor([0, 1]), components.parts[0].law.expand((10_000, 2, 2))),))
    with seeded(4, CPU):
        rows = Mixture(weights.expand((10_000,)), far).sample()
    side = rows > 50
    assert (side[:, 0] == side[:, 1]).all()
    assert stats.binomtest(int(side[:, 0].sum()), 10_000, 0.7).pvalue > 1e-3
    assert Mixture(weights, components).mode().tolist() == [100.0, 100.0]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_draws_have_the_precision_of_the_law(dtype: torch.dtype):
    laws = (
        Normal(torch.zeros(1, dtype=dtype), torch.ones(1, dtype=dtype)),
        VonMises(torch.zeros(1, dtype=dtype), torch.ones(1, dtype=dtype)),
        Bernoulli(logits=torch.zeros(1, dtype=dtype)),
        Categorical(logits=torch.zeros(1, 3, dtype=dtype)),
    )
    for law in laws:
        row = Joint(1, (Columns(torch.tensor([0]), law),))
        assert row.sample().dtype == row.mode().dtype == dtype


@pytest.mark.parametrize("temperature", [0.3, 1.0, 2.5])
@pytest.mark.parametrize(
    ("law", "values"),
    [
        (Normal(torch.tensor(0.4), torch.tensor(1.3)), torch.linspace(-2, 3, 7)),
        (von_mises(0.4, 5.0), torch.linspace(-3, 3, 7, dtype=torch.float64)),
        (Categorical(probs=torch.tensor([0.6, 0.3, 0.1])), torch.arange(3.0)),
        (Bernoulli(probs=torch.tensor(0.8)), torch.arange(2.0)),
    ],
)
def test_a_tempered_density_is_a_power_of_the_law(law, values: torch.Tensor, temperature: float):
    difference = tempered(law, temperature).log_prob(values) - law.log_prob(values) / temperature
    torch.testing.assert_close(difference, difference[0].expand_as(difference))


def test_a_cold_mixture_draws_near_the_mode_of_its_heaviest_component_and_a_warm_one_all_over():
    weights = Categorical(probs=torch.tensor([0.7, 0.3]).expand(500, 2))
    places = Normal(torch.tensor([[-5.0], [5.0]]).expand(500, 2, 1), torch.ones(500, 2, 1))
    law = Mixture(weights, Joint(1, (Columns(torch.tensor([0]), places),)))
    with seeded(0, CPU):
        cold, as_it_is, warm = (law.tempered(temperature).sample() for temperature in (0.05, 1.0, 20.0))
    assert (cold + 5).abs().max() < 1
    assert 0.6 < (as_it_is < 0).double().mean() < 0.8
    assert warm.std() > as_it_is.std()


def test_a_law_whose_temperature_is_not_known_is_named():
    with pytest.raises(TypeError, match="no temperature is known for a Independent"):
        tempered(Independent(Normal(torch.zeros(2), torch.ones(2)), 1), 0.5)
