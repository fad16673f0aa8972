"""The analysts' verbs: a vector, scores and neighbours of each session, of a run and of a shipped model."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

import tvae
from commands import call, refused
from tvae.envs.zombie import zombie_demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.scores import score
from tvae.evaluate.similarity import distances
from tvae.pretrained import pretrained_directory

SMALL = ["--training.num-steps", "4", "--training.evaluate-every", "2", "--model.hidden-features", "8"]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sessions whose names, labels and attributes ask for trouble."""
    demonstrations = zombie_demonstrations(40)
    facts = {
        "episode": np.array([f"[red]s{index}" for index in range(40)]),
        "style": np.array([f"mine {index % 3}" for index in range(40)]),
    }
    path = tmp_path_factory.mktemp("data") / "zombie.parquet"
    tvae.save_demonstrations(demonstrations.with_attributes(facts), path)
    return path


@pytest.fixture(scope="module")
def run(table: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "zombie"
    call("fit", table, "--out", out, "--device", "cpu", *SMALL)
    return out


def test_embed_writes_a_row_per_session(run: Path, table: Path, tmp_path: Path) -> None:
    call("embed", run, table, "--out", tmp_path / "z.parquet")
    found = pq.read_table(tmp_path / "z.parquet")
    ours = ["z_0", "z_1", "scale_0", "scale_1", "style", "probability"]
    assert found.column_names[0] == "episode"
    assert found.column_names[-6:] == ours
    assert {"label", "recorded.style"} < set(found.column_names)
    demonstrations = tvae.load_demonstrations(table)
    assert found["episode"].to_pylist() == demonstrations.attributes["episode"].tolist()
    assert found["recorded.style"].to_pylist() == demonstrations.attributes["style"].tolist()
    posteriors = encode(tvae.TrajectoryVAE.load(run), demonstrations)
    np.testing.assert_allclose(np.stack([found["z_0"], found["z_1"]], 1), posteriors.means, atol=1e-6)
    np.testing.assert_allclose(np.stack([found["scale_0"], found["scale_1"]], 1), posteriors.scales, atol=1e-6)
    styles = pq.read_table(run / "styles.parquet")
    assert found["style"].to_pylist() == styles["style"].to_pylist()
    np.testing.assert_allclose(found["probability"], styles["probability"], atol=1e-6)


def test_score_writes_a_row_per_step(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call("score", run, table, "--out", tmp_path / "scores.parquet", "--count", "3")
    said = capsys.readouterr().out
    assert "sessions least like the run's held-out demonstrations" in said
    assert "[red]s" in said
    found = pq.read_table(tmp_path / "scores.parquet")
    demonstrations = tvae.load_demonstrations(table)
    signals = [f"action.{name}" for name in demonstrations.action_space.names]
    signals += ["state", *(f"observation.{name}" for name in demonstrations.observation_space.names)]
    assert found.column_names == ["episode", "step", "action", *signals, "end", "event.attack"]
    assert len(found) == demonstrations.num_steps
    scores = score(tvae.TrajectoryVAE.load(run), demonstrations)
    by_session = {name: np.flatnonzero(np.array(found["episode"]) == name) for name in found["episode"].to_pylist()}
    for index, (name, rows) in enumerate(by_session.items()):
        assert name == demonstrations.attributes["episode"][index]
        part = found.take(rows)
        assert part["step"].to_pylist() == list(range(len(rows)))
        assert part["event.attack"].null_count == len(rows) - 1
        policy = sum(part["action"].to_pylist()) + part["event.attack"][0].as_py()
        assert policy == pytest.approx(scores.policy_term[index], abs=1e-4)
        state = sum(value for value in part["state"].to_pylist() if value is not None)
        assert state == pytest.approx(scores.state_term[index], abs=1e-4)
    assert found["state"].null_count == (~demonstrations.final_observed).sum()


def test_score_finds_the_session_that_was_tampered_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    demonstrations = zombie_demonstrations(60, seed=5)
    actions = np.array(demonstrations.actions)
    heading = demonstrations.action_space.column("heading")
    row = int(demonstrations.action_starts[17]) + 2
    actions[row, heading] += np.pi
    broken = tvae.Demonstrations(
        demonstrations.observation_space,
        demonstrations.action_space,
        demonstrations.observations,
        actions,
        demonstrations.observation_starts,
        demonstrations.action_starts,
        demonstrations.lengths,
        demonstrations.final_observed,
        {},
        demonstrations.attributes,
    )
    tvae.save_demonstrations(broken, tmp_path / "broken.parquet")
    call("score", "zombie", tmp_path / "broken.parquet", "--out", tmp_path / "scores.parquet", "--count", "1")
    said = capsys.readouterr().out
    assert "these sessions themselves" in said
    places = said.split("least likely steps of all")[1]
    words = places.replace("│", " ").split()
    assert words[words.index("17") + 1] == "2"
    assert "heading" in places


def test_similar_lists_the_nearest_sessions(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call("similar", run, table, "[red]s7", "--count", "4", "--out", tmp_path / "near.parquet")
    assert "[red]s" in capsys.readouterr().out
    found = pq.read_table(tmp_path / "near.parquet")
    assert len(found) == 4
    demonstrations = tvae.load_demonstrations(table)
    apart = distances(encode(tvae.TrajectoryVAE.load(run), demonstrations), 7)
    apart[7] = np.inf
    names = demonstrations.attributes["episode"]
    assert found["episode"].to_pylist() == names[np.argsort(apart, kind="stable")[:4]].tolist()
    np.testing.assert_allclose(found["overlap"], np.exp(-np.array(found["distance"])))
    call("similar", run, "[red]s7", "--count", "4", "--out", tmp_path / "own.parquet")
    assert pq.read_table(tmp_path / "own.parquet").equals(found)


def test_neighbours_under_a_shipped_model_play_the_same_style(tmp_path: Path) -> None:
    tvae.save_demonstrations(zombie_demonstrations(60, seed=5), tmp_path / "new.csv")
    labels = zombie_demonstrations(60, seed=5).attributes["label"]
    call("similar", "zombie", tmp_path / "new.csv", "17", "--count", "10", "--out", tmp_path / "near.parquet")
    near = pq.read_table(tmp_path / "near.parquet")
    assert set(near["label"].to_pylist()) == {labels[17]}
    call("embed", "zombie", tmp_path / "new.csv", "--out", tmp_path / "z.parquet")
    assert len(pq.read_table(tmp_path / "z.parquet")) == 60


def test_what_cannot_be_is_said(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "similar", run, table, "nobody")
    assert "no session 'nobody'; there are 40: [red]s0, [red]s1" in said
    assert "to [red]s39" in said
    narrow = pq.read_table(table).drop_columns(["observation.distance_to_zombie"]).replace_schema_metadata(None)
    pq.write_table(narrow, tmp_path / "narrow.parquet")
    out, new = tmp_path / "out.parquet", tmp_path / "new.parquet"
    for verb in (["embed", "--out", str(out)], ["score", "--out", str(out)], ["similar", "[red]s7"]):
        said = refused(capsys, verb[0], run, tmp_path / "narrow.parquet", *verb[1:])
        assert "column observation.distance_to_zombie: is missing; there are observation.distance_to_goal" in said
    assert not out.exists()
    assert not list(tmp_path.glob(".*partial"))
    out.write_text("mine")
    for verb in ("embed", "score"):
        assert "exists already" in refused(capsys, verb, run, table, "--out", out)
        assert "knows no sessions: name a data set" in refused(capsys, verb, "zombie", "--out", new)
        assert "there is no model 'chess'" in refused(capsys, verb, "chess", "--out", new)
    assert out.read_text() == "mine"
    call("embed", run, "--out", out, "--force")
    assert len(pq.read_table(out)) == 40
    shutil.copytree(pretrained_directory("zombie"), tmp_path / "model")
    (tmp_path / "model/playstyles.json").unlink()
    assert "holds no playstyles" in refused(capsys, "embed", tmp_path / "model", table, "--out", new)
    call("score", tmp_path / "model", table, "--out", new)


def test_a_table_is_what_its_name_says(
    run: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verbs = ("embed", run), ("score", run), ("similar", run, "[red]s7"), ("styles", run, "--data", table)
    for verb in verbs:
        call(*verb, "--out", tmp_path / f"{verb[0]}.csv")
        call(*verb, "--out", tmp_path / f"{verb[0]}.parquet")
        written = pq.read_table(tmp_path / f"{verb[0]}.parquet")
        text = pa_csv.read_csv(tmp_path / f"{verb[0]}.csv")
        assert text.column_names == written.column_names
        assert text["episode"].to_pylist() == written["episode"].to_pylist()
        assert "needs to end with .parquet or .csv" in refused(capsys, *verb, "--out", tmp_path / "z.xlsx")
        (tmp_path / "folder.csv").mkdir(exist_ok=True)
        assert "is a directory" in refused(capsys, *verb, "--out", tmp_path / "folder.csv", "--force")
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix not in {".csv", ".parquet"}) == []


def test_a_file_that_is_one_session_is_read_with_its_directory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demonstrations = zombie_demonstrations(24)
    tvae.save_demonstrations(demonstrations, tmp_path / "all.parquet")
    rows = pq.read_table(tmp_path / "all.parquet").replace_schema_metadata(None)
    for folder in ("old", "new"):
        (tmp_path / folder).mkdir()
    for index in range(24):
        one = rows.filter(pc.equal(rows["episode"], index)).drop_columns(["episode"])
        pa_csv.write_csv(one, tmp_path / ("new" if index == 23 else "old") / f"s{index}.csv")
    call("fit", tmp_path / "old", "--out", tmp_path / "run", "--device", "cpu", *SMALL)
    one = tmp_path / "new" / "s23.csv"
    for options in (["embed", str(tmp_path / "run"), str(one)], ["styles", str(tmp_path / "run"), "--data", str(one)]):
        said = refused(capsys, *options, "--out", tmp_path / "z.csv")
        assert "needs a column 'episode'" in said
        assert f"give {tmp_path / 'new'}" in said
    call("embed", tmp_path / "run", tmp_path / "new", "--out", tmp_path / "z.csv")
    assert len(pa_csv.read_csv(tmp_path / "z.csv")) == 1
