"""The benchmark's two tasks with real people: what is held out, what an episode shows, who plays, a quick run."""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import call
from toys import noise
from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.policies import held_apart
from tvae.baselines.state_vae import StateTrajectoryVAE
from tvae.config import RunConfig
from tvae.envs.overcooked import overcooked_demonstrations
from tvae.envs.pusht import PushTEnv, pusht_demonstrations, replay
from tvae.errors import TvaeError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.benchmark import benchmark as module
from tvae.experiments.benchmark.benchmark import Plan
from tvae.experiments.benchmark.cells import QUICK, BenchmarkCell, Budget
from tvae.experiments.benchmark.human import ALONE
from tvae.experiments.benchmark.measures import measure, play
from tvae.experiments.benchmark.methods import METHODS
from tvae.experiments.benchmark.ours import Ours, styles_by_label
from tvae.experiments.benchmark.people import People, Recorded
from tvae.experiments.benchmark.tasks import PAPER, TASKS
from tvae.spaces import FloatArray

ROOT = Path(__file__).parent.parent
PUSHT, OVERCOOKED = TASKS["pusht"], TASKS["overcooked"]
CLOCKWISE, NONE, BOTH = "3", "12", ("1", "14")
"""Pairs that go round clockwise all the time, not at all, and now and then."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recordings of a few people: 20 pushes, and the games of five pairs."""
    folder = tmp_path_factory.mktemp("data")
    with np.load(ROOT / "data/pusht_human_206.npz") as file:
        ends = file["episode_ends"][:20]
        few = {"state": file["state"][: ends[-1]], "action": file["action"][: ends[-1]], "episode_ends": ends}
    np.savez(folder / "pusht_human_206.npz", **few)
    with gzip.open(ROOT / "data/overcooked_human_2019.json.gz", "rt", encoding="utf-8") as file:
        games = json.load(file)
    games["trials"] = [
        game
        for game in games["trials"]
        if game["layout"] == "coordination_ring" and str(game["pair"]) in {CLOCKWISE, NONE, *BOTH, ALONE}
    ]
    with gzip.open(folder / "overcooked_human_2019.json.gz", "wt", encoding="utf-8") as file:
        json.dump(games, file)
    return folder


