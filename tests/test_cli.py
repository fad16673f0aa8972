"""The command line as a user meets it: a small run from beginning to end, and what bad input says."""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from safetensors.torch import load_file

import tvae
from commands import call, refused
from toys import two_styles
from tvae.cli.options import CONSOLE
from tvae.data.batches import suitable_batch_size
from tvae.envs.navigation import navigation_demonstrations
from tvae.envs.zombie import zombie_demonstrations
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.styles import Playstyles
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import about_run, split
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.source import Reading, Source
from tvae.experiments.using import act, imagine_style, open_run
from tvae.files import appearing
from tvae.generate.closed_loop import LatentPolicy
from tvae.generate.restless import Restless
from tvae.model.decoding import LatentSource, sampled
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import policy_windows
from tvae.train.loop import evaluate

SMALL = ["--training.num-steps", "30", "--training.evaluate-every", "10", "--model.hidden-features", "8"]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "zombie.parquet"
    tvae.save_demonstrations(zombie_demonstrations(80), path)
    return path


@pytest.fixture(scope="module")
def run(table: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "zombie"
    where = ["--env", "tvae/ZombieAttack-v0", "--episodes", "12"]
    call("fit", table, "--out", out, "--seed", "3", "--device", "cpu", *where, *SMALL)
    return out


def test_a_fit_leaves_everything_that_is_promised(run: Path) -> None:
    for name in (
        "config.json",
        "model.safetensors",
        "playstyles.json",
        "styles.parquet",
        "metrics.json",
        "history.json",
        "report.html",
        "checkpoint.safetensors",
        "tensorboard",
        "rollouts/style-0.parquet",
    ):
        assert (run / name).exists(), name
    assert not list(run.rglob("*.partial"))
    assert len({path.stat().st_mode for path in run.glob("*.*") if path.is_file()}) == 1
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["playstyles"]["num_found"] >= 1
    assert metrics["train_seconds"] > 0
    assert metrics["test_episodes"] == 12
    assert metrics["test_environment"] == "tvae/ZombieAttack-v0"
    assert 0 <= metrics["active_units"] <= 2
    assert all(0 <= share <= 1 for share in metrics["style_consistency"].values())
    assert len(metrics["style_consistency"]) == metrics["playstyles"]["num_found"]
    assert len(json.loads((run / "history.json").read_text())) > 1
    about = about_run(RunDirectory.existing(run))
    learnt, held_out = split(about.source.load(), about.config)
    size = suitable_batch_size(learnt.lengths)
    terms = evaluate(TrajectoryVAE.load(run), held_out, policy_windows, batch_size=size, seed=about.config.seed)
    assert metrics["nats_per_trajectory"]["held_out"] == pytest.approx(asdict(terms), abs=1e-4)
    config = json.loads((run / "config.json").read_text())
    assert config["schema_version"] == 4
    assert config["run"]["config"]["training"]["num_steps"] == 30
    assert config["run"]["config"]["seed"] == 3


def unexplained(metrics: dict[str, Any]) -> list[str]:
    """Keys of a run's metrics that docs/metrics.md does not have."""
    styles = metrics["playstyles"]["shares"]
    page = (Path(__file__).parent.parent / "docs" / "metrics.md").read_text(encoding="utf-8")

    def names(found: dict[str, Any], path: str = "") -> Iterator[str]:
        for key, value in found.items():
            name = "STYLE" if key in styles else "PART" if key in {"training", "held_out"} else key
            name = "METRIC" if path == "ci95." else name
            if isinstance(value, dict):
                yield from names(value, f"{path}{name}.")
            else:
                yield path + name

    return [name for name in names(metrics) if f"`{name}`" not in page]


def test_every_metric_is_explained(run: Path) -> None:
    metrics = json.loads((run / "metrics.json").read_text())
    assert unexplained(metrics) == []
    assert unexplained({**metrics, "new": {"number": 1.0}}) == ["new.number"]


def test_the_styles_table_has_one_row_per_episode(run: Path) -> None:
    styles = pq.read_table(run / "styles.parquet")
    assert styles.column_names == ["episode", "style", "probability", "z_0", "z_1", "log_likelihood_per_step"]
    assert styles["episode"].to_pylist() == list(range(80))
    assert np.isfinite(styles["log_likelihood_per_step"].to_numpy()).all()


def test_training_never_sees_the_labels(table: Path, run: Path, tmp_path: Path) -> None:
    demonstrations = tvae.load_demonstrations(table)
    shuffled = np.random.default_rng(0).permutation(demonstrations.attributes["label"])
    tvae.save_demonstrations(demonstrations.with_attributes({"label": shuffled}), tmp_path / "other.parquet")
    call("fit", tmp_path / "other.parquet", "--out", tmp_path / "run", "--seed", "3", "--device", "cpu", *SMALL)
    mine, other = (load_file(path / "model.safetensors") for path in (run, tmp_path / "run"))
    assert all((mine[name] == other[name]).all() for name in mine)


def test_verbs_work_on_a_finished_run(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call("styles", run, "--data", table, "--out", tmp_path / "labels.parquet")
    assert "what sets it apart" in capsys.readouterr().out
    assert len(pq.read_table(tmp_path / "labels.parquet")) == 80
    call("generate", run, "--episodes", "5", "--out", tmp_path / "imagined.csv")
    assert len(tvae.load_demonstrations(tmp_path / "imagined.csv")) == 5
    call("rollout", run, "--episodes", "7", "--most-likely", "--window", "3", "--out", tmp_path / "bot.parquet")
    acted = tvae.load_demonstrations(tmp_path / "bot.parquet")
    assert len(acted) == 7
    assert acted.action_space == tvae.load_demonstrations(table).action_space
    before = (run / "report.html").stat().st_mtime_ns
    call("report", run)
    assert (run / "report.html").stat().st_mtime_ns > before
    page = (run / "report.html").read_text()
    assert " in zombie.parquet</h1>" in page
    assert "80 sessions, " in page
    assert "signals; run zombie</p>" in page


def test_a_restless_bot_knows_the_runs_demonstrations_and_draws(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    class Watched(Restless):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            made.append((len(options["demonstrations"]), self.temperature, self.longest_rest))

    monkeypatch.setattr("tvae.cli.rollout.Restless", Watched)
    asked = ("rollout", run, "--episodes", "3", "--restless")
    call(*asked, "--out", tmp_path / "restless.parquet")
    call(*asked, "--temperature", "0.5", "--out", tmp_path / "cool.parquet")
    assert made == [(80, 1.0, 0), (80, 0.5, 0)]
    warm, cool = (tvae.load_demonstrations(tmp_path / name) for name in ("restless.parquet", "cool.parquet"))
    assert len(warm) == len(cool) == 3
    assert warm.num_steps != cool.num_steps or (warm.actions != cool.actions).any()
    said = refused(capsys, *asked, "--most-likely", "--out", tmp_path / "x.parquet")
    assert "--most-likely draws nothing, so that --restless cannot try something else" in said


def test_a_bot_of_several_styles_draws_among_them(run: Path, table: Path, tmp_path: Path) -> None:
    opened = open_run(run, "cpu")
    only = opened.findings.playstyles.styles[0]
    parts = tuple(
        replace(only, index=index, weight=weight, members=Posteriors(np.full((1, 2), mean), np.full((1, 2), 1e-3)))
        for index, weight, mean in ((0, 0.75, -1.0), (1, 0.25, 1.0))
    )
    playstyles = replace(opened.findings.playstyles, styles=parts, assignment=np.repeat([0, 1], [60, 20]))
    two = replace(opened, findings=replace(opened.findings, playstyles=playstyles, labels={1: "late"}))
    given: list[LatentSource] = []

    def bot(latents: LatentSource) -> LatentPolicy:
        given.append(latents)
        return LatentPolicy(opened.model, latents)

    for styles in (["late"], ["late", "0", "style 1"]):
        act(two, styles, replace(opened.arena(None), episodes=2), bot, seed=0, console=CONSOLE)
    assert given[0] is parts[1]
    assert (given[1].sample(2000, np.random.default_rng(0))[:, 0] < 0).mean() == pytest.approx(0.75, abs=0.04)

    demonstrations = tvae.load_demonstrations(table)
    firsts = demonstrations.observations[demonstrations.observation_starts]
    for styles, late, spread in ((["late"], 20, 0), (["0", "late"], 5, 4)):
        imagined = imagine_style(two, styles, 20, choice=sampled, window=None, seed=0)
        starts = imagined.observations[imagined.observation_starts]
        from_late = int((starts[:, None] == firsts[60:]).all(-1).any(1).sum())
        assert from_late == pytest.approx(late, abs=spread)

    call("rollout", run, "--style", "0", "--style", "0", "--episodes", "2", "--out", tmp_path / "bot.parquet")
    assert len(tvae.load_demonstrations(tmp_path / "bot.parquet")) == 2


def test_a_style_has_the_name_that_it_was_given(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "run"
    shutil.copytree(run, mine)
    before = (mine / "metrics.json").read_text()
    call("styles", mine, "--rename", "0=<campers>")
    assert "<campers>" in " ".join(capsys.readouterr().out.split())
    call("styles", mine)
    assert "<campers>" in capsys.readouterr().out
    call("generate", mine, "--style", "<campers>", "--episodes", "2", "--out", tmp_path / "imagined.csv")
    call("rollout", mine, "--style", "<campers>", "--episodes", "2", "--out", tmp_path / "bot.csv")
    call("report", mine)
    page = (mine / "report.html").read_text()
    assert "&lt;campers&gt;" in page
    assert "<campers>" not in page
    call("export", mine, "--out", tmp_path / "export")
    assert "<campers>" in (tmp_path / "export" / "manifest.json").read_text()
    call("embed", mine, "--out", tmp_path / "z.parquet")
    assert (mine / "metrics.json").read_text() == before
    assert "there is no style '9'" in refused(capsys, "styles", mine, "--rename", "9=x")
    assert "must be a line of text" in refused(capsys, "styles", mine, "--rename", "0=")
    assert json.loads((mine / "playstyles.json").read_text())["names"] == {"0": "<campers>"}
    call("fit", "--resume", "--out", mine, "--device", "cpu")
    assert json.loads((mine / "playstyles.json").read_text())["names"] == {"0": "<campers>"}


def test_styles_can_be_joined_and_parted_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walks, run, labelled = tmp_path / "walks.parquet", tmp_path / "run", tmp_path / "labelled.parquet"
    tvae.save_demonstrations(navigation_demonstrations(60), walks)
    small = ["--training.num-steps", "50", "--model.hidden-features", "16", "--policy.num-steps", "0"]
    call("fit", walks, "--out", run, "--device", "cpu", "--env", "tvae/Navigation-v0", "--episodes", "4", *small)
    found = Playstyles.load(run)
    assert len(found) == 3
    assert found.parts == ((0,), (1,), (2,))
    call("styles", run, "--rename", "1=others", "0=first")
    before = json.loads((run / "metrics.json").read_text())

    call("styles", run, "--join", "0", "2", "--data", walks, "--out", labelled)
    said = " ".join(capsys.readouterr().out.split())
    assert "2 styles (67 %, 33 % of the episodes), joined from 3" in said
    assert "others: 33% of the sessions" in said
    joined = Findings.from_json(json.loads((run / "playstyles.json").read_text()))
    assert joined.playstyles.parts == ((0, 2), (1,))
    assert joined.names == {1: "others"}
    assert (joined.playstyles.assignment == (found.assignment == 1)).all()
    for table in (labelled, run / "styles.parquet"):
        assert (pq.read_table(table)["style"].to_numpy() == joined.playstyles.assignment).all()
    assert sorted(path.name for path in (run / "rollouts").iterdir()) == ["style-0.parquet", "style-1.parquet"]
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics.keys() - before.keys() == {"leakage"}  # 20 episodes were too few for it, 40 are not
    keys = {joined.key(style) for style in joined.playstyles.styles}
    assert metrics["style_consistency"].keys() == metrics["playstyles"]["shares"].keys() == keys
    assert metrics["ci95"]["style_consistency"].keys() == keys
    assert "others" in (run / "report.html").read_text()
    assert "joined from 3" in (run / "report.html").read_text()

    call("fit", "--resume", "--out", run, "--device", "cpu")
    assert Findings.from_json(json.loads((run / "playstyles.json").read_text())).names == {1: "others"}
    assert Playstyles.load(run).parts == ((0, 2), (1,))
    assert "give it or --join" in refused(capsys, "styles", run, "--join", "0", "1", "--as-found")
    call("styles", run, "--as-found")
    assert (Playstyles.load(run).assignment == found.assignment).all()
    assert json.loads((run / "metrics.json").read_text()).keys() == before.keys()

    other = json.loads((run / "playstyles.json").read_text())
    other["playstyles"]["assignment"][0] += 1
    (run / "playstyles.json").write_text(json.dumps(other))
    assert "holds other styles than are found here" in refused(capsys, "styles", run, "--join", "0", "1")
    assert json.loads((run / "playstyles.json").read_text()) == other


def test_evaluate_compares_with_the_model_without_a_latent(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    call("evaluate", copy, "--episodes", "4", "--samples", "4", "--device", "cpu")
    metrics = json.loads((copy / "metrics.json").read_text())
    assert unexplained(metrics) == []
    found = metrics["held_out_likelihood"]
    low, high = found["difference"]["ci95"]
    assert low <= found["difference"]["mean"] <= high
    assert found["with_latent"] - found["without_latent"] == pytest.approx(found["difference"]["mean"])


def test_data_verbs(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call("data", "info", table)
    assert "80 episodes" in capsys.readouterr().out
    call("data", "convert", table, tmp_path / "zombie.csv")
    call("data", "validate", tmp_path / "zombie.csv")
    assert "is sound" in capsys.readouterr().out.replace("\n", " ")
    lines = (tmp_path / "zombie.csv").read_text().splitlines()
    (tmp_path / "broken.csv").write_text("\n".join([*lines[:4], *lines[5:]]))
    with pytest.raises(SystemExit) as stopped:
        call("data", "validate", tmp_path / "broken.csv")
    assert stopped.value.code == 1
    assert "gap" in capsys.readouterr().out


def test_recordings_as_they_come(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for day in ("monday", "tuesday"):
        rows = [f"{day},{p},{t},{t}.5,{t % 2 == 0},{t // 4}" for t in (0, 1, 3, 4, 6, 7) for p in ("anna", "bert")]
        rows[2] = rows[2].replace("1.5", "")
        text = "\n".join(["episode,player,t,observation.x,action.go,level", *rows])
        (tmp_path / f"{day}.csv").write_text(text + "\n")
    log = tmp_path / "*.csv"
    with pytest.raises(SystemExit):
        call("data", "validate", log, "--player", "player", "--time", "t")
    said = " ".join(capsys.readouterr().out.split())
    assert "episode monday/anna, step 2, column t: is 2 after the row before, but steps are 1 apart" in said
    assert "step 1, column observation.x: is missing or not a number (2 times)" in said
    rules = ["--player", "player", "--time", "t", "--every", "1", "--resample", "linear", "--missing", "hold"]
    call("data", "validate", log, *rules)
    call("data", "info", log, *rules, "--out", tmp_path / "pictures")
    assert "4 episodes, 32 steps" in capsys.readouterr().out
    assert (tmp_path / "pictures/overview.png").read_bytes().startswith(b"\x89PNG")
    for cut, lengths in (("--segment-by=level", [4, 4] * 4), ("--segment-at=action.go", [1, 4, 1, 1, 1] * 4)):
        call("data", "convert", log, tmp_path / "parts.parquet", *rules, cut, "--force")
        assert sorted(tvae.load_demonstrations(tmp_path / "parts.parquet").lengths) == sorted(lengths)
    call("data", "convert", log, tmp_path / "dropped.tvae", *rules[:-1], "drop")
    assert tvae.load_demonstrations(tmp_path / "dropped.tvae").attributes["player"].tolist() == ["bert", "bert"]
    assert "are cut one way" in refused(capsys, "data", "info", log, *rules, "--segment", "2", "--segment-by", "level")
    assert "by a column with the time" in refused(capsys, "data", "info", log, "--resample", "hold")
    assert "needs to be above 0, got 0.0" in refused(capsys, "data", "info", log, "--time", "t", "--every", "0")


def test_a_source_is_found_and_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    reading = Reading(angular=("action.a",), only=("action",), time="t", resample="hold", segment_at="action.a")
    for path, found in (("days/*.csv", str(tmp_path / "days/*.csv")), ("studio/walks-v0", "studio/walks-v0")):
        source = Source(path, reading).absolute()
        assert source.path == found
        assert Source.from_json(json.loads(json.dumps(asdict(source)))) == source
    earlier = {"path": "a.csv", "angular": ["action.a"], "continuous": [], "categorical": [], "segment": 5}
    assert Source.from_json(earlier) == Source("a.csv", Reading(angular=("action.a",), segment=5))


def test_options_from_a_file(table: Path, tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("seed: 5\ntraining:\n  num_steps: 10\nmodel:\n  hidden_features: 8\n")
    call("--config", tmp_path / "run.yaml", "fit", table, "--out", tmp_path / "run", "--training.num-steps", "4")
    config = json.loads((tmp_path / "run/config.json").read_text())["run"]["config"]
    assert (config["seed"], config["training"]["num_steps"]) == (5, 4)
    assert config["model"]["hidden_features"] == 8


def test_an_existing_directory_is_never_overwritten_without_force(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run / "config.json").read_bytes()
    assert "exists already" in refused(capsys, "fit", table, "--out", run, *SMALL)
    assert (run / "config.json").read_bytes() == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("years of work")
    said = refused(capsys, "fit", table, "--out", tmp_path / "mine", "--force", *SMALL)
    assert "is not a run directory" in said
    assert (tmp_path / "mine/thesis.txt").exists()
    assert "exists already" in refused(capsys, "data", "convert", table, table)


def test_bad_data_makes_no_directory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.csv").write_text("episode,step,observation.x,action.a\n0,0,1.0,0.5\n0,1,nan,0.5\n")
    said = refused(capsys, "fit", tmp_path / "bad.csv", "--out", tmp_path / "run")
    assert "episode 0, step 1" in said
    assert "observation.x" in said
    assert not (tmp_path / "run").exists()


def test_a_column_that_is_missing_at_fit_or_later_is_named(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    narrow = pq.read_table(table).drop_columns(["observation.distance_to_zombie"])
    pq.write_table(narrow.replace_schema_metadata(None), tmp_path / "narrow.parquet")
    assert "distance_to_zombie" in refused(capsys, "styles", run, "--data", tmp_path / "narrow.parquet")
    said = refused(
        capsys, "fit", table, "--out", tmp_path / "run", "--angular", "observation.wind_direction", *SMALL
    )
    assert "observation.wind_direction" in said


def test_an_environment_that_does_not_fit_is_refused_in_words(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "rollout", run, "--env", "tvae/Navigation-v0", "--out", tmp_path / "x.parquet")
    assert "4 signals against 2" in said
    assert "Nowhere" in refused(capsys, "rollout", run, "--env", "Nowhere-v3", "--out", tmp_path / "x.parquet")
    assert not (tmp_path / "x.parquet").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--model.window", "0"], "model.window must be at least 1, got 0"),
        (["--model.latent-features", "-1"], "model.latent_features must be at least 0, got -1"),
        (["--model.dropout", "1.5"], "model.dropout must be at least 0 and below 1, got 1.5"),
        (["--training.batch-size", "0"], "training.batch_size must be at least 1, got 0"),
        (["--training.learning-rate", "nan"], "training.learning_rate must be above 0, got nan"),
        (["--training.clip", "0"], "training.clip must be above 0, got 0.0"),
        (["--training.held-out", "0"], "training.held_out must lie between 0 and 1, got 0.0"),
        (["--policy.num-steps", "-1"], "policy.num_steps must be at least 0, got -1"),
        (["--policy.learning-rate", "-1"], "policy.learning_rate must be above 0, got -1.0"),
        (["--segment", "0"], "segments need at least 1 step, got 0"),
        (["--seed", "4294967296"], "Must be < 4294967296"),
    ],
)
def test_a_training_that_cannot_be_leaves_an_older_run_alone(
    run: Path, table: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*")}
    assert said in refused(capsys, "fit", table, "--out", run, "--force", *options)
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*")} == before


def test_directories_of_others_are_left_alone(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    app = tmp_path / "app"
    app.mkdir()
    (app / "config.json").write_text('{"name": "my app"}')
    said = refused(capsys, "fit", table, "--out", app, "--force", *SMALL)
    assert "app is not a run directory (no config.json of a run), so --force leaves it alone" in said
    assert (app / "config.json").read_text() == '{"name": "my app"}'
    mine = tmp_path / "run"
    shutil.copytree(run, mine)
    shutil.copy(table, mine / "zombie.parquet")
    said = refused(capsys, "fit", mine / "zombie.parquet", "--out", mine, "--force", *SMALL)
    assert "holds what is to be read" in said
    assert (mine / "zombie.parquet").exists()
    app = app.rename(tmp_path / "app.parquet")
    assert "app.parquet is a directory" in refused(capsys, "embed", run, "--out", app, "--force")
    with (
        pytest.raises(FileExistsError, match="is a directory, and a file cannot take its place"),
        appearing(app, overwrite=True) as partial,
    ):
        partial.write_text("a table")
    assert [path.name for path in app.iterdir()] == ["config.json"]


def test_a_run_whose_data_changed_says_so(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, run = tmp_path / "walks.parquet", tmp_path / "run"
    walks = two_styles(20)
    tvae.save_demonstrations(walks, data)
    small = ["--training.num-steps", "5", "--policy.num-steps", "0", "--model.hidden-features", "8"]
    call("fit", data, "--out", run, "--device", "cpu", *small)
    call("generate", run, "--episodes", "2", "--out", tmp_path / "before.parquet")
    turned = walks.select(np.roll(np.arange(20), 1))
    tvae.save_demonstrations(turned, data, overwrite=True)
    for command in (
        ["generate", run, "--episodes", "2", "--out", tmp_path / "after.parquet"],
        ["report", run],
        ["evaluate", run],
        ["fit", "--resume", "--out", run],
        ["styles", run, "--join", "0", "0"],
        ["embed", run, "--out", tmp_path / "after.parquet"],
        ["score", run, "--out", tmp_path / "after.parquet"],
        ["similar", run, "0"],
    ):
        said = refused(capsys, *command)
        assert "has changed since" in said or "--join needs two styles" in said
    assert not (tmp_path / "after.parquet").exists()
    call("score", run, data, "--out", tmp_path / "theirs.parquet")  # sessions that are named may be any
    tvae.save_demonstrations(walks, data, overwrite=True)
    call("report", run)
    said = refused(capsys, "evaluate", run, "--episodes", "5")
    assert "name it with --env" in said


def test_an_environment_of_ones_own_is_imported_only_when_named(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mygame.py").write_text(
        "import gymnasium\n"
        "gymnasium.register('Mine-v0', entry_point='tvae.envs.zombie:ZombieAttackEnv')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    call("rollout", run, "--env", "mygame:Mine-v0", "--episodes", "2", "--out", tmp_path / "bot.parquet")
    assert len(tvae.load_demonstrations(tmp_path / "bot.parquet")) == 2
    said = refused(capsys, "rollout", run, "--env", "nothing:Mine-v0", "--out", tmp_path / "no.parquet")
    assert "the environment nothing:Mine-v0 needs the module nothing" in said
    mine = tmp_path / "run"
    shutil.copytree(run, mine)
    config = json.loads((mine / "config.json").read_text())
    config["run"]["arena"]["env"] = "evilmod:Mine-v0"
    (mine / "config.json").write_text(json.dumps(config))
    said = refused(capsys, "rollout", mine, "--out", tmp_path / "no.parquet")
    assert "evilmod:Mine-v0 is code of its own; say that it may run: --env evilmod:Mine-v0" in said


def test_what_is_asked_of_a_run_must_be_there(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no style 'sneaky'" in refused(capsys, "generate", run, "--style", "sneaky", "--out", tmp_path / "x.csv")
    assert "device must be" in refused(capsys, "styles", run, "--device", "quantum")
    assert "is not there" in refused(capsys, "fit", table, "--out", tmp_path / "new", "--device", "cuda:99")
    assert "no attribute" in refused(capsys, "fit", table, "--out", tmp_path / "new", "--group", "team")
    assert not (tmp_path / "new").exists()
    assert "is not a run directory" in refused(capsys, "styles", tmp_path)
    assert "needs a data set" in refused(capsys, "fit", "--out", tmp_path / "new")
    assert "reads no file" in refused(capsys, "demo", "--data", table, "--out", tmp_path / "new")
    assert "is not there" in refused(capsys, "demo", "pusht", "--data", tmp_path / "no.npz", "--out", tmp_path / "p")
    assert "--config needs" in refused(capsys, "--config", tmp_path / "run.ini", "styles", run)
    for text, said in (("training: [1, 2]", "got [1, 2]"), ("model: 8", "model needs options below it")):
        (tmp_path / "run.yaml").write_text(text)
        assert said in refused(capsys, "--config", tmp_path / "run.yaml", "fit", "x.csv", "--out", tmp_path / "new")


def test_a_truncated_model_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    weights = (copy / "model.safetensors").read_bytes()
    (copy / "model.safetensors").write_bytes(weights[: len(weights) // 2])
    assert "truncated" in refused(capsys, "styles", copy)


def test_help_shows_an_example_of_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    verbs = [["demo"], ["fit"], ["styles"], ["generate"], ["rollout"], ["evaluate"], ["report"], ["embed"]]
    verbs += [["score"], ["similar"], ["export"]]
    verbs += [["data", verb] for verb in ("info", "validate", "convert", "make")]
    for verb in verbs:
        call(*verb, "--help")
        assert f"tvae {' '.join(verb)}" in capsys.readouterr().out.split("Example")[1], verb


def start(arguments: Sequence[str | Path]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tvae", *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "GOMP_SPINCOUNT": "2000"}
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def test_a_run_killed_three_times_ends_in_the_same_weights(table: Path, tmp_path: Path) -> None:
    small = ["--training.num-steps", "160", "--training.evaluate-every", "5", "--model.hidden-features", "8"]
    straight, killed = tmp_path / "straight", tmp_path / "killed"
    first = start(["fit", table, "--out", straight, "--device", "cpu", *small])
    first.communicate()
    assert first.returncode == 0
    rng = random.Random(0)
    process = start(["fit", table, "--out", killed, "--device", "cpu", *small])
    for _ in range(3):
        checkpoint = killed / "checkpoint.safetensors"
        seen = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
        while process.poll() is None and (not checkpoint.exists() or checkpoint.stat().st_mtime_ns == seen):
            time.sleep(0.005)
        time.sleep(rng.uniform(0, 0.1))
        assert process.poll() is None, "it ended before it could be killed"
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert not (killed / "model.safetensors").exists()
        process = start(["fit", "--out", killed, "--resume", "--device", "cpu"])
    _, said = process.communicate()
    assert process.returncode == 0, said.decode()
    mine, other = (load_file(path / "model.safetensors") for path in (straight, killed))
    assert mine.keys() == other.keys()
    assert all((mine[name] == other[name]).all() for name in mine)


def test_a_target_that_cannot_be_is_refused_in_one_line(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("mine")
    for target in (tmp_path / "file" / "z.parquet", tmp_path / "file" / "run"):
        verb = ["embed", run] if target.suffix else ["fit", table, *SMALL]
        said = refused(capsys, *verb, "--out", target)
        assert said.startswith("tvae: ")
        assert "Traceback" not in said

    def forbidden(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", "runs")

    monkeypatch.setattr("tvae.cli.report.write_report", forbidden)
    assert refused(capsys, "report", run) == "tvae: [Errno 13] Permission denied: 'runs'\n"


def test_a_path_is_printed_as_it_is(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "my [bold] dir" / "ru[" / "n] 1"
    shutil.copytree(run, mine)
    out = mine.parent
    call("report", mine)
    call("styles", mine, "--data", mine / "rollouts/style-0.parquet", "--out", out / "labels.parquet")
    call("generate", mine, "--episodes", "2", "--out", out / "imagined.csv")
    call("rollout", mine, "--episodes", "2", "--out", out / "bot.csv")
    call("export", mine, "--out", out / "export")
    said = "".join(capsys.readouterr().out.split())
    for name in ("n] 1/report.html", "labels.parquet", "imagined.csv", "bot.csv", "export/manifest.json"):
        assert f"{out}/{name}".replace(" ", "") in said, name


def test_names_that_the_output_cannot_hold_are_shown_by_their_codes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = "episode,step,observation.体,action.a\n0,0,1.0,0.5\n0,1,2.0,0.5\n"
    (tmp_path / "a.csv").write_text(rows, encoding="utf-8")
    out = io.TextIOWrapper(io.BytesIO(), encoding="cp1252")
    monkeypatch.setattr(sys, "stdout", out)
    call("data", "info", tmp_path / "a.csv")
    out.flush()
    assert "observation.\\u4f53" in out.buffer.getvalue().decode("cp1252")  # type: ignore[attr-defined]


def test_a_report_needs_no_dates_that_only_some_systems_can_write(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class OfWindows(datetime):
        def strftime(self, form: str) -> str:  # type: ignore[override]
            if "%-" in form:
                raise ValueError("Invalid format string")
            return super().strftime(form)

    monkeypatch.setattr("tvae.experiments.reporting.datetime", OfWindows)
    call("report", run)
    assert f"{datetime.now(UTC):%Y}" in (run / "report.html").read_text()


def test_a_target_is_refused_before_the_work(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("it began")

    for verb in ("generate", "rollout", "styles"):
        monkeypatch.setattr(f"tvae.cli.{verb}.open_run", work)
    monkeypatch.setattr(import_module("tvae.cli.data"), "Source", work)
    for name in ("there.csv", "there.csv.schema.json", "there.parquet", "there.tvae"):
        (tmp_path / name).write_text("mine")
    tables = ["styles", str(run), "--data", str(table), "--out"]
    acting = [[verb, str(run), "--out"] for verb in ("generate", "rollout")]
    for verb in (*acting, ["data", "convert", str(table)], tables):
        assert "needs to end with" in refused(capsys, *verb, tmp_path / "x.txt")
        assert "exists already" in refused(capsys, *verb, tmp_path / "there.csv")
        assert "exists already" in refused(capsys, *verb, tmp_path / "there.parquet")
        assert "there.csv is a file" in refused(capsys, *verb, tmp_path / "there.csv" / "deep" / "x.csv")
        if verb != tables:
            assert "exists already" in refused(capsys, *verb, tmp_path / "there.tvae")
            assert "exists already" in refused(capsys, *verb, f"minari:{tmp_path}")
    (tmp_path / "there.csv").unlink()
    assert "there.csv.schema.json exists already" in refused(capsys, "rollout", run, "--out", tmp_path / "there.csv")


def test_an_option_that_lacks_another_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "in --data: name them, too" in refused(capsys, "styles", run, "--out", tmp_path / "labels.parquet")
    assert "with --join or --as-found" in refused(capsys, "styles", run, "--env", "tvae/ZombieAttack-v0")


@pytest.mark.parametrize(
    "command",
    [
        "generate RUN --out x.csv --episodes 0",
        "generate RUN --out x.csv --episodes -1",
        "generate RUN --out x.csv --window 0",
        "rollout RUN --out x.csv --episodes 0",
        "rollout RUN --out x.csv --window 0",
        "evaluate RUN --samples 0",
        "evaluate RUN --episodes 0",
        "fit x.csv --out RUN --env tvae/ZombieAttack-v0 --episodes 0",
        *(f"{verb} --seed -1" for verb in ("fit x.csv --out RUN", "demo", "data make zombie", "benchmark --out x")),
        *(f"{verb} --seed -1" for verb in ("generate RUN --out x", "rollout RUN --out x", "evaluate RUN")),
    ],
)
def test_a_number_that_cannot_be_is_refused(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    option, value = command.split()[-2:]
    assert f'Invalid value "{value}" for {option}' in refused(capsys, *command.split())


def test_a_run_goes_on_as_it_was_configured(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    going: list[str] = []
    for verb in ("fit", "demo"):
        monkeypatch.setattr(f"tvae.cli.{verb}.complete", lambda *_, **__: going.append("on"))
    resumed = ["fit", "--resume", "--out", str(run)]
    env = ["--env", "tvae/ZombieAttack-v0", "--episodes", "12"]
    call(*resumed)
    call(*resumed, "--data", table, "--seed", "3", *SMALL, *env)
    call(*resumed, "--model.hidden-features", "64")  # as by default, which may not have been said
    call(*resumed, "--policy.num-steps", "30")  # nobody said it, but it is what it came to
    call("demo", "--resume", "--out", run, "--seed", "3")
    assert len(going) == 5
    for options, words in (
        (["--seed", "4"], "--seed 4 (there: 3)"),
        (["--training.num-steps", "31"], "--training.num-steps 31 (there: 30)"),
        (["--model.no-stop"], "--model.stop False (there: True)"),
        (["--policy.batch-size", "5"], "--policy.batch-size 5 (there: 1024)"),
        (["--group", "team"], "--group team (there: None)"),
        (["--angular", "action.heading"], "--angular action.heading (there: )"),
        (["--data", str(tmp_path)], f"the data set {tmp_path} (there: {table})"),
        (["--env", "tvae/Circle-v0"], "--env tvae/Circle-v0 (there: tvae/ZombieAttack-v0)"),
        (["--episodes", "13"], "--episodes 13 (there: 12)"),
    ):
        said = refused(capsys, *resumed, *options)
        assert words in said
        assert "another --out" in said
    demo = ["demo", "--resume", "--out", str(run)]
    assert "--seed 4 (there: 3)" in refused(capsys, *demo, "--seed", "4")
    assert f"the task Circle (there: {run.name})" in refused(capsys, "demo", "circle", *demo[1:])
    assert f"the data set {tmp_path} (there: {table})" in refused(capsys, *demo, "--data", tmp_path)
    for verb in (resumed, ["demo", "--resume", "--out", str(run)]):
        assert "give one of them, not both" in refused(capsys, *verb, "--force")
    said = refused(capsys, "fit", table, "--out", tmp_path / "new", "--episodes", "5")
    assert "name it with --env" in said
    assert len(going) == 5


def test_a_damaged_run_is_refused_in_words(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "run"
    shutil.copytree(run, mine)

    def damaged(name: str, content: bytes, *verbs: str) -> Iterator[str]:
        whole = (mine / name).read_bytes()
        (mine / name).write_bytes(content)
        for verb in verbs:
            out = {"generate": ["--out", "x.csv"], "embed": ["--out", "z.csv"], "export": ["--out", "onnx"]}
            yield refused(capsys, verb, mine, *out.get(verb, []))
        (mine / name).write_bytes(whole)

    later = json.loads((mine / "playstyles.json").read_text())
    later["playstyles"]["schema_version"] = 99
    for said in damaged(
        "playstyles.json", json.dumps(later).encode(), "styles", "generate", "report", "embed", "export"
    ):
        assert "playstyles.json does not hold playstyles: needs format tvae-playstyles, schema version 1" in said
    for said in damaged("playstyles.json", b"[]", "styles", "report"):
        assert "playstyles.json does not hold playstyles" in said
    styles = (mine / "styles.parquet").read_bytes()
    for content in (b"", styles[: len(styles) // 2]):
        for said in damaged("styles.parquet", content, "report"):
            assert "styles.parquet is not whole" in said
    pq.write_table(pq.read_table(mine / "styles.parquet").slice(0, 3), tmp_path / "few.parquet")
    for said in damaged("styles.parquet", (tmp_path / "few.parquet").read_bytes(), "report"):
        assert "a row for each of 80 sessions, got 3 rows of episode, style" in said
    for content in (b"{}", b"[]"):
        for said in damaged("metrics.json", content, "report"):
            assert "metrics.json is not whole: it has no playstyles" in said
    for said in damaged("metrics.json", b"[]", "evaluate"):
        assert "metrics.json is not whole: it needs names with numbers, got list" in said
    for content in (b"{", b'{"step": 0}', b"[{}]", b'[{"step": 0, "beta": 1, "training": {}, "held_out": {}}]'):
        for said in damaged("history.json", content, "report"):
            assert "history.json is not whole" in said
    call("report", mine)
