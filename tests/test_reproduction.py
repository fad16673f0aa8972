"""The reproduction: cells that are made once, numbers over seeds, and every file that it promises."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from toys import two_styles, untrained
from tvae.data.demonstrations import Demonstrations
from tvae.envs.circle import CircleExpert, CircleVectorEnv, circle_demonstrations
from tvae.envs.navigation import navigation_demonstrations
from tvae.envs.zombie import zombie_demonstrations
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.keeping import style_consistency
from tvae.evaluate.leakage import leakage
from tvae.evaluate.over_seeds import band, over_seeds
from tvae.evaluate.paths import apart, to_nearest
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.fitting import amounts_of, split
from tvae.experiments.reproduction import circle, navigation, zombie
from tvae.experiments.reproduction import reproduce as module
from tvae.experiments.reproduction.cells import Cell, CellError, Effort
from tvae.experiments.reproduction.presets import ABLATIONS, BASES, BESIDE, PRESETS, SAMPLE_SIZES
from tvae.experiments.reproduction.reproduce import Plan, reproduce
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.subject import TEST, first_observations
from tvae.experiments.reproduction.summary import less, summary
from tvae.experiments.run_directory import write_json
from tvae.figures.zombie import zombie_paths
from tvae.rollouts import rollout
from tvae.train.checkpoint import write_checkpoint

QUICK = Effort(steps=3, episodes=12)
QUIET = Console(quiet=True)


FEW = {"navigation": navigation_demonstrations, "circle": circle_demonstrations, "zombie": zombie_demonstrations}


def some(episodes: Demonstrations, count: int) -> Demonstrations:
    """The first `count` episodes of each label."""
    labels = episodes.attribute("label")
    return episodes.select(np.sort(np.concatenate([np.flatnonzero(labels == x)[:count] for x in np.unique(labels)])))


@pytest.fixture
def small_studies(monkeypatch: pytest.MonkeyPatch, test_sets: dict[str, Demonstrations]) -> None:
    """The studies with few demonstrations; the zombie's test worlds stay as they are, since they come in pairs."""
    for task, study in STUDIES.items():
        test = test_sets[task] if task == "zombie" else some(test_sets[task], 20)
        few = replace(study, demonstrations=partial(FEW[task], 120), test_demonstrations=partial(lambda x: x, test))
        monkeypatch.setitem(STUDIES, task, few)


def in_this_process(cells: list[Cell], **options: object) -> None:
    for cell in cells:
        cell.run("cpu")


@pytest.fixture(scope="module")
def test_sets() -> dict[str, Demonstrations]:
    return {task: study.test_demonstrations() for task, study in STUDIES.items()}


# What is trained


@pytest.mark.parametrize("task", ["navigation", "circle", "zombie"])
def test_the_papers_reading_is_a_plain_lstm_and_the_evidence_lower_bound(task: str):
    paper = PRESETS[task]["paper"]
    assert (paper.model.latent_features, paper.model.prior_components, paper.model.window) == (2, 1, None)
    assert not any((paper.model.reactive, paper.model.stop, paper.model.dynamics, paper.model.events))
    assert {weight for _, weight in paper.training.kl_points} == {1.0}


@pytest.mark.parametrize("task", ["navigation", "circle", "zombie"])
def test_the_bound_alone_is_our_default_but_for_how_long_it_trains(task: str):
    default, bound = PRESETS[task]["default"], ABLATIONS[task]["bound"]
    assert bound.policy.num_steps == 0
    assert replace(bound, training=default.training, policy=default.policy) == default
    assert replace(bound.training, num_steps=default.training.num_steps) == default.training
    both = amounts_of(default, split(STUDIES[task].demonstrations(0), default)[0])
    assert bound.training.num_steps is not None
    assert both.num_steps <= bound.training.num_steps < both.num_steps + both.policy_steps


@pytest.mark.parametrize(("task", "num_steps"), [("circle", 2_200), ("zombie", 2_200), ("navigation", 6_000)])
def test_our_default_takes_as_many_steps_as_the_pages_say(task: str, num_steps: int):
    demonstrations = STUDIES[task].demonstrations(0)
    training, _ = split(demonstrations, PRESETS[task]["default"])
    assert amounts_of(PRESETS[task]["default"], training).num_steps == num_steps


