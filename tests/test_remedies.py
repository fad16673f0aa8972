"""What is charged for a z that remembers the world: how much, who learns from it, and that nothing else changes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.distributions import Normal

from toys import noise, two_styles, untrained
from tvae.cli import main
from tvae.config import RunConfig, TrainingConfig
from tvae.data.batches import TrajectoryBatch, batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import save_demonstrations
from tvae.device import seeded
from tvae.experiments import fitting
from tvae.experiments.fitting import penalties_of, schedule_of
from tvae.experiments.reproduction.cells import Cell, CellError, Effort
from tvae.experiments.run_directory import write_json
from tvae.generate.open_loop import imagine
from tvae.model.decoding import most_likely
from tvae.model.latent import GaussianMixture, StandardNormal
from tvae.model.tvae import TrajectoryVAE
from tvae.train.checkpoint import CheckpointError
from tvae.train.diagnosis import TrainingWarning
from tvae.train.independence import centred, kernel, start_nats
from tvae.train.loop import train
from tvae.train.observer import Observer
from tvae.train.penalties import Penalty, StartIndependence, SwappedStart, with_swapped_starts
from tvae.train.schedules import Budget, Constant, Piecewise
from tvae.train.terms import Terms

CPU = torch.device("cpu")
QUICK = {"num_steps": 12, "batch_size": 8, "evaluate_every": 4, "learning_rate": 5e-3}
BOTH = (StartIndependence(3.0), SwappedStart(0.5))
DEMONSTRATIONS = noise([5, 3, 6, 4, 2], [True, False, True, True, False])


def weights(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in model.state_dict().items()}


def same(left: dict[str, Tensor], right: dict[str, Tensor]) -> bool:
    return left.keys() == right.keys() and all(torch.equal(left[name], right[name]) for name in left)


def normal(*shape: int, seed: int) -> Tensor:
    with seeded(seed, CPU):
        return torch.randn(*shape, dtype=torch.float64)


def everyone(rows: Tensor) -> Tensor:
    return torch.zeros(len(rows), dtype=torch.int64)


def charged(
    penalty: Penalty, model: TrajectoryVAE, demonstrations: Demonstrations = DEMONSTRATIONS, seed: int = 0
) -> Tensor:
    batch = batch_of(demonstrations, np.arange(len(demonstrations)))
    with seeded(seed, CPU):
        posterior = model.posterior(batch)
        return penalty(model, batch, posterior, posterior.rsample())


# Independence of the start


def directly(z: np.ndarray, start: np.ndarray) -> float:
    """The unbiased criterion with loops and the sums of Song et al. (2012)."""
    matrices = []
    for rows in (z, start):
        squares = np.array([[float(((a - b) ** 2).sum()) for b in rows] for a in rows])
        pairs = sorted(squares[i, j] for i in range(len(rows)) for j in range(i))
        matrix = np.exp(-squares / (2 * pairs[(len(pairs) - 1) // 2]))
        np.fill_diagonal(matrix, 0)
        matrices.append(matrix)
    k, l = matrices  # noqa: E741
    n, ones = len(z), np.ones(len(z))
    both = (ones @ k @ ones) * (ones @ l @ ones) / ((n - 1) * (n - 2))
    return float((np.trace(k @ l) + both - 2 / (n - 2) * (ones @ k @ l @ ones)) / (n * (n - 3)))


def test_it_is_the_direct_formula_in_each_group_together():
    z, start = normal(23, 2, seed=0), normal(23, 3, seed=1)
    start[:, :2] += z
    group = torch.tensor([0] * 9 + [2] * 3 + [1] * 11)  # three rows say nothing
    parts = [slice(0, 9), slice(12, 23)]

    def total(left: Tensor, right: Tensor) -> float:
        return sum((part.stop - part.start) * directly(left[part].numpy(), right[part].numpy()) for part in parts)

    rho = total(z, start) / np.sqrt(total(z, z) * total(start, start))
    assert start_nats(z, start, group).item() == pytest.approx(-0.5 * np.log(1 - rho), rel=1e-9)
    order = torch.randperm(23, generator=torch.Generator().manual_seed(0))
    assert start_nats(z[order], start[order], group[order]).item() == pytest.approx(-0.5 * np.log(1 - rho), rel=1e-9)


def test_rows_and_columns_of_a_centred_kernel_add_up_to_nothing():
    found = centred(kernel(normal(12, 2, seed=0)))
    torch.testing.assert_close(found.sum(0), torch.zeros(12, dtype=torch.float64), atol=1e-12, rtol=0)
    torch.testing.assert_close(found, found.T)
    assert not found.diagonal().any()


def test_what_is_independent_costs_nothing_on_average_and_what_is_not_costs():
    independent, dependent = [], []
    for seed in range(300):
        z, other = normal(20, 2, seed=2 * seed), normal(20, 2, seed=2 * seed + 1)
        independent.append(start_nats(z, other, everyone(z)).item())
        dependent.append(start_nats(z, z + 0.5 * other, everyone(z)).item())
    assert abs(np.mean(independent)) < 3 * np.std(independent) / np.sqrt(300) + 0.005
    assert np.mean(dependent) > 0.4
    assert min(dependent) > np.mean(independent)


def test_a_style_may_depend_on_the_start_but_within_a_style_nothing_may():
    style = (torch.arange(400) % 2).to(torch.int64)
    z = 0.1 * normal(400, 2, seed=0) + 4 * style[:, None]
    start = normal(400, 2, seed=1) + 2 * style[:, None]  # who sees this start plays like that
    assert start_nats(z, start, style).item() == pytest.approx(0, abs=0.01)
    assert start_nats(z, start, everyone(z)).item() > 0.1
    leaking = z + 0.1 * (start - 2 * style[:, None])
    assert start_nats(leaking, start, style).item() > 0.1


def test_it_does_not_depend_on_the_units_of_z():
    z, start = normal(30, 2, seed=0), normal(30, 2, seed=1)
    start = start + z
    once = start_nats(z, start, everyone(z)).item()
    assert start_nats(1000 * z, start, everyone(z)).item() == pytest.approx(once, rel=1e-6)


def test_starts_that_tell_everything_cost_a_finite_number():
    z = normal(30, 2, seed=0).requires_grad_()
    found = start_nats(z, z.detach(), everyone(z))
    found.backward()
    assert found.item() == pytest.approx(-0.5 * np.log(0.001), rel=1e-2)
    assert z.grad is not None
    assert z.grad.isfinite().all()


@pytest.mark.parametrize(("count", "spread"), [(3, 1.0), (40, 0.0)], ids=["too few", "one start"])
def test_where_nothing_can_be_told_nothing_is_charged(count: int, spread: float):
    z = normal(count, 2, seed=0).float().requires_grad_()
    found = start_nats(z, 5 + spread * normal(count, 2, seed=1).float(), everyone(z))
    found.backward()
    assert found.item() == 0
    assert z.grad is not None
    assert not z.grad.any()


def test_gradient_descent_on_it_makes_z_independent():
    start = normal(60, 2, seed=0)
    z = (start + 0.3 * normal(60, 2, seed=1)).requires_grad_()
    before = start_nats(z, start, everyone(z)).item()
    optimizer = torch.optim.Adam([z], lr=0.05)
    for _ in range(100):
        optimizer.zero_grad()
        start_nats(z, start, everyone(z)).backward()
        optimizer.step()
    assert before > 0.5
    assert start_nats(z, start, everyone(z)).item() < 0.05


def test_the_component_of_a_z_is_its_most_likely_gaussian():
    with seeded(0, CPU):
        prior = GaussianMixture(2, 3)
    with torch.no_grad():
        prior.logits.copy_(torch.tensor([0.0, 2.0, -1.0]))
        prior.log_scales.copy_(torch.tensor([[0.0, -1.0], [0.5, 0.2], [-0.3, 0.0]]))
    z = 2 * normal(50, 2, seed=0).float()
    scores = torch.stack(
        [
            prior.logits[k] + Normal(prior.means[k], prior.log_scales[k].exp()).log_prob(z).sum(-1)
            for k in range(3)
        ],
        dim=-1,
    )
    assert torch.equal(prior.component(z), scores.argmax(-1))
    assert len(prior.component(z).unique()) == 3
    assert torch.equal(StandardNormal(2).component(z), everyone(z))


def test_start_independence_looks_at_the_first_states_within_components():
    demonstrations = noise([3] * 40)
    model = untrained(demonstrations, prior_components=3)
    batch = batch_of(demonstrations, np.arange(40))
    posterior = model.posterior(batch)
    z = 3 * normal(40, 2, seed=0).float()
    features = model.observation_normalizer.features(model.observation_normalizer.values(batch.observations[:, 0]))
    expected = start_nats(z, features, model.prior.component(z))
    found = StartIndependence(7.0)(model, batch, posterior, z)
    torch.testing.assert_close(found, (7 * expected).expand(40))
    assert not torch.isclose(expected, start_nats(z, features, everyone(z)))
    later = replace(batch, observations=batch.observations + torch.tensor([0.0, 1.0, 1.0])[:, None])
    assert torch.equal(StartIndependence(7.0)(model, later, posterior, z), found)


# Swapped starts


@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("window", [2, None])
def test_imagined_trajectories_begin_where_another_one_did(stop: bool, window: int | None):
    model = untrained(DEMONSTRATIONS, stop=stop, window=window, action_components=2, state_components=2)
    batch = batch_of(DEMONSTRATIONS, np.arange(5))
    z = normal(5, 2, seed=0).float()
    with seeded(1, CPU):
        found = with_swapped_starts(model, batch, z)
    starts = batch.observations[:, 0]
    shifts = [shift for shift in range(5) if torch.equal(found.observations[:, 0], starts.roll(shift, dims=0))]
    assert len(shifts) == 1
    assert shifts[0] != 0
    assert found.lengths.min() >= 1
    assert found.lengths.max() == found.actions.shape[1] <= 6
    assert stop or torch.equal(found.lengths, batch.lengths)
    assert torch.equal(found.next_known, found.mask)
    beyond = ~found.mask
    assert not any(rows[beyond].any() for rows in (found.observations, found.next_observations, found.actions))
    assert torch.equal(found.observations[:, 1:][found.mask[:, 1:]], found.next_observations[:, :-1][found.mask[:, 1:]])
    for space, rows in (
        (DEMONSTRATIONS.observation_space, found.next_observations[found.mask]),
        (DEMONSTRATIONS.action_space, found.actions[found.mask]),
    ):
        assert space.first_problem(rows.double().numpy()) is None
    with seeded(1, CPU):
        again = with_swapped_starts(model, batch, z)
    assert torch.equal(again.observations, found.observations)
    assert not found.observations.requires_grad


@pytest.mark.parametrize("window", [2, None])
def test_they_are_what_both_decoders_imagine(monkeypatch: pytest.MonkeyPatch, window: int | None):
    monkeypatch.setattr("tvae.train.penalties.sampled", most_likely)
    demonstrations = noise([6, 6])
    model = untrained(demonstrations, window=window, stop=False)
    batch = batch_of(demonstrations, np.arange(2))
    z = normal(2, 2, seed=0).float()
    found = with_swapped_starts(model, batch, z)
    starts = batch.observations[[1, 0], 0].double().numpy()
    expected = imagine(model, starts, z.double().numpy(), num_steps=6, choice=most_likely)
    for index, episode in enumerate(expected):
        np.testing.assert_allclose(found.observations[index], episode.observations[:-1], rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(found.next_observations[index], episode.observations[1:], rtol=1e-4, atol=1e-4)
        heading = demonstrations.action_space.angular
        turned = found.actions[index].double().numpy() - episode.actions
        turned[:, heading] = np.sin(turned[:, heading] / 2)
        np.testing.assert_allclose(turned, 0, atol=1e-4)


def test_what_is_told_again_costs_nothing_and_what_is_not_costs_the_divergence(monkeypatch: pytest.MonkeyPatch):
    model = untrained(DEMONSTRATIONS)
    monkeypatch.setattr("tvae.train.penalties.with_swapped_starts", lambda model, batch, z: batch)
    assert charged(SwappedStart(2.0), model).abs().max() < 1e-6
    with seeded(0, CPU):
        nn.init.normal_(model.encoder.parameters_of_law.weight)
    shuffled = batch_of(DEMONSTRATIONS, np.array([1, 2, 3, 4, 0]))
    monkeypatch.setattr("tvae.train.penalties.with_swapped_starts", lambda model, batch, z: shuffled)
    found = charged(SwappedStart(2.0), model)
    first = model.posterior(batch_of(DEMONSTRATIONS, np.arange(5)))
    second = model.posterior(shuffled)
    ratio = (first.stddev / second.stddev).square()
    away = ((first.mean - second.mean) / second.stddev).square()
    torch.testing.assert_close(found, (ratio + away - 1 - ratio.log()).sum(-1))  # twice the divergence
    assert found.min() > 0.01


def test_the_encoder_learns_to_tell_z_again():
    """Alone it makes what is told of a trajectory and of its z elsewhere agree."""
    demonstrations = two_styles(40)
    model = untrained(demonstrations)
    with seeded(0, CPU):
        nn.init.normal_(model.encoder.parameters_of_law.weight)
    before = charged(SwappedStart(1.0), model, demonstrations, seed=5).mean().item()
    optimizer = torch.optim.Adam(model.encoder.parameters(), lr=1e-2)
    for step in range(30):
        optimizer.zero_grad()
        charged(SwappedStart(1.0), model, demonstrations, seed=step).mean().backward()
        optimizer.step()
    assert charged(SwappedStart(1.0), model, demonstrations, seed=5).mean().item() < 0.3 * before


def test_imagined_states_far_off_count_as_ten_standard_deviations_off():
    demonstrations = noise([30, 30, 30])
    model = untrained(demonstrations, stop=False)
    with torch.no_grad():
        model.state_decoder.head.parameters_of_law.bias.fill_(50.0)
    batch = batch_of(demonstrations, np.arange(3))
    found = with_swapped_starts(model, batch, torch.zeros(3, 2))
    continuous = demonstrations.observation_space.continuous
    values = model.observation_normalizer.values(found.observations)[..., continuous]
    assert values.max().item() == pytest.approx(10, rel=1e-4)
    assert model.posterior(found).mean.isfinite().all()


# Both


@pytest.mark.parametrize("penalty", BOTH, ids=["independence", "swapped"])
def test_a_penalty_teaches_the_encoder_alone(penalty: Penalty):
    demonstrations = noise([5] * 12)
    model = untrained(demonstrations, prior_components=2, stop=True).train()
    assert isinstance(penalty, Penalty)
    found = charged(penalty, model, demonstrations)
    assert found.shape == (12,)
    found.mean().backward()
    touched = {name for name, parameter in model.named_parameters() if parameter.grad is not None}
    assert touched == {name for name, _ in model.named_parameters() if name.startswith("encoder.")}
    assert all(parameter.grad.isfinite().all() and parameter.grad.any() for parameter in model.encoder.parameters())


@pytest.mark.parametrize("penalty", BOTH, ids=["independence", "swapped"])
def test_the_weight_multiplies(penalty: StartIndependence | SwappedStart):
    demonstrations = noise([5] * 12)
    model = untrained(demonstrations)
    once, twice = (charged(replace(penalty, weight=weight), model, demonstrations) for weight in (1.0, 2.0))
    torch.testing.assert_close(twice, 2 * once)
    assert once.any()


@pytest.mark.parametrize("penalty", BOTH, ids=["independence", "swapped"])
def test_one_trajectory_or_no_latent_is_charged_nothing(penalty: Penalty):
    assert charged(penalty, untrained(DEMONSTRATIONS), DEMONSTRATIONS[:1]).tolist() == [0.0]
    assert charged(penalty, untrained(DEMONSTRATIONS, latent_features=0)).tolist() == [0.0] * 5


@pytest.mark.parametrize("kind", [StartIndependence, SwappedStart])
@pytest.mark.parametrize("weight", [-0.1, float("nan"), float("inf")])
def test_impossible_weights_are_refused(kind: type[StartIndependence | SwappedStart], weight: float):
    with pytest.raises(ValueError, match=f"{kind.__name__} needs a weight of at least 0, got {weight}"):
        kind(weight)


# In training


def trained(
    walks: tuple[Demonstrations, Demonstrations], penalties: Sequence[Penalty] = (), **arguments
) -> TrajectoryVAE:
    model = untrained(walks[0], dropout=0.1, window=4, stop=True, prior_components=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TrainingWarning)
        train(model, *walks, **{"schedule": Constant(), **QUICK, **arguments}, penalties=penalties)
    return model


@pytest.fixture(scope="module")
def walks() -> tuple[Demonstrations, Demonstrations]:
    return two_styles(60).split(0.1, seed=0)


@dataclass(frozen=True)
class Nothing:
    """Charges nothing, and draws."""

    def __call__(self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Tensor) -> Tensor:
        return 0 * torch.rand(len(batch))


def test_what_a_penalty_draws_changes_nothing_else(walks: tuple[Demonstrations, Demonstrations]):
    assert same(weights(trained(walks)), weights(trained(walks, (Nothing(),))))
    assert not same(weights(trained(walks)), weights(trained(walks, BOTH)))


def test_penalties_are_given_what_the_bound_was_estimated_at(walks: tuple[Demonstrations, Demonstrations]):
    seen: list[float] = []

    @dataclass(frozen=True)
    class Look:
        def __call__(self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Tensor) -> Tensor:
            seen.append(model.prior.kl(posterior, z).mean().item())
            return torch.zeros(len(batch))

    told: list[float] = []
    trained(walks, (Look(),), observer=Observer(on_step=lambda step, terms: told.append(terms.kl)))
    assert seen == told
    assert len(seen) == 12


def test_a_charge_for_information_leaves_less_of_it(walks: tuple[Demonstrations, Demonstrations]):
    """A penalty is taken off the bound as it is: the divergence, ten times over, does what beta = 11 does."""

    @dataclass(frozen=True)
    class Information:
        def __call__(self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Tensor) -> Tensor:
            return 10 * model.prior.kl(posterior, z)

    charged_for, dear = trained(walks, (Information(),)), trained(walks, schedule=Constant(11.0))
    for name, tensor in charged_for.state_dict().items():
        torch.testing.assert_close(tensor, dear.state_dict()[name], rtol=1e-3, atol=1e-4)


class KilledError(Exception):
    """The power went out."""


def test_a_killed_training_with_penalties_ends_in_the_same_weights(
    walks: tuple[Demonstrations, Demonstrations], tmp_path: Path
):
    straight = weights(trained(walks, BOTH, seed=3))
    for kill in (3, 6, 11):

        def die(step: int, terms: Terms, kill: int = kill) -> None:
            if step == kill:
                raise KilledError

        torch.manual_seed(kill)
        with pytest.raises(KilledError):
            trained(walks, BOTH, seed=3, checkpoint=tmp_path / "c", observer=Observer(on_step=die))
    assert same(weights(trained(walks, BOTH, seed=3, checkpoint=tmp_path / "c")), straight)


def test_a_checkpoint_of_other_penalties_is_refused(walks: tuple[Demonstrations, Demonstrations], tmp_path: Path):
    for name, first in (("with", BOTH), ("without", ())):
        trained(walks, first, checkpoint=tmp_path / name)
    with pytest.raises(CheckpointError, match=r"penalties \(StartIndependence\(weight=3.0\), .* \(now None\)"):
        trained(walks, checkpoint=tmp_path / "with")
    with pytest.raises(CheckpointError, match=r"penalties None \(now \(SwappedStart\(weight=0.5\),\)\)"):
        trained(walks, BOTH[1:], checkpoint=tmp_path / "without")


# By configuration


def test_a_configuration_says_which_remedies_there_are():
    assert penalties_of(TrainingConfig()) == ()
    assert penalties_of(TrainingConfig(start_independence=3.0, swapped_start=0.5)) == BOTH
    assert schedule_of(TrainingConfig()) == Piecewise(TrainingConfig().kl_points)
    assert schedule_of(TrainingConfig(kl_budget=0.7)) == Budget(0.7)
    chosen = RunConfig(training=TrainingConfig(start_independence=3.0, swapped_start=0.5, kl_budget=0.7))
    assert RunConfig.from_json(chosen.to_json()) == chosen


@pytest.mark.parametrize("name", ["start_independence", "swapped_start"])
@pytest.mark.parametrize("weight", [-1.0, float("nan")])
def test_impossible_remedies_of_a_configuration_are_refused(name: str, weight: float):
    with pytest.raises(ValueError, match=f"needs a weight of at least 0, got {weight}"):
        penalties_of(TrainingConfig(**{name: weight}))


@pytest.mark.parametrize("nats", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_budgets_are_refused(nats: float):
    with pytest.raises(ValueError, match=f"a budget needs more than 0 nats, got {nats}"):
        schedule_of(TrainingConfig(kl_budget=nats))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--training.start-independence", "StartIndependence needs a weight of at least 0, got -1.0"),
        ("--training.swapped-start", "SwappedStart needs a weight of at least 0, got -1.0"),
        ("--training.kl-budget", "a budget needs more than 0 nats, got -1.0"),
    ],
)
def test_the_command_line_refuses_them_before_anything_is_made(
    option: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    save_demonstrations(two_styles(10), tmp_path / "walks.csv")
    with pytest.raises(SystemExit) as status:
        main(["fit", str(tmp_path / "walks.csv"), "--out", str(tmp_path / "run"), f"{option}=-1"])
    assert status.value.code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_run_is_trained_with_the_remedies_of_its_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    told: dict[str, object] = {}
    monkeypatch.setattr(fitting, "train", lambda *arguments, **keywords: told.update(keywords) or ())
    config = RunConfig(training=TrainingConfig(start_independence=3.0, swapped_start=0.5, kl_budget=0.7))
    fitting.trained(two_styles(10), config, checkpoint=tmp_path / "c", device="cpu", observer=Observer())
    assert (told["penalties"], told["schedule"]) == (BOTH, Budget(0.7))


def test_a_cell_that_was_measured_before_a_setting_was_there_is_still_that_cell(tmp_path: Path):
    cell = Cell("zombie", "one_law", 0, tmp_path, Effort())
    asked = cell.asked
    for name in ("kl_budget", "start_independence", "swapped_start"):
        del asked["training"][name]
    write_json(tmp_path / "cell.json", asked)
    write_json(cell.metrics, {})
    assert cell.is_measured()
    write_json(tmp_path / "cell.json", {**asked, "training": {**asked["training"], "clip": 2.0}})
    with pytest.raises(CellError, match="whose training differs"):
        cell.is_measured()
    write_json(tmp_path / "cell.json", {**asked, "training": {**asked["training"], "unheard": 2.0}})
    with pytest.raises(CellError, match="whose training differs"):
        cell.is_measured()
