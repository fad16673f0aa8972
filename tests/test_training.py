"""Training learns, resumes exactly, stops, and says in words what is wrong."""

from __future__ import annotations

import inspect
import json
import warnings
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from toys import noise, two_styles, untrained
from tvae.config import RunConfig
from tvae.data.batches import TrajectoryBatch, batch_of, suitable_batch_size
from tvae.data.demonstrations import Demonstrations
from tvae.envs.zombie import zombie_demonstrations
from tvae.experiments.progress import together, watching
from tvae.fitting.amounts import Amounts
from tvae.fitting.fit import fit, new_model
from tvae.model.elbo import Elbo, elbo
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import Windows, cut, whole
from tvae.spaces import Continuous, Space
from tvae.train.checkpoint import CheckpointError, Progress, Record
from tvae.train.diagnosis import TrainingWarning, diagnose, ending
from tvae.train.loop import TrainingError, evaluate, train
from tvae.train.observer import Observer
from tvae.train.schedules import RAISED, Budget, Constant, KLSchedule, Piecewise
from tvae.train.terms import Terms

QUICK = {"num_steps": 60, "batch_size": 8, "evaluate_every": 10, "learning_rate": 5e-3}

RAISED_LATE = Piecewise(((0.0, 1.0), (0.4, 1.0), (0.5, 10.0)))


class KilledError(Exception):
    """The power went out."""


@pytest.fixture(scope="module")
def walks() -> tuple[Demonstrations, Demonstrations]:
    return two_styles(200).split(0.1, seed=0)