def test_each_ablation_changes_one_thing_of_the_bound():
    bound = ABLATIONS["zombie"]["bound"].to_json()
    ablations = dict(ABLATIONS["zombie"])
    assert ablations.pop("default_300") == ablations.pop("default_5000") == PRESETS["zombie"]["default"]
    for name, config in ablations.items():
        changed = {
            field
            for part in ("model", "training", "policy")
            for field in bound[part]
            if config.to_json()[part][field] != bound[part][field]
        }
        if name.startswith("plain") and name != "plain_decoders":  # without remedies on the decoders' side
            changed -= {"reactive", "events"}
            assert len(changed) == (name != "plain"), name
        else:
            assert len(changed - {"stop"}) == (name not in (*SAMPLE_SIZES, "bound")), name


def test_plain_decoders_have_each_remedy_on_the_latents_side_alone():
    presets = ABLATIONS["zombie"]
    for name, alone in (
        ("budget", "plain_budget"),
        ("start_independence", "plain_independence"),
        ("swapped_start", "plain_swapped"),
    ):
        assert presets[alone].model == presets["plain"].model
        assert not any((presets[alone].model.reactive, presets[alone].model.events))
        assert presets[alone].training == presets[name].training != presets["plain"].training


@pytest.mark.parametrize("task", STUDIES)
def test_stored_trainings_are_those_that_would_be_made(task: str):
    plan = Plan([task], Path(__file__).parent.parent / "results", 5, Effort(), ablations=True, command="")
    assert all(cell.is_measured() for cell in plan.all_cells())


def test_every_preset_has_a_measure():
    for task, study in STUDIES.items():
        assert set(study.measures) == set(study.presets) == {*PRESETS[task], *BESIDE[task], *ABLATIONS[task]}


def test_other_numbers_of_demonstrations_are_those_of_the_recipe():
    assert {name: len(STUDIES["zombie"].learnt_from(name, seed=0)) for name in SAMPLE_SIZES} == SAMPLE_SIZES
    assert len(STUDIES["zombie"].learnt_from("default", seed=0)) == 2000


def test_test_demonstrations_are_not_those_of_training(test_sets: dict[str, Demonstrations]):
    training = STUDIES["navigation"].demonstrations(0)
    assert len({*training.attribute("goal_x").tolist()} & {*test_sets["navigation"].attribute("goal_x").tolist()}) == 0


def test_both_zombie_styles_are_tested_in_the_same_worlds(test_sets: dict[str, Demonstrations]):
    _, zombies = zombie_paths(first_observations(test_sets["zombie"]))
    attack, avoid = np.split(zombies, 2)
    np.testing.assert_allclose(attack, avoid)
    labels = test_sets["zombie"].attribute("label")
    assert labels[: len(labels) // 2].tolist() == ["attack"] * zombie.NUM_TEST


# What is measured


def test_apart_and_to_nearest_by_hand():
    here, there = np.zeros((4, 2)), np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 0.0]])
    assert apart([here, there], [there, there]).tolist() == pytest.approx([(3 + 4 + 4) / 3, 0])
    assert to_nearest(here[None], np.stack([here + 2, here + 1])).tolist() == [[2**0.5] * 4]
    halves = np.stack([np.where(np.arange(4)[:, None] < 2, here, 9.0), np.where(np.arange(4)[:, None] < 2, 3.0, here)])
    assert to_nearest(here[None], halves).round(3).tolist() == [[4.243, 4.243, 0, 0]]  # one reference for all steps


def test_an_expert_keeps_to_the_nearest_circle_and_a_straight_walk_does_not():
    episodes = rollout(CircleVectorEnv(5), CircleExpert(-10.0), 5, seed=TEST)
    places = np.stack([episode.observations for episode in episodes])
    assert circle.off_circle(places[:, :64]).mean() < 0.2
    straight = np.stack([np.arange(50.0), np.zeros(50)], axis=1)
    assert circle.off_circle(straight[None])[0, -1] == pytest.approx(np.hypot(49, 20) - 20)