class Still:
    """A policy that always does the same."""

    def __init__(self, action: Sequence[float]) -> None:
        self.action = np.array(action, dtype=np.float64)

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""

    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A)"""
        return np.tile(self.action, (len(observations), 1))


# What is held out


def test_pushes_are_held_out_whole_and_differ_between_seeds(data: Path) -> None:
    training, test, other = PUSHT.demonstrations(data, 0), PUSHT.test(data, 0), PUSHT.test(data, 1)
    there = [set(part.attribute("episode").tolist()) for part in (training, test, other)]
    assert (len(there[0]), len(there[1])) == (17, 3)
    assert not there[0] & there[1]
    assert there[1] != there[2]
    assert training.final_observed.all()
    whole = pusht_demonstrations(data / "pusht_human_206.npz")
    first = int(test.attribute("episode")[0])
    assert test.lengths[0] == len(whole[first]) - 1
    assert test.attribute("best_coverage")[0] == replay(whole[first], PushTEnv()).best_coverage


def test_pairs_are_held_out_whole_but_never_the_one_that_goes_the_other_way(data: Path) -> None:
    for seed in range(4):
        training, test = OVERCOOKED.demonstrations(data, seed), OVERCOOKED.test(data, seed)
        seen, held_out = (set(part.attribute("pair").astype(str).tolist()) for part in (training, test))
        assert not seen & held_out
        assert ALONE in seen
        assert len(held_out) == 2
        assert test.lengths.max() == training.lengths.max() == 200
        for judged in held_apart(training, 0.1, seed)[1], held_apart(training, 0.5, seed)[1]:
            assert 0 < (training.attribute("pair").astype(str)[judged] == ALONE).mean() < 0.5
        assert set(OVERCOOKED.labels) >= set(training.attribute("label").tolist())


def test_the_judge_of_a_training_is_another_pair() -> None:
    demonstrations = noise([3, 4, 5, 6, 3, 4]).with_attributes({"group": np.array(list("aabbcc"))})
    for seed in range(5):
        training, judged = held_apart(demonstrations, 0.1, seed)
        assert len(judged) == 2
        assert not set(demonstrations.attribute("group")[training]) & set(demonstrations.attribute("group")[judged])
        assert sorted([*training, *judged]) == list(range(6))


# What an episode shows


def test_pairs_show_the_way_they_go(data: Path) -> None:
    training, test = OVERCOOKED.demonstrations(data, 0), OVERCOOKED.test(data, 0)
    labels = np.array(OVERCOOKED.labels)
    assert labels[OVERCOOKED.shown(training)].tolist() == training.attribute("label").tolist()
    shown = [*zip(training.attribute("pair").astype(str), labels[OVERCOOKED.shown(training)], strict=True)]
    shown += [*zip(test.attribute("pair").astype(str), labels[OVERCOOKED.shown(test)], strict=True)]
    for pair, label in ((ALONE, "counter-clockwise"), (CLOCKWISE, "clockwise"), (NONE, "none")):
        assert {what for who, what in shown if who == pair} == {label}


def test_who_stands_still_goes_nowhere_and_cooks_nothing(data: Path) -> None:
    bots = Bots(Still([4.0, 4.0]))
    found = measure(bots, OVERCOOKED, OVERCOOKED.test(data, 0), episodes=2, seed=100)
    assert found["success"] == {"clockwise": 0, "none": 1, "counter-clockwise": 0}
    assert found["at_will"] == {"success": 1, "soups": 0, "laps": 0}
    assert found["soups"] == {"none": 0}
    assert "worst_soups" not in found
    assert (found["coverage"], found["modes_recovered"], found["asked"]) == (0, 1, 0)


def test_who_never_pushes_covers_nothing_more(data: Path) -> None:
    episodes, test = play(Still([20.0, 20.0]), PUSHT, 3, seed=100), PUSHT.test(data, 0)
    assert set(episodes.lengths.tolist()) == {300}
    assert PUSHT.as_demonstrated(episodes, test).lengths.tolist() == test.lengths.tolist()
    found = measure(Bots(Still([20.0, 20.0])), PUSHT, test, episodes=3, seed=100)
    assert set(found) == {"at_will", "trajectory_fit", "ms_per_action"}
    assert found["at_will"]["success"] == 0
    assert found["at_will"]["final_coverage"] <= found["at_will"]["best_coverage"] < 0.95
    assert found["trajectory_fit"] > 0.5


@pytest.mark.parametrize("task", ["pusht", "overcooked"])
def test_people_are_measured_in_their_recordings(task: str, data: Path) -> None:
    demonstrations = TASKS[task].demonstrations(data, 0)
    bots = People(task).learn(Lesson(demonstrations, TASKS[task].world))
    found = measure(bots, TASKS[task], TASKS[task].test(data, 0), episodes=1, seed=0)
    assert "ms_per_action" not in found
    assert 0 < found["trajectory_fit"] < 2
    if task == "pusht":
        assert found["at_will"]["best_coverage"] == demonstrations.attribute("best_coverage").mean() > 0.85
    else:
        assert sum(found["success"].values()) == pytest.approx(1)
        assert found["soups"]["counter-clockwise"] > 3
        assert isinstance(bots.at_will, Recorded)
        games = overcooked_demonstrations(data / "overcooked_human_2019.json.gz", ["coordination_ring"])
        assert bots.at_will.episodes.num_steps <= 2 * games.num_steps  # from both seats, no step twice


def test_where_there_are_no_labels_nobody_can_be_asked() -> None:
    lesson = Lesson(noise([3, 9, 5, 7]), PUSHT.world, most_steps=2)
    assert lesson.labels == ()
    assert StateTrajectoryVAE().learn(lesson).by_style == {}


def test_styles_that_bear_the_same_label_belong_together() -> None:
    middles = np.repeat([[-9.0, 0.0], [0.0, 9.0], [9.0, 0.0]], 60, axis=0)
    means = middles + np.random.default_rng(0).normal(size=middles.shape)
    playstyles = find_playstyles(Posteriors(means, np.full_like(means, 0.1)), seed=0)
    assert len(playstyles) == 3
    labels = np.repeat(["round", "round", "none"], 60)
    demonstrations = noise([2] * 180).with_attributes({"label": labels})
    found = styles_by_label(playstyles, demonstrations)
    assert {label: len(styles) for label, styles in found.items()} == {"round": 2, "none": 1}


# Who plays, and the files


def test_who_cannot_play_is_left_out_by_name(tmp_path: Path) -> None:
    plan = Plan(tmp_path, (0,), ("pusht", "overcooked"))
    names = {task: plan.methods_of(task) for task in plan.tasks}
    assert not {"labelled", "infogail", "dagger", "demonstrators", "walk"} & set(names["pusht"])
    assert set(names["overcooked"]) - set(names["pusht"]) >= {"labelled", "infogail"}
    assert {"people", "cloning_mlp", "ours"} <= set(names["pusht"])
    assert Plan(tmp_path, (0,)).tasks == PAPER
    assert not any("people" in Plan(tmp_path, (0,)).methods_of(task) for task in PAPER)
    with pytest.raises(TvaeError, match=r"none of dagger plays pusht: left out: dagger in pusht .needs labels, "):
        Plan(tmp_path, (0,), ("pusht",), ("dagger",))


def test_each_task_has_its_own_number_of_episodes(tmp_path: Path) -> None:
    def episodes(task: str, budget: Budget) -> int:
        return BenchmarkCell("flow", task, 0, tmp_path, budget, tmp_path).asked["episodes"]

    tasks = ("zombie", "pusht", "overcooked")
    assert [episodes(task, Budget()) for task in tasks] == [1000, 200, 100]
    assert [episodes(task, QUICK) for task in tasks] == [50, 10, 5]
    assert [episodes(task, Budget(episodes=7)) for task in tasks] == [7, 7, 7]


@pytest.mark.parametrize("path", sorted((ROOT / "results/benchmark/cells").glob("*/*")), ids=str)
def test_stored_cells_are_those_that_would_be_made(path: Path) -> None:
    models = ROOT / "results/cells"
    for home in sorted(path.glob("seed-*")):
        seed = int(home.name.removeprefix("seed-"))
        for part in (home, *sorted(home.glob("one-in-*"))):
            one_in = 1 if part == home else int(part.name.removeprefix("one-in-"))
            cell = BenchmarkCell(path.name, path.parent.name, seed, part, Budget(), models, one_in=one_in)
            assert cell.is_measured()


def test_ours_untuned_is_told_which_segments_belong_together_and_nothing_else() -> None:
    made = METHODS["ours_untuned"].make("overcooked", Path("nowhere"))
    assert made == Ours("overcooked", RunConfig(group="group"), Path("nowhere"))


@pytest.mark.filterwarnings("ignore::tvae.train.diagnosis.TrainingWarning")
def test_a_quick_run_beside_the_people(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def in_this_process(cells: Sequence[BenchmarkCell], **options: object) -> None:
        for cell in cells:
            cell.run()

    monkeypatch.setattr(module, "make", in_this_process)
    short = replace(OVERCOOKED, options={**OVERCOOKED.options, "horizon": 100})
    monkeypatch.setitem(TASKS, "overcooked", short)
    methods = ["people", "cloning_mlp", "labelled", "dagger"]
    call(
        *["benchmark", "--out", tmp_path, "--quick", "--steps", "2", "--episodes", "2", "--data", data],
        *["--tasks", "pusht", "overcooked", "--methods", *methods],
    )
    said = " ".join(capsys.readouterr().out.split())
    assert "left out: labelled in pusht (needs labels)" in said
    assert "left out: dagger in overcooked (needs demonstrators that can be asked)" in said
    with (tmp_path / "benchmark.csv").open() as file:
        rows = {(row["task"], row["method"]) for row in csv.DictReader(file)}
    assert rows == {(task, method) for task in ("pusht", "overcooked") for method in methods[:3]} - {
        ("pusht", "labelled"),
        ("pusht", "dagger"),
    }
    page = (tmp_path / "README.md").read_text()
    pusht, overcooked = page.split("## PushT, people")[1].split("## Overcooked, people")
    assert "2 fresh episodes of each bot" in pusht
    assert "†" not in pusht
    assert "| The people themselves † |" in overcooked
    assert (tmp_path / "benchmark.png").stat().st_size > 1000


def test_recordings_that_are_not_there_are_missed_by_name(tmp_path: Path) -> None:
    with pytest.raises(TvaeError, match=r"nowhere.pusht_human_206.npz is not there.*--data"):
        PUSHT.demonstrations(tmp_path / "nowhere", 0)