def trained(
    model: TrajectoryVAE, walks: tuple[Demonstrations, Demonstrations], **arguments
) -> tuple[TrajectoryVAE, tuple[Record, ...]]:
    """The model after a short training whose warnings are not of interest, and its evaluations."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TrainingWarning)
        records = train(model, *walks, **{"schedule": Constant(), **QUICK, **arguments})
    return model, records


def weights(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in model.state_dict().items()}


def same(left: dict[str, Tensor], right: dict[str, Tensor]) -> bool:
    return left.keys() == right.keys() and all(torch.equal(left[name], right[name]) for name in left)


# Settings


def test_fit_and_the_configuration_have_the_same_defaults() -> None:
    asked = {name: p.default for name, p in inspect.signature(fit).parameters.items()}
    config = RunConfig().to_json()
    shared = {**config["model"], **config["training"]}
    assert asked["policy_steps"] == config["policy"]["num_steps"]
    assert asked["schedule"] == RAISED == Piecewise(shared.pop("kl_points"))
    assert {name: asked[name] for name in shared if name in asked} == {n: v for n, v in shared.items() if n in asked}
    assert len(shared.keys() & asked.keys()) >= 20


def test_a_batch_of_no_given_size_is_one_of_the_suitable_size(walks: tuple[Demonstrations, Demonstrations]) -> None:
    size = suitable_batch_size(walks[0].lengths)
    assert size == 64
    found = [
        weights(trained(untrained(walks[0]), walks, num_steps=3, batch_size=asked)[0]) for asked in (None, size, 8)
    ]
    assert same(found[0], found[1])
    assert not same(found[0], found[2])


@pytest.mark.parametrize(
    ("num_episodes", "length", "amounts"),
    [
        (3, 10, Amounts(64, 2_200, 2_200)),
        (1_350, 100, Amounts(32, 2_531, 2_500)),
        (100_000, 50, Amounts(64, 6_000, 2_500)),
        (120, 20_000, Amounts(3, 2_400, 2_400)),
    ],
)
def test_more_demonstrations_are_trained_on_for_longer(num_episodes: int, length: int, amounts: Amounts) -> None:
    """60 passes over them, within bounds; as many steps of the policy alone, within a bound."""
    lengths = np.full(num_episodes, length)
    assert Amounts.of(lengths, batch_size=None, num_steps=None, policy_steps=None) == amounts
    asked = {"batch_size": 5, "num_steps": 7, "policy_steps": 0}
    assert vars(Amounts.of(lengths, **asked)) == asked


def test_fit_trains_for_as_long_as_its_training_demonstrations_suggest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tvae.fitting.amounts._FEWEST_STEPS", 1)
    monkeypatch.setattr("tvae.fitting.amounts._PASSES", 3)
    taken: dict[str, int] = {}
    observer = Observer(
        on_step=lambda step, terms: taken.update(bound=step), on_policy_step=lambda step, nats: taken.update(alone=step)
    )
    fit(two_styles(60), batch_size=9, held_out=0.1, hidden_features=4, device="cpu", observer=observer)
    assert taken == {"bound": 18, "alone": 18}  # 3 passes over 54 of 60, 9 at a time
    with pytest.raises(ValueError, match="batch_size must be at least 1, got 0"):
        fit(two_styles(60), batch_size=0, device="cpu")


def test_a_batch_with_very_long_trajectories_is_gone_through_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    demonstrations = noise([9, 2, 30, 3, 2, 4, 8, 3], [True, False] * 4)
    parts = demonstrations[:6], demonstrations[6:]
    sizes: list[tuple[int, ...]] = []

    def spy(model: TrajectoryVAE, batch: TrajectoryBatch, *, policy: Windows, state: Windows) -> Elbo:
        if model.training:
            sizes.append(tuple(batch.actions.shape[:2]))
        return elbo(model, batch, policy=policy, state=state)

    monkeypatch.setattr("tvae.train.loop.elbo", spy)
    whole_batches = trained(untrained(parts[0], latent_features=0, window=None), parts, num_steps=3)[1]
    assert set(sizes) == {(6, 30)}
    sizes.clear()
    monkeypatch.setattr("tvae.data.batches._MOST_PADDED_STEPS", 15)
    in_parts = trained(untrained(parts[0], latent_features=0, window=None), parts, num_steps=3)[1]
    assert sizes == [(3, 3), (1, 4), (1, 9), (1, 30)] * 3
    for one, other in zip(whole_batches, in_parts, strict=True):
        assert one.held_out.value(1.0) == pytest.approx(other.held_out.value(1.0), rel=1e-4)
        assert one.training.value(1.0) == pytest.approx(other.training.value(1.0), rel=1e-4)


def test_once_the_window_is_chosen_the_policy_is_trained_on_cut_windows_of_it(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch
) -> None:
    widths: list[tuple[int, int]] = []

    def spy(model: TrajectoryVAE, batch: TrajectoryBatch, *, policy: Windows, state: Windows) -> Elbo:
        if model.training:
            widths.append((policy.steps.shape[1], int(policy.valid.sum() - batch.lengths.sum())))
        return elbo(model, batch, policy=policy, state=state)

    monkeypatch.setattr("tvae.train.loop.elbo", spy)
    monkeypatch.setattr("tvae.train.loop.shortest_sufficient_window", lambda *args, **options: 2)
    trained(untrained(walks[0], window=4), walks, num_steps=40)
    assert {width for width, _ in widths[:20]} == {1, 2, 4}
    assert {width for width, _ in widths[30:]} == {2}
    assert {twice for _, twice in widths} == {0}  # every step counts once


# Learning


def test_fit_finds_the_two_styles(walks: tuple[Demonstrations, Demonstrations]):
    """The bound rises, z tells the sides apart, and nothing is warned of (warnings are errors)."""
    records: list[Record] = []
    model = fit(
        two_styles(200),
        hidden_features=16,
        num_steps=150,
        batch_size=32,
        learning_rate=1e-2,
        evaluate_every=50,
        device="cpu",
        observer=Observer(on_record=records.append),
    )
    assert not model.training
    assert [record.step for record in records] == [0, 50, 100, 150]
    assert records[-1].held_out.value(1.0) > records[0].held_out.value(1.0) + 30
    assert records[-1].training.value(1.0) > records[1].training.value(1.0)
    held_out = walks[1]
    with torch.no_grad():
        means = model.posterior(batch_of(held_out, np.arange(len(held_out)))).mean.numpy()
    right = held_out.attribute("label") == "right"
    axis = means[right].mean(0) - means[~right].mean(0)
    assert (means[right] @ axis).min() > (means[~right] @ axis).max()


CONFIGURATIONS = {
    "paper": {"latent_features": 2},
    "no latent": {"latent_features": 0},
    "stop": {"stop": True},
    "no stop": {"stop": False},
    "mixtures": {"action_components": 3, "state_components": 2, "prior_components": 4},
    "windows": {"window": 2, "dropout": 0.1},
    "no actions in the encoder": {"encode_actions": False},
    "dynamics": {"dynamics": True, "window": 2},
}


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_every_parameter_gets_a_gradient(name: str):
    demonstrations = noise([5, 3, 6, 4])
    model = untrained(demonstrations, **CONFIGURATIONS[name]).train()
    batch = batch_of(demonstrations, np.arange(4))
    windows = whole(batch) if model.window is None else cut(batch.lengths, model.window, 1)
    (-elbo(model, batch, policy=windows, state=windows).value().mean()).backward()
    gradients = {name: parameter.grad for name, parameter in model.named_parameters()}
    assert all(gradient is not None and gradient.isfinite().all() for gradient in gradients.values())
    assert [name for name, gradient in gradients.items() if not gradient.any()] == []


def test_evaluation_depends_on_the_seed_and_leaves_all_as_it_was():
    demonstrations = noise([5, 3, 6, 4, 1])
    model = untrained(demonstrations, dropout=0.5, window=3).train()
    torch.manual_seed(8)
    expected = torch.rand(3)
    torch.manual_seed(8)
    first = evaluate(model, demonstrations, batch_size=2, seed=4)
    assert model.training
    assert torch.equal(torch.rand(3), expected)
    assert evaluate(model, demonstrations, batch_size=2, seed=4) == first
    assert evaluate(model, demonstrations, batch_size=2, seed=5) != first


def test_evaluation_is_the_mean_over_trajectories():
    """Batches of different sizes count by their trajectories; without latent nothing is random."""
    demonstrations = noise([5, 3, 6, 4, 1])
    model = untrained(demonstrations, latent_features=0, stop=True)
    together = evaluate(model, demonstrations, batch_size=5)
    apart = evaluate(model, demonstrations, batch_size=2)
    for name in ("policy", "state", "stop", "kl"):
        assert getattr(together, name) == pytest.approx(getattr(apart, name), rel=1e-5)


@pytest.mark.parametrize("clip", [1e-3, 0.1, 1e6])
def test_each_part_is_clipped_on_its_own(walks: tuple[Demonstrations, Demonstrations], clip: float):
    model = untrained(walks[0], prior_components=2)
    parts = ("encoder", "prior", "state_decoder", "policy_decoder")
    norms: list[list[float]] = []

    def look(step: int, terms: Terms) -> None:
        gradients = ([p.grad.flatten() for p in getattr(model, part).parameters()] for part in parts)
        norms.append([float(torch.cat(gradient).norm()) for gradient in gradients])

    trained(model, walks, clip=clip, num_steps=3, observer=Observer(on_step=look))
    assert len(norms) == 3
    for norm in np.ravel(norms):
        assert norm == pytest.approx(clip, rel=1e-2) if clip == 1e-3 else 0 < norm <= clip * 1.001


def test_learning_rate_falls_along_half_a_cosine(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch
):
    rates: list[float] = []
    step = torch.optim.Adam.step

    def look(self: torch.optim.Adam) -> None:
        rates.append(self.param_groups[0]["lr"])
        step(self)

    monkeypatch.setattr(torch.optim.Adam, "step", look)
    trained(untrained(walks[0]), walks, num_steps=20, learning_rate=0.01)
    assert rates == pytest.approx([0.005 * (1 + np.cos(np.pi * step / 20)) for step in range(20)])


def test_observer_is_told_of_each_step_and_evaluation(walks: tuple[Demonstrations, Demonstrations]):
    steps, told = [], []
    observer = Observer(lambda step, terms: steps.append(step), told.append)
    _, records = trained(untrained(walks[0]), walks, num_steps=25, observer=observer)
    assert steps == list(range(1, 26))
    assert [record.step for record in records] == [0, 10, 20, 25]
    assert tuple(told) == records


# The schedule of the KL term


def test_constant_and_piecewise_weights():
    assert [Constant(3.0).weight(p, kl=1.0, previous=7.0) for p in (0.0, 1.0)] == [3, 3]
    assert [RAISED_LATE.weight(p, kl=1.0, previous=7.0) for p in (0.0, 0.4, 0.45, 0.5, 1.0)] == pytest.approx(
        [1, 1, 5.5, 10, 10]
    )
    late = Piecewise(((0.5, 2.0), (0.75, 4.0)))
    assert [late.weight(p, kl=0.0, previous=0.0) for p in (0.0, 0.5, 0.625, 0.9)] == [2, 2, 3, 4]
    assert (Constant().settled, RAISED_LATE.settled, late.settled) == (0, 0.5, 0.75)


@pytest.mark.parametrize("points", [(), ((0.5, 1.0), (0.5, 2.0)), ((0.5, 1.0), (0.1, 2.0))])
def test_points_out_of_order_are_refused(points: tuple):
    with pytest.raises(ValueError, match="points need rising progress"):
        Piecewise(points)


def test_budget_pushes_the_divergence_to_its_nats():
    budget = Budget(nats=2.0, begin=0.3, rate=0.1)
    assert budget.weight(0.1, kl=50.0, previous=9.0) == 1
    assert budget.weight(0.5, kl=50.0, previous=1.0) == pytest.approx(np.exp(0.1))
    assert budget.weight(0.5, kl=2.0, previous=3.0) == pytest.approx(3)
    assert budget.weight(0.5, kl=0.0, previous=1.0) == pytest.approx(np.exp(-0.1))
    assert budget.weight(0.5, kl=50.0, previous=99.9) == 100
    assert budget.weight(0.5, kl=0.0, previous=0.101) == 0.1
    beta, kl = 1.0, 8.0
    for _ in range(500):  # a divergence that answers to the weight
        beta, kl = budget.weight(0.5, kl, beta), 8 / (1 + beta)
    assert kl == pytest.approx(2, rel=1e-2)
    with pytest.raises(ValueError, match="more than 0 nats, got 0"):
        Budget(nats=0)


@pytest.mark.parametrize("schedule", [Piecewise(((0.0, 1.0), (0.5, 5.0))), Budget(nats=0.5, begin=0.2, rate=0.05)])
def test_training_follows_the_schedule(walks: tuple[Demonstrations, Demonstrations], schedule: KLSchedule):
    divergences: list[float] = []
    observer = Observer(on_step=lambda step, terms: divergences.append(terms.kl))
    _, records = trained(untrained(walks[0]), walks, schedule=schedule, observer=observer)
    beta, kl, expected = records[0].beta, records[0].held_out.kl, []
    for step, latest in enumerate(divergences):
        beta = schedule.weight(step / 60, kl, beta)
        kl = latest
        expected.append(beta)
    assert [record.beta for record in records[1:]] == pytest.approx([expected[i - 1] for i in range(10, 61, 10)])


# The weight of the state term


@pytest.mark.parametrize("stop", [False, True])
def test_without_weight_the_state_decoder_stays_as_it_was(
    walks: tuple[Demonstrations, Demonstrations], stop: bool
):
    """Everything else learns, and with a stop term also the trunk that it reads."""
    model = untrained(walks[0], stop=stop)
    before = weights(model)
    trained(model, walks, num_steps=10, state_weight=0)
    changed = {name for name, tensor in weights(model).items() if not torch.equal(tensor, before[name])}
    still = "state_decoder.head." if stop else "state_decoder."
    learned = {name for name, _ in model.named_parameters()}
    assert changed == {name for name in learned if not name.startswith(still)}


def test_the_state_term_counts_by_its_weight(walks: tuple[Demonstrations, Demonstrations]):
    """Ten times the weight gives the state decoder ten times the gradient, and the policy's the same."""
    gradients: list[list[Tensor]] = []
    for weight in (0.1, 1.0):
        model = untrained(walks[0], stop=False)

        def look(step: int, terms: Terms, model: TrajectoryVAE = model) -> None:
            parts = (model.state_decoder, model.policy_decoder)
            gradients.append([torch.cat([p.grad.flatten() for p in part.parameters()]) for part in parts])

        trained(model, walks, num_steps=1, clip=1e6, state_weight=weight, observer=Observer(on_step=look))
    (state, policy), (more, same_policy) = gradients
    torch.testing.assert_close(10 * state, more, rtol=1e-3, atol=1e-6)
    torch.testing.assert_close(policy, same_policy)
    assert more.norm() > 0.1