def test_a_goal_is_reached_within_thirteen():
    paths = [np.stack([np.zeros(2), goal + np.array([12.9, 0])]) for goal in navigation.GOALS]
    paths += [np.zeros((3, 2)), navigation.GOALS[1:2] + np.array([0, 13.1])]
    assert navigation.goal_reached(paths).tolist() == [0, 1, 2, -1, -1]


def test_leakage_finds_the_style_that_tells_most_and_the_sample_tells_less():
    rng = np.random.default_rng(1)
    styles = np.repeat([0, 1], 300)
    world = rng.standard_normal((600, 2))
    means = np.where(styles[:, None] == 0, world, 0.0) + 0.01 * rng.standard_normal((600, 2)) + 10 * styles[:, None]
    found = leakage(Posteriors(means, np.full((600, 2), 0.5)), world, styles)
    assert found.from_mean.r2 > 0.9
    assert 0.5 < found.from_sample.r2 < found.from_mean.r2
    assert found.from_sample.nats < found.from_mean.nats
    nothing = leakage(Posteriors(means[300:], np.full((300, 2), 0.5)), world[300:], styles[300:])
    assert nothing.from_mean.r2 < 0.1
    assert nothing.from_mean.nats < 0.1


def test_leakage_in_nats_is_what_a_gaussian_channel_carries():
    rng = np.random.default_rng(0)
    world = rng.standard_normal((4000, 1))
    noisy = Posteriors(world, np.full((4000, 1), 1.0))
    told = leakage(noisy, np.hstack([world, np.ones((4000, 1))]), np.zeros(4000, dtype=np.int64), seed=1).from_sample
    assert told.r2 == pytest.approx(0.5, abs=0.05)  # Var(E[y | z]) / Var(y) for y, noise ~ N(0, 1)
    assert told.nats == pytest.approx(0.5 * np.log(2), abs=0.05)


def test_leakage_knows_facts_that_do_not_vary_and_such_as_are_told_exactly():
    rng = np.random.default_rng(0)
    told = np.repeat([0.0, 1.0], 200)[:, None]
    posteriors = Posteriors(10 * told + 0.01 * rng.standard_normal((400, 1)), np.full((400, 1), 0.01))
    found = leakage(posteriors, np.hstack([told, np.full((400, 1), 0.1)]), np.zeros(400, dtype=np.int64))
    assert found.from_mean.r2 == pytest.approx(1)
    assert found.from_mean.nats == pytest.approx(0.5 * np.log(1e6))
    assert leakage(posteriors, np.full((400, 2), 0.1), np.zeros(400, dtype=np.int64)).from_mean.nats == 0


