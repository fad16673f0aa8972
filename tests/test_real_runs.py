"""The human demonstrations that come with the project, through the whole of a small run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import tvae
from tvae.cli import main
from tvae.experiments.tasks import TASKS

DATA = Path(__file__).parent.parent / "data"
FILES = {"pusht": DATA / "pusht_human_206.npz", "overcooked": DATA / "overcooked_human_2019.json.gz"}
SMALL = ["--training.num-steps", "4", "--training.evaluate-every", "2", "--model.hidden-features", "8"]
SMALL += ["--model.window", "4", "--model.no-stop", "--device", "cpu", "--episodes", "2"]


@pytest.mark.parametrize(
    ("task", "env", "measure", "options"),
    [
        ("pusht", "tvae/PushT-v0", "best_coverage", ["--segment", "60"]),
        ("overcooked", "tvae/Overcooked-v0", "soups_per_1200_steps", ["--group", "pair"]),
    ],
)
def test_real_data_becomes_a_report(task: str, env: str, measure: str, options: list[str], tmp_path: Path) -> None:
    table = tmp_path / f"{task}.parquet"
    main(["data", "make", task, str(table), "--data", str(FILES[task])])
    main(["fit", str(table), "--out", str(tmp_path / "run"), "--env", env, *options, *SMALL])
    metrics = json.loads((tmp_path / "run/metrics.json").read_text())
    assert all(value >= 0 for value in metrics[measure].values())
    assert (tmp_path / "run/report.html").stat().st_size > 10_000


def test_overcooked_recipe_holds_out_whole_pairs() -> None:
    recipe = TASKS["overcooked"](FILES["overcooked"], 0)
    demonstrations = recipe.demonstrations()
    assert demonstrations.lengths.min() >= 100
    assert demonstrations.lengths.max() == 200
    training, held_out = demonstrations.split(
        recipe.config.training.held_out, seed=recipe.config.seed, group=recipe.config.group
    )
    assert not set(training.attributes["pair"]) & set(held_out.attributes["pair"])
    assert len(set(held_out.attributes["pair"])) >= 2


def test_pusht_recipe_has_all_demonstrations() -> None:
    demonstrations = TASKS["pusht"](FILES["pusht"], 0).demonstrations()
    assert (len(demonstrations), demonstrations.num_steps) == (206, 25_650)


def test_zombie_recipe_depends_on_its_seed() -> None:
    first, same, other = (TASKS["zombie"](None, seed).demonstrations() for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.observations, same.observations)
    assert isinstance(other, tvae.Demonstrations)
    assert not np.array_equal(first.lengths, other.lengths)