@pytest.mark.parametrize(("weight", "best"), [(1.0, 10), (0.5, 60), (0.0, 60)])
def test_the_best_weights_are_those_of_the_weighted_bound(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch, weight: float, best: int
):
    """As made up, the policy term gains one nat while the state term loses 1.5."""
    scores = iter([Terms(-9.0, -9.0, 0.0, 1.0), *(Terms(float(i), -1.5 * i, 0.0, 1.0) for i in range(6))])
    seen: dict[int, dict[str, Tensor]] = {}
    model = untrained(walks[0])
    monkeypatch.setattr("tvae.train.loop.evaluate", lambda *arguments, **keywords: next(scores))
    observer = Observer(on_record=lambda record: seen.update({record.step: weights(model)}))
    trained(model, walks, state_weight=weight, observer=observer)
    assert same(weights(model), seen[best])


def test_a_state_term_without_weight_is_not_learnt_and_not_missed(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch
):
    """No warning that nothing was learnt while the policy's term rises."""
    scores = iter([Terms(-9.0, -9.0, 0.0, 1.0), *(Terms(float(i), -900.0, 0.0, 1.0) for i in range(6))])
    monkeypatch.setattr("tvae.train.loop.evaluate", lambda *arguments, **keywords: next(scores))
    records = train(untrained(walks[0]), *walks, schedule=Constant(), **QUICK, state_weight=0.0)
    assert len(records) == 7