def test_a_style_is_kept_where_what_was_done_is_told_as_it(monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(0)
    clusters = np.repeat([[-3.0, 0.0], [3.0, 0.0]], 200, axis=0) + 0.3 * rng.standard_normal((400, 2))
    playstyles = find_playstyles(Posteriors(clusters, np.full((400, 2), 0.3)))
    assert len(playstyles) == 2
    played = Posteriors(np.vstack([clusters[:30], clusters[-10:]]), np.full((40, 2), 0.3))
    monkeypatch.setattr("tvae.evaluate.keeping.encode", lambda model, episodes: played)
    episodes = two_styles(3)
    kept = {
        bool(playstyles.assignment[-1] == style.index): style_consistency(
            untrained(episodes), playstyles, style, episodes
        )
        for style in playstyles.styles
    }
    assert kept == {True: 0.25, False: 0.75}


def test_the_grid_of_figure_3_goes_from_style_to_style():
    grid = navigation.latent_grid(np.array([[0.0, 4.0], [2.0, 0.0], [1.0, 1.0]]))
    np.testing.assert_allclose(grid[0, :, 0], [0, 0.5, 1, 1.5, 2])
    np.testing.assert_allclose(grid[:, 0, 1], [4, 3, 2, 1, 0])


def test_over_seeds_gives_students_interval_and_leaves_out_what_is_no_number():
    runs = [{"a": {"b": value}, "words": "no", "ids": [1]} for value in (1.0, 2.0, 3.0)]
    assert over_seeds(runs) == {"a": {"b": {"mean": 2.0, "ci95": [-0.484138, 4.484138], "seeds": 3}}}
    mean, low, high = band(np.array([[5.0, 6.0]]))
    assert mean.tolist() == low.tolist() == high.tolist() == [5.0, 6.0]


def test_a_summary_compares_the_styles_of_every_pair_of_seeds():
    cell = {"seed": 0, "episodes": 5, "model": {}, "training": {}}
    runs = [
        {"cell": cell, "commit": "abc", "versions": {}, "warnings": ["collapsed"], "test_assignment": styles}
        for styles in ([0, 0, 1, 1], [1, 1, 0, 0], [0, 1, 0, 1], [0, 0, 0, 0])
    ]
    found = summary(runs)
    between = {"mean": pytest.approx((1 - 0.5 - 0.5) / 3), "ci95": [-0.5, 1.0], "pairs": 3}
    assert found["between_seeds"]["ari"] == between  # a seed that found one style agrees with nobody
    assert found["warnings"] == ["collapsed"]


def test_what_differs_is_compared_seed_by_seed():
    """The spread of the seeds, which both share, is not in it; what one of them lacks is left out."""
    runs, others = (
        [{"success": {"attack": share + more, "avoid": 1.0}, "kl_nats": more, "other": 9} for share in (0.5, 0.7, 0.9)]
        for more in (0.1, 0.0)
    )
    del others[1]["kl_nats"]
    found = less(runs, others)
    assert found["success"]["attack"] == {"mean": 0.1, "ci95": [0.1, 0.1], "seeds": 3}
    assert found["success"]["avoid"]["mean"] == 0
    assert found.keys() == {"success"}


def test_every_ablation_is_compared_with_what_it_is_one_change_of():
    for task, bases in BASES.items():
        assert {"bound", *bases} == {"default", *ABLATIONS[task]}
    assert {name for name, base in BASES["zombie"].items() if base == "plain"} == {
        name for name in ABLATIONS["zombie"] if name.startswith("plain_") and name != "plain_decoders"
    }


# The command


def test_only_what_is_missing_is_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    plan = Plan(["circle"], tmp_path, 2, QUICK, ablations=False, command="")
    trained: list[Cell] = []
    monkeypatch.setattr(Cell, "is_finished", lambda cell: cell.preset == "default")
    monkeypatch.setattr(Cell, "is_measured", lambda cell: cell.preset in {"default", "paper"})
    monkeypatch.setattr(module, "train_all", lambda cells, **options: trained.extend(cells))
    monkeypatch.setattr(module, "finish", lambda plan, task, *, console: None)
    reproduce(plan, jobs=1, device="cpu", force=False, console=QUIET)
    assert [(cell.preset, cell.seed) for cell in trained] == [
        ("paper", 0),  # measured, but its model is to be drawn
        *((preset, seed) for preset in ("cloning_lstm", "cloning_memoryless") for seed in (0, 1)),
    ]


def test_only_ablations_that_are_measured_as_asked_are_shown(tmp_path: Path):
    cells = Plan(["zombie"], tmp_path, 1, QUICK, ablations=False, command="").cells("zombie", "one_law")
    assert not module._is_there(cells)
    write_json(cells[0].metrics, {"cell": cells[0].asked})
    assert module._is_there(cells)
    assert not module._is_there([replace(cells[0], effort=Effort(steps=4, episodes=12))])


@pytest.mark.usefixtures("small_studies")
@pytest.mark.parametrize(
    ("task", "seeds", "pictures"),
    [
        ("navigation", 2, ["figure-2", "figure-3", "figure-horizon"]),
        ("circle", 1, ["figure-4", "figure-horizon"]),
        ("zombie", 1, ["figure-5", "figure-6", "figure-7", "figure-8"]),
    ],
)
def test_a_reproduction_leaves_what_it_promises(
    task: str, seeds: int, pictures: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "train_all", in_this_process)
    monkeypatch.setattr("tvae.experiments.reproduction.zombie_pictures.WINDOWS", (1, 2, 30))
    monkeypatch.setattr("tvae.experiments.reproduction.zombie_pictures._SHOWN", 4)
    monkeypatch.setattr("tvae.experiments.reproduction.zombie.WINDOWS", (1, 2, 30))
    plan = Plan([task], tmp_path, seeds, QUICK, ablations=False, command="tvae reproduce")
    reproduce(plan, jobs=1, device="cpu", force=False, console=QUIET)
    home = tmp_path / task
    for picture in pictures:
        assert (home / f"{picture}.png").stat().st_size > 5_000
        assert (home / f"{picture}.svg").read_text().startswith("<?xml")
        with (home / f"{picture}.csv").open() as lines:
            rows = list(csv.DictReader(lines))
        table = json.loads((home / f"{picture}.json").read_text())["table"]
        assert [row[next(iter(table))] for row in rows] == [str(value) for value in next(iter(table.values()))]
    metrics = json.loads((home / "metrics.json").read_text())
    assert metrics["playstyles"]["ari"]["seeds"] == seeds
    assert metrics["decoder_consistency"]["mean"] > 0
    assert metrics["config"]["training"]["num_steps"] == 3
    assert json.loads((home / "paper" / "metrics.json").read_text())["config"]["model"]["reactive"] is False
    assert "| default | paper |" in (home / "README.md").read_text()
    if task == "zombie":
        assert set(metrics["held_out"]) == set(zombie.HELD_OUT_WORLDS)
        assert metrics["held_out"]["zigzag"]["expert_avoid"]["mean"] == 1.0
        assert set(metrics["success_by_window"]["30"]) == {"attack", "avoid"}
        assert {path.name for path in home.glob("animation-*")} == {
            f"animation-{style}.{kind}" for style in ("attack", "avoid") for kind in ("gif", "mp4")
        }
    assert all(cell.is_finished() for cell in plan.all_cells())


@pytest.mark.usefixtures("small_studies")
def test_a_killed_training_goes_on_to_the_same_weights_and_another_cell_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    effort = Effort(steps=120, episodes=5)
    whole = Cell("navigation", "cloning_memoryless", 3, tmp_path / "whole", effort)
    whole.run("cpu")
    killed = replace(whole, directory=tmp_path / "killed")

    def killed_at_the_checkpoint(*arguments: object, **named: object) -> None:
        write_checkpoint(*arguments, **named)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("tvae.train.loop.write_checkpoint", killed_at_the_checkpoint)
        with pytest.raises(KeyboardInterrupt):
            killed.run("cpu")
    with pytest.raises(CellError, match="episodes, training differs from what is asked"):
        replace(killed, effort=Effort(steps=60, episodes=6)).is_finished()
    assert (killed.directory / "checkpoint.safetensors").exists()
    assert not killed.is_finished()
    killed.run("cpu")
    assert killed.is_finished()
    weights = [(cell.directory / "model.safetensors").read_bytes() for cell in (whole, killed)]
    assert weights[0] == weights[1]
    assert killed.read()["horizon"] == whole.read()["horizon"]
    with pytest.raises(CellError, match="episodes, training differs from what is asked"):
        replace(killed, effort=Effort(steps=60, episodes=6)).is_finished()


def test_numbers_can_be_measured_anew_without_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    cell = Cell("circle", "cloning_memoryless", 0, tmp_path, Effort(steps=2, episodes=3))
    module.train_all([cell], jobs=1, device="cpu", force=False, console=QUIET)  # in a process of its own
    assert cell.is_finished()
    first = cell.read()
    assert first["train_seconds"] > 0
    cell.metrics.unlink()
    monkeypatch.setattr("tvae.experiments.reproduction.cells.trained", lambda *a, **k: pytest.fail("trained again"))
    assert not cell.is_finished()
    cell.run("cpu")
    assert {name: cell.read()[name] for name in ("horizon", "train_seconds")} == {
        name: first[name] for name in ("horizon", "train_seconds")
    }


def test_what_goes_wrong_in_a_cell_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    cell = Cell("circle", "paper", 7, tmp_path, Effort(steps=2, episodes=3))
    monkeypatch.setattr(Cell, "_train", lambda *_: 1 / 0)
    with pytest.raises(CellError, match="circle, paper, seed 7: ZeroDivisionError"):
        cell.run("cpu")
