"""The benchmark: what an episode shows, what is measured of bots, cells made once, and the files at the end."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from tvae.baselines.cloning import CloningMLP
from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.scripted import Demonstrators
from tvae.config import PolicyConfig, RunConfig, TrainingConfig
from tvae.data.demonstrations import Demonstrations
from tvae.envs.circle import ConstantTurn, circle_demonstrations
from tvae.envs.navigation import navigation_demonstrations
from tvae.envs.zombie import StraightWalk, StraightWalkAttacking, zombie_demonstrations
from tvae.errors import TvaeError
from tvae.evaluate.statistics import EpisodeStatistics
from tvae.experiments.benchmark import benchmark as module
from tvae.experiments.benchmark.benchmark import Plan, benchmark, write
from tvae.experiments.benchmark.cells import BenchmarkCell, Budget
from tvae.experiments.benchmark.measures import MEASURES, entropy, measure, play, trajectory_fit
from tvae.experiments.benchmark.ours import Ours, steps_of
from tvae.experiments.benchmark.sooner import PARTS, sooner
from tvae.experiments.benchmark.tasks import TASKS
from tvae.experiments.reproduction.cells import CellError
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.run_directory import write_json
from tvae.figures.benchmark import Bar, benchmark_figure

DEMONSTRATIONS = {
    "navigation": navigation_demonstrations,
    "circle": circle_demonstrations,
    "zombie": zombie_demonstrations,
}
QUIET = Console(quiet=True)


# What an episode shows


@pytest.mark.parametrize("task", DEMONSTRATIONS)
def test_demonstrations_show_their_label_and_succeed_in_it_alone(task: str):
    demonstrations, labels = DEMONSTRATIONS[task](120), np.array(TASKS[task].labels)
    shown = labels[TASKS[task].shown(demonstrations)]
    assert shown.tolist() == demonstrations.attribute("label").tolist()
    succeeded = TASKS[task].succeeded(demonstrations)
    own = succeeded[np.arange(len(demonstrations)), TASKS[task].shown(demonstrations)]
    assert own.mean() > 0.94
    assert succeeded.sum() == own.sum()


def test_a_constant_turn_drifts_off_the_circle_that_it_shows():
    episodes = play(ConstantTurn(-10.0), TASKS["circle"], 40, seed=100)
    assert (TASKS["circle"].shown(episodes) == 1).mean() > 0.9
    numbers = TASKS["circle"].numbers(episodes, "right_10")
    assert 0.05 < numbers["radial_error"] < 0.4
    assert TASKS["circle"].succeeded(episodes)[:, 1].mean() < 0.9


def test_walkers_around_a_circle_are_cut_to_one_turn():
    bots = play(TASKS["circle"].world.demonstrators["left_10"](), TASKS["circle"], 5, seed=100)
    assert set(bots.lengths.tolist()) == {126}
    assert set(TASKS["circle"].as_demonstrated(bots, bots).lengths.tolist()) == {63}


# What is measured


def zombie(bots: Bots) -> dict:
    return measure(bots, TASKS["zombie"], zombie_demonstrations(100, seed=1), episodes=400, seed=100)


def test_demonstrators_do_all_that_is_asked():
    lesson = Lesson(zombie_demonstrations(60), TASKS["zombie"].world)
    found = zombie(Demonstrators().learn(lesson))
    assert found["asked"] == 1
    assert found["worst_success"] == found["worst_controllability"] == found["at_will"]["success"] == 1
    assert found["coverage"] > 0.98
    assert found["calibration"] < 0.08
    assert found["trajectory_fit"] < 0.2
    assert found["modes_recovered"] == 2
    assert found["ms_per_action"] > 0


def test_straight_walks_are_measured_as_the_task_says():
    peaceful, armed = zombie(Bots(StraightWalk())), zombie(Bots(StraightWalkAttacking()))
    assert peaceful["success"]["attack"] == peaceful["coverage"] == 0
    assert peaceful["success"]["avoid"] == pytest.approx(0.53, abs=0.08)
    assert peaceful["controllability"] == {"attack": 0, "avoid": 1}
    assert peaceful["calibration"] == pytest.approx(0.5)
    assert "attack" not in peaceful["attacks_per_episode"]
    assert armed["success"]["attack"] == pytest.approx(0.47, abs=0.08)
    assert sum(armed["success"].values()) == pytest.approx(armed["at_will"]["success"])
    assert armed["asked"] == 0


def test_the_behaviour_entropy_of_known_shares():
    assert entropy(np.array([1.0, 1.0, 1.0])) == pytest.approx(1)
    assert entropy(np.array([3.0, 1.0])) == pytest.approx(0.811278)


def test_trajectory_fit_by_hand():
    demonstrations = zombie_demonstrations(60)
    assert trajectory_fit(demonstrations, demonstrations) == 0
    near, far = zombie_demonstrations(60, seed=3), play(StraightWalk(), TASKS["zombie"], 60, seed=100)
    assert 0 < trajectory_fit(near, demonstrations) < trajectory_fit(far, demonstrations) < 2


def test_the_fit_knows_nothing_of_sides():
    demonstrations = zombie_demonstrations(60)
    mirrored = replace(demonstrations, actions=demonstrations.actions * np.array([1.0, -1.0]))
    sides = [name for name in EpisodeStatistics.of(demonstrations).names if name.endswith((".net turn", ".positive"))]
    assert sides
    assert trajectory_fit(mirrored, demonstrations) == pytest.approx(0, abs=1e-9)


# Cells and files


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plan:
    few = partial(zombie_demonstrations, 20)
    monkeypatch.setitem(
        STUDIES, "zombie", replace(STUDIES["zombie"], demonstrations=few, test_demonstrations=partial(few, 100))
    )
    return Plan(tmp_path, (100, 101), ("zombie",), ("walk_attacking", "walk"), Budget(2, 20), tmp_path / "none")


def in_this_process(cells: Sequence[BenchmarkCell], **options: object) -> None:
    for cell in cells:
        cell.run()


def test_a_cell_is_made_once_and_keeps_its_budget(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "make", in_this_process)
    benchmark(plan, jobs=1, force=False, console=QUIET)
    stored = plan.cells("zombie", "walk")[0]
    cell = stored.read()
    assert cell["cell"] == {
        "method": "walk",
        "task": "zombie",
        "seed": 100,
        "most_steps": 2,
        "one_in": 1,
        "episodes": 20,
        "config": {},
        "measures": MEASURES,
    }
    assert cell["env_steps"] == 0
    assert cell["train_seconds"] >= 0
    before = stored.numbers.stat().st_mtime_ns
    benchmark(plan, jobs=1, force=False, console=QUIET)
    assert stored.numbers.stat().st_mtime_ns == before
    benchmark(plan, jobs=1, force=True, console=QUIET)
    assert stored.numbers.stat().st_mtime_ns > before
    other = BenchmarkCell("walk", "zombie", 100, stored.directory, Budget(2, 30), stored.finished)
    with pytest.raises(CellError, match="episodes differs"):
        other.is_measured()


def test_all_files_hold_all_cells(plan: Plan):
    in_this_process(plan.all_cells())
    write(plan)
    with (plan.out / "benchmark.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["method"], row["seed"]) for row in rows} == {
        (method, seed) for method in ("walk", "walk_attacking") for seed in ("100", "101")
    }
    page = (plan.out / "README.md").read_text()
    assert "| Straight walk † | demonstrations | 100, 101 | 0.000 | " in page  # all seeds agree: no interval
    assert "a trial only" in page
    assert page.index("Straight walk †") < page.index("Straight walk, attacks in range †")
    assert (plan.out / "benchmark.png").stat().st_size > 1000
    assert (plan.out / "benchmark.svg").exists()


def test_the_table_holds_what_earlier_plans_made(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "make", in_this_process)
    benchmark(replace(plan, seeds=(101,), methods=("walk",)), jobs=1, force=False, console=QUIET)
    benchmark(replace(plan, seeds=(100,)), jobs=1, force=False, console=QUIET)
    page = (plan.out / "README.md").read_text()
    assert "| Straight walk † | demonstrations | 100, 101 | 0.000 | " in page
    assert "| Straight walk, attacks in range † | demonstrations | 100 | " in page


def test_cells_of_one_table_are_made_alike(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "make", in_this_process)
    first = replace(plan, seeds=(100,))
    benchmark(first, jobs=1, force=False, console=QUIET)
    longer = replace(plan, seeds=(101,), budget=Budget(2, 30))
    with pytest.raises(CellError, match="episodes is 20 in zombie, walk, seed 100, but 30 in zombie, walk, seed 101"):
        benchmark(replace(longer, methods=("walk",)), jobs=1, force=False, console=QUIET)
    assert not longer.cells("zombie", "walk")[0].numbers.exists()
    benchmark(replace(longer, seeds=(100,)), jobs=1, force=True, console=QUIET)
    assert "30 fresh episodes" in (plan.out / "README.md").read_text()


def test_a_fit_that_only_some_seeds_have_says_of_how_many(plan: Plan):
    for cell in plan.all_cells():
        cell.run()
    walk = plan.cells("zombie", "walk")[0]
    numbers = walk.read()
    fit = plan.cells("zombie", "walk")[1].read()["trajectory_fit"]
    write_json(walk.numbers, {name: value for name, value in numbers.items() if name != "trajectory_fit"})
    write(plan)
    (row,) = [line for line in (plan.out / "README.md").read_text().splitlines() if "| Straight walk †" in line]
    assert f"| {fit:.2f} (1 of 2 seeds) |" in row
    write_json(walk.numbers, {name: value for name, value in numbers.items() if name != "at_will"})
    write(plan)
    (row,) = [line for line in (plan.out / "README.md").read_text().splitlines() if "| Straight walk †" in line]
    assert "seeds)" not in row  # what else is not there in every seed is left out


def test_shorter_trainings_have_cells_of_their_own(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    shorter = replace(plan, seeds=(100,), methods=("walk", "cloning_mlp"), budget=Budget(16, 20), parts=(1, *PARTS))
    walk, *cloned = shorter.all_cells()
    assert (walk.method, walk.one_in) == ("walk", 1)
    homes = ["seed-100", *(f"one-in-{part}" for part in PARTS)]
    assert [cell.directory.name for cell in cloned] == homes
    monkeypatch.setattr(module, "make", in_this_process)
    benchmark(shorter, jobs=1, force=False, console=QUIET)
    assert [cell.read()["gradient_steps"] for cell in cloned] == [16, 8, 4, 2]  # parts of what is allowed
    page = (plan.out / "README.md").read_text()
    (row,) = [line for line in page.split("Zombie, how soon")[1].splitlines() if "| 100 |" in line]
    assert row.startswith("| Behavioural cloning, MLP † | 100 | ")
    with (plan.out / "benchmark.csv").open() as file:
        measures = {row["measure"] for row in csv.DictReader(file) if row["method"] == "cloning_mlp"}
    assert {"sooner.quality.1/8", "sooner.quality.1", "sooner.train_seconds.1/2"} <= measures
    assert not any(name.startswith("shorter") for name in measures)
    benchmark(replace(shorter, parts=(1,)), jobs=1, force=False, console=QUIET)
    assert "how soon" in (plan.out / "README.md").read_text()


def test_a_shorter_training_takes_a_part_of_the_steps(plan: Plan):
    task, demonstrations = TASKS["zombie"], zombie_demonstrations(20)
    short = replace(CloningMLP(), num_steps=16)
    lessons = {part: Lesson(demonstrations, task.world, one_in=part) for part in (1, 2, 8)}
    taken = {part: short.learn(lesson).facts["gradient_steps"] for part, lesson in lessons.items()}
    assert taken == {1: 16, 2: 8, 8: 2}
    config = replace(task.config, training=replace(task.config.training, num_steps=20))
    ours = Ours("zombie", config, plan.finished)
    assert ours.learn(lessons[2]).facts["gradient_steps"] == 20


@pytest.mark.parametrize(
    ("bound", "alone", "one_in", "taken"),
    [(2_500, None, 8, (312, 312)), (None, None, 8, (275, 275)), (6_000, 0, 4, (1_500, 0)), (3, 3, 8, (1, 1))],
)
def test_ours_takes_a_part_of_both_numbers_of_steps(
    bound: int | None, alone: int | None, one_in: int, taken: tuple[int, int]
) -> None:
    """Rounded down, as every other method does."""
    config = RunConfig(training=TrainingConfig(num_steps=bound), policy=PolicyConfig(num_steps=alone))
    lesson = Lesson(zombie_demonstrations(20), TASKS["zombie"].world, one_in=one_in)
    assert steps_of(config, lesson) == taken


def test_shorter_trainings_of_another_method_are_no_part_of_a_table(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "make", in_this_process)
    one = replace(plan, seeds=(100,), methods=("cloning_mlp",), parts=(1, 2))
    benchmark(one, jobs=1, force=False, console=QUIET)
    path = one.cells("zombie", "cloning_mlp")[1].numbers
    path.write_text(path.read_text().replace('"num_components": 3', '"num_components": 1'))
    with pytest.raises(CellError, match=r"num_components is 3 in zombie, .*, but 1 in .*, seed 100, 1/2 of its steps"):
        benchmark(replace(one, methods=("walk",), parts=(1,)), jobs=1, force=False, console=QUIET)


def test_nearly_all_must_last():
    def cell(one_in: int, success: float) -> dict[str, object]:
        asked = {"task": "pusht", "one_in": one_in}
        return {"cell": asked, "at_will": {"best_coverage": success}, "train_seconds": 8 / one_in}

    def seconds(*success: float) -> object:
        whole, *others = map(cell, (1, *PARTS), success)
        return sooner({**whole, "shorter": others}).get("train_seconds_to_most")

    assert seconds(0.6, 0.55, 0.54, 0.54) == 1
    assert seconds(0.6, 0.55, 0.2, 0.6) == 4
    assert seconds(0.6, 0.2, 0.6, 0.6) == 8
    assert seconds(0.0, 0.0, 0.0, 0.0) is None


def test_what_there_is_not_is_said(tmp_path: Path):
    with pytest.raises(TvaeError, match=r"no method maddpg; there are: demonstrators, people, walk"):
        Plan(tmp_path, (0,), methods=("maddpg",))
    with pytest.raises(TvaeError, match="no task chess"):
        Plan(tmp_path, (0,), tasks=("chess",))
    with pytest.raises(TvaeError, match="at least one seed"):
        Plan(tmp_path, ())
    with pytest.raises(TvaeError, match="none of walk plays circle"):
        Plan(tmp_path, (0,), ("circle",), ("walk",))
    with pytest.raises(TvaeError, match="no cell under"):
        write(Plan(tmp_path, (0,)))


def test_a_failing_cell_says_which_it_is(plan: Plan, monkeypatch: pytest.MonkeyPatch):
    def fail(*arguments: object, **options: object) -> Demonstrations:
        raise RuntimeError("no world")

    monkeypatch.setattr("tvae.experiments.benchmark.cells.measure", fail)
    with pytest.raises(CellError, match="zombie, walk, seed 100: RuntimeError: no world"):
        plan.cells("zombie", "walk")[0].run()
    assert not plan.cells("zombie", "walk")[0].numbers.exists()


def test_the_figure_shows_every_method_and_its_interval():
    bars = [Bar("walk", 0.0, None), Bar("ours", 0.9, (0.8, 1.2))]
    figure = benchmark_figure([{"a": bars[:1]}, {"b": bars, "c": bars}], caption="open: one seed")
    assert [len(axes.lines) for axes in figure.axes] == [1, 2, 2]
    assert [axes.get_subplotspec().rowspan.start for axes in figure.axes] == [0, 1, 1]
    one_seed, several = figure.axes[1].lines
    assert one_seed.get_markerfacecolor() != one_seed.get_color()
    assert several.get_markerfacecolor() == several.get_color()
    assert figure.get_supxlabel() == "open: one seed"
    for nothing in ([], [{}]):
        with pytest.raises(ValueError, match="at least one panel"):
            benchmark_figure(nothing)