# Stopping and keeping the best


def test_training_ends_when_patience_does(walks: tuple[Demonstrations, Demonstrations]):
    """Weights that do not move never improve."""
    model = untrained(walks[0])
    before = weights(model)
    with pytest.warns(TrainingWarning, match="nothing was learnt"):
        records = train(model, *walks, schedule=Constant(), **{**QUICK, "learning_rate": 0.0}, patience=3)
    assert [record.step for record in records] == [0, 10, 20, 30]
    assert same(weights(model), before)


def test_patience_begins_when_the_schedule_has_settled(walks: tuple[Demonstrations, Demonstrations]):
    schedule = Piecewise(((0.0, 1.0), (0.5, 1.0)))
    _, records = trained(untrained(walks[0]), walks, schedule=schedule, learning_rate=0.0, patience=2)
    assert [record.step for record in records] == [0, 10, 20, 30, 40, 50]


def test_the_best_weights_are_kept(walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch):
    """Scores are made up: the best is that of step 30, though an earlier one, before beta settled, was higher."""
    scores = iter([-9.0, 50.0, 2.0, 5.0, 4.0, 4.5, 4.9])
    seen: dict[int, dict[str, Tensor]] = {}
    model = untrained(walks[0])

    def made_up(model: TrajectoryVAE, *arguments, **keywords) -> Terms:
        return Terms(policy=next(scores), state=0.0, stop=0.0, kl=1.0)

    monkeypatch.setattr("tvae.train.loop.evaluate", made_up)
    observer = Observer(on_record=lambda record: seen.update({record.step: weights(model)}))
    records = train(
        model, *walks, schedule=Piecewise(((0.0, 1.0), (0.3, 1.0))), **QUICK, patience=10, observer=observer
    )
    assert len(records) == 7
    assert same(weights(model), seen[30])
    assert not same(seen[30], seen[40])


