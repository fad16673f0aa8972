"""Angles that were recorded in degrees."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import call, refused
from data_strategies import assert_same, quick
from tvae.data.arrays import from_arrays
from tvae.data.estimates import interpolate
from tvae.data.preparation import Preparation
from tvae.data.roles import Roles
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.trajectory import DataError
from tvae.data.validation import examine_source, summarise, validate
from tvae.experiments.remedies import options_for
from tvae.experiments.source import Reading, Source
from tvae.spaces import Angular, Continuous, Space

ROWS: dict[str, list[Any]] = {
    "episode": [0, 0, 0],
    "step": [0, 1, 2],
    "observation.heading": [0, 90, 360],
    "observation.x": [90.0, 180.0, 270.0],
    "action.turn": [90.0, -45.0, 0.0],
}
IN_DEGREES = Preparation(degrees=("heading", "action.turn"))


def test_they_are_read_in_radians() -> None:
    kept = load_demonstrations(pa.table(ROWS), preparation=IN_DEGREES)
    assert kept.observation_space.signals == (Angular("heading", recorded_in_degrees=True), Continuous("x"))
    assert kept.action_space.signals == (Angular("turn", recorded_in_degrees=True),)
    np.testing.assert_allclose(kept.observations, [[0, 90], [np.pi / 2, 180], [2 * np.pi, 270]])
    np.testing.assert_allclose(kept.actions[:, 0], [np.pi / 2, -np.pi / 4, 0])
    assert_same(kept, load_demonstrations(pa.table(ROWS), angular=["heading"], preparation=IN_DEGREES))


@quick
@given(values=st.lists(st.floats(-720, 720), min_size=1, max_size=20))
def test_they_are_what_numpy_makes_of_them(values: list[float]) -> None:
    count = len(values)
    rows = {"episode": [0] * count, "step": range(count), "observation.h": values, "action.a": [0.5] * count}
    kept = load_demonstrations(pa.table(rows), preparation=Preparation(degrees=("*.h",)))
    np.testing.assert_allclose(kept.observations[:, 0], np.deg2rad(values))


def test_missing_text_and_integers() -> None:
    rows = {**ROWS, "observation.heading": ["350", "lost", "10"]}
    preparation = Preparation(degrees=("heading",), nulls=("lost",), missing=interpolate)
    kept = load_demonstrations(pa.table(rows), preparation=preparation)
    np.testing.assert_allclose(np.exp(1j * kept.observations[:, 0]), np.exp(1j * np.deg2rad([350, 0, 10])))
    (issue,) = validate(pa.table(rows), preparation=Preparation(degrees=("heading",)))
    assert issue.column == "observation.heading"
    assert issue.message.startswith("is no number, got 'lost'")


def test_by_their_own_names() -> None:
    own = {"match": [0, 0], "t": [0, 1], "yaw": [180, 90], "aim": [45, 90]}
    preparation = Preparation(roles=Roles("match", "t", ("aim",)), degrees=("aim", "yaw"))
    kept = load_demonstrations(pa.table(own), preparation=preparation)
    np.testing.assert_allclose(kept.observations[:, 0], [np.pi, np.pi / 2])
    np.testing.assert_allclose(kept.actions[:, 0], [np.pi / 4, np.pi / 2])


@pytest.mark.parametrize(
    ("degrees", "kinds", "message"),
    [
        (("yaw",), {}, "column yaw: was given a kind, but is no column of a signal; these are: observation.heading"),
        (("heading",), {"continuous": ["heading"]}, "heading: is said to be an angle in degrees, and of another kind"),
        (("room",), {}, "column observation.room: cannot be angular: needs numbers, got string"),
    ],
)
def test_what_cannot_be(degrees: tuple[str, ...], kinds: dict[str, list[str]], message: str) -> None:
    rows = pa.table({**ROWS, "observation.room": ["a", "b", "a"]})
    with pytest.raises(DataError, match=message):
        load_demonstrations(rows, preparation=Preparation(degrees=degrees), **kinds)  # type: ignore[arg-type]


FORMS = ["{}/a.parquet", "{}/a.csv", "{}/a.tvae", "minari:{}/a"]
CONVERTED = "column observation.heading: is said to be in degrees, but these have been converted to radians already"


@pytest.mark.parametrize("form", FORMS)
def test_what_is_converted_is_not_converted_again(tmp_path: Path, form: str) -> None:
    kept = load_demonstrations(pa.table(ROWS), preparation=IN_DEGREES)
    save_demonstrations(kept, form.format(tmp_path))
    assert_same(load_demonstrations(form.format(tmp_path)), kept)
    assert_same(load_demonstrations(form.format(tmp_path), angular=["heading"]), kept)
    with pytest.raises(DataError, match=CONVERTED):
        load_demonstrations(form.format(tmp_path), preparation=IN_DEGREES)
    spaces = {"observation_space": kept.observation_space, "action_space": kept.action_space}
    assert_same(load_demonstrations(form.format(tmp_path), preparation=IN_DEGREES, **spaces), kept)
    as_number = load_demonstrations(form.format(tmp_path), continuous=["heading"])
    assert as_number.observation_space.signals[0] == Continuous("heading")


@pytest.mark.parametrize("form", FORMS)
def test_files_without_the_note_are_in_radians(tmp_path: Path, form: str) -> None:
    kept = load_demonstrations(pa.table(ROWS), angular=["heading", "turn"])
    save_demonstrations(kept, form.format(tmp_path))
    assert kept.observation_space.to_json()[0] == {"kind": "angular", "name": "heading"}
    assert_same(load_demonstrations(form.format(tmp_path)), kept)
    with pytest.raises(DataError, match="heading: is said to be in degrees, but was written here as an angle in radi"):
        load_demonstrations(form.format(tmp_path), preparation=IN_DEGREES)


def test_the_note_of_any_file_counts_for_all(tmp_path: Path) -> None:
    noted = load_demonstrations(pa.table(ROWS), preparation=IN_DEGREES)
    old = load_demonstrations(pa.table({**ROWS, "episode": [1, 1, 1]}), angular=["heading", "turn"])
    save_demonstrations(old, tmp_path / "a.parquet")
    save_demonstrations(noted, tmp_path / "b.csv")
    both = load_demonstrations([tmp_path / "a.parquet", tmp_path / "b.csv"])
    assert both.observation_space == noted.observation_space
    assert both.action_space == noted.action_space


def test_only_radians_and_degrees_are_units() -> None:
    with pytest.raises(ValueError, match="an angle is recorded in radians or degrees, got 'turns'"):
        Space.from_json([{"kind": "angular", "name": "heading", "recorded_unit": "turns"}])


@pytest.mark.parametrize("name", ["a.parquet", "a.tvae", "minari:{}/walks"])
def test_what_was_kept_as_a_number_is_turned(tmp_path: Path, name: str) -> None:
    plain = from_arrays([[[90.0], [180.0]]], [[[45.0]]])
    target = name.format(tmp_path) if "{}" in name else tmp_path / name
    save_demonstrations(plain, target)
    path = str(target).removeprefix("minari:")
    kept = load_demonstrations(path, preparation=Preparation(degrees=("observation.0",)))
    assert kept.observation_space.signals == (Angular("0", recorded_in_degrees=True),)
    assert kept.action_space.signals == (Continuous("0"),)
    np.testing.assert_allclose(kept.observations[:, 0], [np.pi / 2, np.pi])
    with pytest.raises(DataError, match="column y: was given a kind"):
        load_demonstrations(path, preparation=Preparation(degrees=("y",)))


def test_degrees_are_suspected() -> None:
    found = examine_source(pa.table(ROWS), angular=["heading", "x"], continuous=["turn"])
    assert not found.issues
    assert [issue.column for issue in found.suspicions] == ["observation.heading", "observation.x"]
    assert options_for(found.suspicions[1]) == (
        "--degrees observation.x, instead of --angular observation.x, takes it for an angle in degrees"
    )
    turn = {**ROWS, "observation.x": np.float32([-2 * np.pi, 0, 2 * np.pi])}
    assert examine_source(pa.table(turn), angular=["x"], continuous=["heading"]).suspicions == ()
    broken = examine_source(pa.table({**ROWS, "step": [0, 1, 3]}), angular=["x"])
    assert len(broken.issues) > 0
    assert broken.suspicions == ()


def test_a_run_keeps_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, run = tmp_path / "walks.csv", tmp_path / "run"
    rows = [f"{e},{t},{(e * 40 + 30 * t) % 360},{30 if e % 2 else -30}" for e in range(12) for t in range(4)]
    path.write_text("\n".join(["episode,step,observation.heading,action.turn", *rows, ""]))
    call("data", "validate", path, "--angular", "heading", "--continuous", "turn")
    said = " ".join(capsys.readouterr().out.split())
    assert "goes from 0 to 350: is it in degrees? --degrees observation.heading, instead of" in said
    assert "can be read so" in said
    call("data", "info", path, "--angular", "heading", "--continuous", "turn")
    assert "is it in degrees?" in " ".join(capsys.readouterr().out.split())
    options = ("--degrees", "heading", "--degrees", "turn")
    call("data", "validate", path, *options)
    assert "is sound" in " ".join(capsys.readouterr().out.split())
    call("fit", path, *options, "--out", run, "--training.num-steps", "2", "--training.evaluate-every", "1")
    assert "is it in degrees?" not in " ".join(capsys.readouterr().out.split())
    kept = Source(str(path), Reading(degrees=("heading", "turn"))).load()
    save_demonstrations(kept, tmp_path / "radians.parquet")
    tables = []
    for name in ("walks.csv", "radians.parquet"):
        call("embed", run, tmp_path / name, "--out", tmp_path / "out.parquet", "--force")
        tables.append(pq.read_table(tmp_path / "out.parquet"))
    assert tables[0].equals(tables[1])
    call("export", run, "--out", tmp_path / "export")
    manifest = json.loads((tmp_path / "export" / "manifest.json").read_text())
    for column in (*manifest["observation"], *manifest["action"]):
        assert (column["unit"], column["recorded_unit"]) == ("radians", "degrees")
    config = json.loads((run / "config.json").read_text())
    for column in (*config["observation_space"], *config["action_space"]):
        del column["recorded_unit"]  # as earlier versions wrote it
    (run / "config.json").write_text(json.dumps(config))
    call("export", run, "--out", tmp_path / "export", "--force")
    earlier = json.loads((tmp_path / "export" / "manifest.json").read_text())
    assert (earlier["observation"], earlier["action"]) == (manifest["observation"], manifest["action"])


def test_a_run_on_what_was_converted_knows_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, run = tmp_path / "walks.csv", tmp_path / "run"
    rows = [f"{e},{t},{(e * 40 + 30 * t) % 360},{30 if e % 2 else -30}" for e in range(12) for t in range(4)]
    path.write_text("\n".join(["episode,step,observation.heading,action.turn", *rows, ""]))
    options = ("--degrees", "heading", "--degrees", "turn")
    call("data", "convert", path, f"minari:{tmp_path}/walks", *options)
    call("data", "convert", tmp_path / "walks", tmp_path / "radians.csv")
    call("data", "convert", tmp_path / "radians.csv", tmp_path / "radians.parquet")
    summary = summarise(load_demonstrations(tmp_path / "radians.parquet"))
    assert [signal.kind for signal in summary.signals] == ["angular, from degrees"] * 2
    capsys.readouterr()
    said = refused(capsys, "data", "convert", tmp_path / "radians.parquet", tmp_path / "twice.csv", *options)
    assert CONVERTED in " ".join(said.split())
    assert not (tmp_path / "twice.csv").exists()
    with pytest.raises(SystemExit):
        call("data", "validate", tmp_path / "radians.parquet", "--degrees", "turn")
    assert "leave --degrees action.turn out" in " ".join(capsys.readouterr().out.split())
    steps = ("--training.num-steps", "2", "--training.evaluate-every", "1")
    call("fit", tmp_path / "radians.parquet", "--out", run, *steps)
    call("export", run, "--out", tmp_path / "export")
    manifest = json.loads((tmp_path / "export" / "manifest.json").read_text())
    for column in (*manifest["observation"], *manifest["action"]):
        assert (column["unit"], column["recorded_unit"]) == ("radians", "degrees")