def test_evaluations_are_compared_under_the_same_weight_of_the_divergence(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch
):
    """As beta rises every bound falls; that alone does not make the later weights worse."""
    scores = iter([Terms(-9, 0, 0, 0), *(Terms(10 + i, 0, 0, 5 - 0.5 * i) for i in range(6))])
    seen: dict[int, dict[str, Tensor]] = {}
    model = untrained(walks[0])
    monkeypatch.setattr("tvae.train.loop.evaluate", lambda *arguments, **keywords: next(scores))
    observer = Observer(on_record=lambda record: seen.update({record.step: weights(model)}))
    rising = Budget(nats=0.01, begin=0.0, rate=0.1)
    records = train(model, *walks, schedule=replace(rising, begin=-0.4), **QUICK, observer=observer, patience=2)
    assert records[-1].held_out.value(records[-1].beta) < records[1].held_out.value(records[1].beta)
    assert same(weights(model), seen[60])


# Warnings


def test_a_collapsed_latent_is_warned_of(walks: tuple[Demonstrations, Demonstrations]):
    with pytest.warns(TrainingWarning, match=r"the latent has collapsed: it holds 0\.0\d\d nats") as caught:
        train(untrained(walks[0]), *walks, schedule=Constant(1e3), **QUICK)
    assert len(caught) == 1


def test_without_latent_nothing_collapses(walks: tuple[Demonstrations, Demonstrations]):
    records = train(untrained(walks[0], latent_features=0), *walks, schedule=Constant(), **QUICK)
    assert records[-1].held_out.kl == 0


def test_warnings_are_about_the_weights_that_are_kept(
    walks: tuple[Demonstrations, Demonstrations], monkeypatch: pytest.MonkeyPatch
):
    """Late over-fitting after the best evaluation is what the best weights are kept for: no warning."""
    good, bad = Terms(5.0, 0.0, 0.0, 2.0), Terms(-50.0, 0.0, 0.0, 0.0)
    scores = iter([Terms(0.0, 0.0, 0.0, 0.5), good, good, good, good, bad, bad])
    monkeypatch.setattr("tvae.train.loop.evaluate", lambda *arguments, **keywords: next(scores))
    records = train(untrained(walks[0]), *walks, schedule=Constant(), **QUICK, patience=5)
    assert records[-1].held_out == bad


def judged(held_out: list[float], training: list[float], *, best: int) -> Progress:
    """The progress of a training with these bounds, an evaluation every 100 steps, as if it ended at the last."""
    records = tuple(
        Record(100 * index, 1.0, Terms(there, 0.0, 0.0, 0.0), Terms(here, 0.0, 0.0, 0.0))
        for index, (here, there) in enumerate(zip(held_out, training, strict=True))
    )
    return Progress(records[-1].step, 1.0, 0.0, 100 * best, len(records) - 1 - best, True, records)


RISING = [0.0, *np.linspace(50, 90, 12).tolist()]
FALLING = [0.0, 50.0, 60.0, *np.linspace(58, 20, 10).tolist()]


def diagnosed(progress: Progress, choosable: float) -> list[str]:
    model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)), latent_features=0, hidden_features=4)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        diagnose(model, progress, 1.0, choosable)
    return [str(warning.message) for warning in caught]


def test_overfitting_before_weights_may_be_kept_is_warned_of() -> None:
    (said,) = diagnosed(judged(FALLING, RISING, best=8), choosable=720.0)
    assert "best at step 200 (60.0 nats), and 36.9 at step 800, kept, and fell to 20.0 at step 1200" in said
    assert "fewer features" in said


def test_overfitting_from_the_first_weights_that_may_be_kept_is_warned_of() -> None:
    late = [0.0, *np.linspace(40, 60, 7).tolist(), *np.linspace(58, 40, 5).tolist()]
    (said,) = diagnosed(judged(late, RISING, best=7), choosable=700.0)
    assert "best at step 700 (60.0 nats), whose weights are kept, and fell to 40.0 at step 1200" in said
    assert diagnosed(judged(late, RISING, best=7), choosable=300.0) == []


def test_overfitting_that_undoes_all_is_not_called_learning_nothing() -> None:
    (said,) = diagnosed(judged([0.0, 50.0, 60.0, *np.linspace(50, -90, 10)], RISING, best=8), choosable=720.0)
    assert said.startswith("the model overfits")


@pytest.mark.parametrize(
    ("held_out", "training"),
    [
        pytest.param(RISING, RISING, id="still rising"),
        pytest.param(FALLING, [0.0, *np.linspace(90, 50, 12)], id="both fall"),
        pytest.param([0.0, 50.0, 60.0, *[59.9, 59.8] * 5], RISING, id="flat"),
        pytest.param([0.0, 50.0, 60.0, *[30.0, 58.0] * 4, 30.0, 40.0], RISING, id="noise"),
        pytest.param([0.0, 50.0, 60.0, 40.0, 30.0], RISING[:5], id="too short to tell"),
    ],
)
def test_no_overfitting(held_out: list[float], training: list[float]) -> None:
    progress = judged(held_out, training, best=int(np.argmax(held_out)))
    assert diagnosed(progress, choosable=0.0) == []


def test_a_model_that_overfits_is_warned_of() -> None:
    """Nine episodes, which nets learn by heart: held-out ones are then a surprise."""
    few = zombie_demonstrations(12, seed=1)
    parts = few.split(0.25, seed=0)
    model = new_model(few, seed=0, device="cpu")
    ends: list[Progress] = []
    with pytest.warns(TrainingWarning, match="the model overfits"):
        train(
            model,
            *parts,
            schedule=Constant(),
            num_steps=400,
            evaluate_every=10,
            learning_rate=1e-2,
            observer=Observer(on_end=ends.append),
        )
    (progress,) = ends
    assert progress.finished
    assert progress.step == progress.best_step + 100 < 400


def test_where_training_ended() -> None:
    """One line where it ended early or the last weights are not the best, and none else."""
    progress = judged(FALLING, RISING, best=8)
    assert ending(progress, 2000).startswith("training ended early, at step 1200 of 2000: ")
    assert ending(progress, 1200) == "the held-out bound was best at step 800, whose weights are kept"
    assert ending(judged(RISING, RISING, best=12), 1200) == ""


def test_who_watches_is_told_where_training_ended(tmp_path: Path) -> None:
    with StringIO() as screen:
        with watching(Amounts(64, 2_200, 2_200), tmp_path, Console(file=screen, width=200)) as shown:
            together([shown]).on_end(judged(FALLING, RISING, best=8))
        assert "at step 1200 of 2200: the held-out bound was best at step 800" in screen.getvalue()


# Resuming


def resumable(walks: tuple[Demonstrations, Demonstrations]) -> TrajectoryVAE:
    return untrained(walks[0], dropout=0.1, window=4, stop=True, prior_components=2)


SCHEDULES = {"piecewise": RAISED_LATE, "budget": Budget(nats=0.5, begin=0.1, rate=0.05)}


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_a_killed_training_ends_in_the_same_weights(
    walks: tuple[Demonstrations, Demonstrations], tmp_path: Path, schedule: str
):
    arguments = {"schedule": SCHEDULES[schedule], "seed": 3}
    straight, records = trained(resumable(walks), walks, **arguments)
    random = np.random.default_rng(0)
    checkpoint, kills = tmp_path / "checkpoint.safetensors", [4, 10, *random.integers(11, 60, 4)]
    for kill in kills:

        def die(step: int, terms: Terms, kill: int = int(kill)) -> None:
            if step == kill:
                raise KilledError

        torch.manual_seed(int(random.integers(1_000)))  # what others draw does not matter
        model = resumable(walks)
        try:
            trained(model, walks, checkpoint=checkpoint, observer=Observer(on_step=die), **arguments)
        except KilledError:
            continue
    again, resumed = trained(resumable(walks), walks, checkpoint=checkpoint, **arguments)
    assert same(weights(again), weights(straight))
    assert resumed == records
    assert list(tmp_path.iterdir()) == [checkpoint]


def test_a_finished_training_is_not_repeated(walks: tuple[Demonstrations, Demonstrations], tmp_path: Path):
    checkpoint = tmp_path / "checkpoint"
    model, records = trained(resumable(walks), walks, checkpoint=checkpoint)
    steps = []
    observer = Observer(on_step=lambda step, terms: steps.append(step))
    again, same_records = trained(resumable(walks), walks, checkpoint=checkpoint, observer=observer)
    assert steps == []
    assert same_records == records
    assert same(weights(again), weights(model))


def test_fit_resumes_from_its_checkpoint(tmp_path: Path):
    steps: list[int] = []
    for _ in range(2):
        observer = Observer(on_step=lambda step, terms: steps.append(step))
        fit(two_styles(10), num_steps=2, device="cpu", checkpoint=str(tmp_path / "c"), observer=observer)
    assert steps == [1, 2]


@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode])
def test_fit_learns_whatever_mode_is_on(mode: type):
    with mode():
        model = fit(two_styles(10), num_steps=2, policy_steps=2, device="cpu")
    assert all(weight.requires_grad and not weight.is_inference() for weight in model.parameters())


def test_fit_hands_its_arguments_on(monkeypatch: pytest.MonkeyPatch):
    told: dict[str, object] = {}
    monkeypatch.setattr("tvae.fitting.fit.train", lambda *arguments, **keywords: told.update(keywords))
    model = fit(two_styles(10), device="cpu", encode_actions=False, dynamics=True, state_weight=0.5)
    assert (model.encode_actions, model.dynamics, told["state_weight"]) == (False, True, 0.5)


def test_training_leaves_the_randomness_of_others_alone(walks: tuple[Demonstrations, Demonstrations]):
    torch.manual_seed(8)
    expected = torch.rand(3)
    torch.manual_seed(8)
    trained(untrained(walks[0], dropout=0.1), walks, num_steps=2)
    assert torch.equal(torch.rand(3), expected)


def test_first_weights_depend_on_the_seed_alone(walks: tuple[Demonstrations, Demonstrations]):
    first, second, other = (weights(new_model(walks[0], seed=seed, device="cpu")) for seed in (5, 5, 6))
    assert same(first, second)
    assert not same(first, other)


@pytest.fixture
def checkpoint(walks: tuple[Demonstrations, Demonstrations], tmp_path: Path) -> Path:
    path = tmp_path / "checkpoint.safetensors"
    trained(untrained(walks[0]), walks, num_steps=2, checkpoint=path)
    return path


def rewritten(path: Path, **metadata: str) -> None:
    with safe_open(path, framework="pt") as file:
        old = file.metadata()
    save_file(load_file(path), path, {**old, **metadata})


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"version": "1"}, r"needs format tvae-checkpoint, version 3, got 'tvae-checkpoint', version '1'"),
        ({"version": "99"}, "version '99'"),
        ({"format": "pt"}, "got 'pt', version '3'"),
    ],
)
def test_another_version_or_format_is_refused(
    walks: tuple[Demonstrations, Demonstrations], checkpoint: Path, metadata: dict[str, str], message: str
):
    rewritten(checkpoint, **metadata)
    with pytest.raises(CheckpointError, match=message):
        trained(untrained(walks[0]), walks, num_steps=2, checkpoint=checkpoint)


def test_what_is_no_checkpoint_is_refused(walks: tuple[Demonstrations, Demonstrations], checkpoint: Path):
    whole_file = checkpoint.read_bytes()
    for content in (b"", b"hello", whole_file[:1000], whole_file[:-5]):
        checkpoint.write_bytes(content)
        with pytest.raises(CheckpointError, match="is not a whole safetensors file"):
            trained(untrained(walks[0]), walks, num_steps=2, checkpoint=checkpoint)
    save_file({"a": torch.zeros(2)}, checkpoint)
    with pytest.raises(CheckpointError, match="got None, version None"):
        trained(untrained(walks[0]), walks, num_steps=2, checkpoint=checkpoint)


def test_a_checkpoint_of_another_model_is_refused(walks: tuple[Demonstrations, Demonstrations], checkpoint: Path):
    for argument, value in (("hidden_features", 9), ("dropout", 0.1), ("state_floor", 0.3)):
        with pytest.raises(CheckpointError, match=rf"model\.{argument} \S+ \(now {value}\)"):
            trained(untrained(walks[0], **{argument: value}), walks, num_steps=2, checkpoint=checkpoint)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_steps": 3}, r"num_steps 2 \(now 3\)"),
        ({"num_steps": 2, "seed": 1, "clip": 2.0}, r"clip 1.0 \(now 2.0\), seed 0 \(now 1\)"),
        ({"num_steps": 2, "state_weight": 0.0}, r"state_weight 1.0 \(now 0.0\)"),
        ({"num_steps": 2, "schedule": RAISED_LATE}, r"schedule Constant\(beta=1.0\) \(now Piecewise"),
    ],
)
def test_a_checkpoint_of_another_training_is_refused(
    walks: tuple[Demonstrations, Demonstrations], checkpoint: Path, change: dict, message: str
):
    with pytest.raises(CheckpointError, match=message):
        trained(untrained(walks[0]), walks, checkpoint=checkpoint, **change)


def test_a_checkpoint_of_other_demonstrations_is_refused(
    walks: tuple[Demonstrations, Demonstrations], checkpoint: Path
):
    fewer = (walks[0][:50], walks[1])
    with pytest.raises(CheckpointError, match=r"180 episodes, 1800 steps \(SHA-256 \w{12}\) \(now 50 episodes"):
        trained(untrained(walks[0]), fewer, num_steps=2, checkpoint=checkpoint)
    others = two_styles(200, seed=1).split(0.1, seed=0)
    with pytest.raises(CheckpointError, match=r"1800 steps \(SHA-256 \w{12}\) \(now 180 episodes, 1800 steps"):
        trained(untrained(others[0]), others, num_steps=2, checkpoint=checkpoint)


def test_a_checkpoint_holds_plain_text_and_numbers(checkpoint: Path):
    header = checkpoint.read_bytes()[8:]
    assert header.startswith(b"{")
    with safe_open(checkpoint, framework="pt") as file:
        progress = json.loads(file.metadata()["progress"])
    assert progress["step"] == 2
    assert progress["finished"]


# Things that cannot go on


def test_gradients_that_are_not_finite_are_an_error_in_words(walks: tuple[Demonstrations, Demonstrations]):
    model = untrained(walks[0])
    steps = []
    observer = Observer(on_step=lambda step, terms: steps.append(step))
    with pytest.raises(TrainingError, match=r"step \d+: the gradient is not finite; .*Lower the learning rate"):
        train(model, *walks, schedule=Constant(), **{**QUICK, "learning_rate": 1e30}, observer=observer)
    assert len(steps) >= 1


@pytest.mark.parametrize("weight", [-0.1, float("nan"), float("inf")])
def test_impossible_weights_of_the_state_term_are_refused(
    walks: tuple[Demonstrations, Demonstrations], weight: float
):
    with pytest.raises(ValueError, match=f"state_weight must be a number of at least 0, got {weight}"):
        train(untrained(walks[0]), *walks, schedule=Constant(), **QUICK, state_weight=weight)


@pytest.mark.parametrize("clip", [0, -1.0, float("nan")])
def test_a_clip_that_is_not_positive_is_refused(walks: tuple[Demonstrations, Demonstrations], clip: float):
    """A negative one would turn the gradient round."""
    with pytest.raises(ValueError, match=f"clip must be above 0, got {clip}"):
        train(untrained(walks[0]), *walks, schedule=Constant(), **QUICK, clip=clip)


@pytest.mark.parametrize("name", ["num_steps", "batch_size", "shortest_window", "evaluate_every", "patience"])
def test_counts_below_1_are_refused(walks: tuple[Demonstrations, Demonstrations], name: str):
    with pytest.raises(ValueError, match=f"{name} must be at least 1, got 0"):
        train(untrained(walks[0]), *walks, schedule=Constant(), **{**QUICK, name: 0})


def test_something_has_to_be_held_out(walks: tuple[Demonstrations, Demonstrations]):
    with pytest.raises(ValueError, match="the number of held-out episodes must be at least 1, got 0"):
        train(untrained(walks[0]), walks[0], walks[1][:0], schedule=Constant(), **QUICK)


def test_a_held_out_bound_that_is_not_finite_is_an_error_in_words(walks: tuple[Demonstrations, Demonstrations]):
    actions = walks[1].actions.copy()
    actions[walks[1].action_starts[0]] = np.finfo(np.float32).max
    with pytest.raises(TrainingError, match="step 0: the bound on held-out demonstrations is not finite"):
        train(untrained(walks[0]), walks[0], replace(walks[1], actions=actions), schedule=Constant(), **QUICK)


def test_a_training_that_is_broken_off_leaves_no_dropout_on(walks: tuple[Demonstrations, Demonstrations]):
    def stop(step: int, terms: Terms) -> None:
        raise KilledError

    model = untrained(walks[0], dropout=0.1)
    with pytest.raises(KilledError):
        train(model, *walks, schedule=Constant(), **QUICK, observer=Observer(on_step=stop))
    assert not any(module.training for module in model.modules())


def test_one_trajectory_of_one_step_can_be_trained_on():
    demonstrations = noise([1, 1], [False, True])
    model = untrained(demonstrations, stop=True)
    _, records = trained(model, (demonstrations[:1], demonstrations[1:]))
    assert np.isfinite([record.training.value(1.0) for record in records]).all()
    assert records[-1].training.value(1.0) > records[1].training.value(1.0)


def test_every_kind_of_signal_can_be_trained_on():
    demonstrations = noise([5, 8, 3, 9, 2, 7])
    model = untrained(demonstrations, stop=True, action_components=2, prior_components=2)
    _, records = trained(model, (demonstrations[:4], demonstrations[4:]), schedule=Constant(0.1))
    assert np.isfinite([record.training.value(1.0) for record in records]).all()
    assert records[-1].training.value(1.0) > records[1].training.value(1.0)
