"""Tables wherever they are: in memory, in many files, in HDF5 and LeRobot data sets."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from hypothesis import given, settings

from data_strategies import assert_same, demonstrations, quick
from tvae.data.arrays import from_arrays
from tvae.data.demonstrations import Demonstrations
from tvae.data.estimates import hold_last
from tvae.data.preparation import Clock, Preparation
from tvae.data.roles import Roles
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.trajectory import DataError
from tvae.data.validation import validate
from tvae.spaces import Angular, Categorical, Continuous

COLUMNS: dict[str, list[Any]] = {
    "episode": ["b", "b", "b", "a"],
    "step": [0, 1, 2, 0],
    "observation.x": [0.5, 1.5, 2.5, 0.0],
    "observation.room": ["hall", "attic", "hall", "attic"],
    "action.heading": [3.1, -3.1, None, 0.25],
    "reward": [0.5, 1.0, None, 0.25],
    "label": ["fast", "fast", "fast", "slow"],
}


def kept_columns(**changes: list[Any]) -> pa.Table:
    return pa.table({**COLUMNS, **changes})


# In memory


@pytest.mark.parametrize("table", [pa.table(COLUMNS), pd.DataFrame(COLUMNS), pl.DataFrame(COLUMNS)], ids=type)
def test_tables_in_memory(table: Any, tmp_path: Path) -> None:
    pq.write_table(pa.table(COLUMNS), tmp_path / "a.parquet")
    kept = load_demonstrations(table, angular=["action.heading"])
    assert_same(kept, load_demonstrations(tmp_path / "a.parquet", angular=["action.heading"]))
    assert kept.action_space.signals == (Angular("heading"),)
    assert validate(table) == []


def test_the_index_of_a_frame() -> None:
    frame = pd.DataFrame(COLUMNS)
    kept = load_demonstrations(frame)
    assert_same(load_demonstrations(frame.set_index(["episode", "step"])), kept)
    assert load_demonstrations(frame[frame.episode == "a"])[0].attributes == {"episode": "a", "label": "slow"}


@settings(quick, max_examples=4)
@given(demonstrations())
def test_frames_lose_nothing(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    path = tmp_path_factory.mktemp("frames") / "a.parquet"
    save_demonstrations(kept, path)
    for frame in (pq.read_table(path), pl.read_parquet(path), pd.read_parquet(path, dtype_backend="pyarrow")):
        spaces = {"observation_space": kept.observation_space, "action_space": kept.action_space}
        again = load_demonstrations(frame, **spaces)
        np.testing.assert_array_equal(again.observations, kept.observations)
        np.testing.assert_array_equal(again.actions, kept.actions)
        assert again.final_observed.tolist() == kept.final_observed.tolist()
        assert again.attributes["episode"].tolist() == kept.attributes["episode"].tolist()


def test_errors_name_the_table() -> None:
    with pytest.raises(DataError, match=r"^Table: episode b, step 1, column observation\.x: is missing or not a num"):
        load_demonstrations(kept_columns(**{"observation.x": [0.5, None, 2.5, 0.0]}))
    with pytest.raises(DataError, match=r"^DataFrame: cannot be read as an Arrow table: "):
        load_demonstrations(pd.DataFrame({**COLUMNS, "label": ["a", 1, {}, []]}))


def test_tensors_are_arrays() -> None:
    kept = from_arrays(
        torch.arange(6.0).reshape(1, 3, 2).requires_grad_(),
        [torch.tensor([[1], [0]])],
        labels=["east"],
    )
    assert kept[0].observations.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert kept.action_space.signals == (Categorical("0", (0, 1)),)
    assert from_arrays([torch.zeros(3, dtype=torch.bfloat16)], np.ones((1, 2, 1))).observation_space.signals == (
        Continuous("0"),
    )


# Which columns


def test_columns_that_are_read(tmp_path: Path) -> None:
    save_demonstrations(load_demonstrations(pa.table(COLUMNS), angular=["action.heading"]), tmp_path / "a.parquet")
    chosen = Preparation(columns=("observation.x", "action"))
    for source in (pa.table(COLUMNS), tmp_path / "a.parquet"):
        kept = load_demonstrations(source, preparation=chosen)
        assert kept.observation_space.names == ("x",)
        assert kept.attributes.keys() == {"episode"}
        assert kept.steps == {}
    assert kept.action_space.signals == (Angular("heading"),)
    with pytest.raises(DataError, match=r"^Table: no column is called 'observation\.y'; perhaps observation\.x or"):
        load_demonstrations(pa.table(COLUMNS), preparation=Preparation(columns=("observation.y",)))


def test_only_tables_are_prepared(tmp_path: Path) -> None:
    save_demonstrations(load_demonstrations(pa.table(COLUMNS)), tmp_path / "a.tvae")
    with pytest.raises(DataError, match="only a table can be prepared, by its columns, players, times or missing val"):
        load_demonstrations(tmp_path / "a.tvae", preparation=Preparation(columns=("action",)))


# Many files


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    """A directory with an episode in two Parquet files and another in a CSV file below."""
    table = pa.table(COLUMNS)
    (tmp_path / "parts" / "more").mkdir(parents=True)
    (tmp_path / "parts" / ".hidden.csv").write_text("nothing")
    pq.write_table(table.slice(0, 2), tmp_path / "parts" / "1.parquet")
    pq.write_table(table.slice(2, 1), tmp_path / "parts" / "2.parquet")
    rows = table.slice(3, 1).to_pandas()
    rows[rows.columns[::-1]].to_csv(tmp_path / "parts" / "more" / "3.csv", index=False)
    return tmp_path / "parts"


def test_many_files_are_one_table(parts: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = load_demonstrations(pa.table(COLUMNS))
    files = [parts / "1.parquet", parts / "2.parquet", parts / "more" / "3.csv"]
    assert_same(load_demonstrations(parts), kept)
    assert_same(load_demonstrations(files), kept)
    assert_same(load_demonstrations(str(parts / "**" / "[123].*")), kept)
    monkeypatch.chdir(parts.parent)
    assert_same(load_demonstrations([str(file) for file in files]), kept)
    assert validate(parts) == []


@settings(quick, max_examples=4)
@given(demonstrations())
def test_a_file_for_each_episode_loses_nothing(
    tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations
) -> None:
    directory = tmp_path_factory.mktemp("episodes")
    for index in range(len(kept)):
        save_demonstrations(kept.select([index]), directory / f"{index}.parquet")
    assert_same(load_demonstrations(directory), kept)


def test_files_without_episodes_are_episodes(tmp_path: Path) -> None:
    for name in ("anna", "bert"):
        (tmp_path / f"{name}.csv").write_text("step,observation.x,action.a\n0,1,0.5\n1,2,0.5\n")
    kept = load_demonstrations(tmp_path, continuous=["observation.x"])
    assert kept.attributes["episode"].tolist() == ["anna", "bert"]
    alone = load_demonstrations([tmp_path / "bert.csv"], continuous=["observation.x"])
    assert alone.attributes["episode"].tolist() == ["bert"]
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "anna.csv").write_text("step,observation.x,action.a\n0,1,0.5\n")
    with pytest.raises(DataError, match="files without a column 'episode' need different names, got 'anna' twice"):
        load_demonstrations(tmp_path)


def test_files_that_do_not_fit_together(tmp_path: Path) -> None:
    header = "episode,step,observation.x,action.a"
    first, second = tmp_path / "1.csv", tmp_path / "2.csv"
    first.write_text(f"{header}\n0,0,1.5,0.5\n")
    second.write_text("episode,step,observation.x,b\n1,0,1.5,0.5\n")
    with pytest.raises(DataError, match=r"2\.csv: needs the same columns as .*1\.csv, but lacks action\.a and has b"):
        load_demonstrations(tmp_path)
    second.write_text(f"{header}\n0,0,1.5,0.5\n")
    with pytest.raises(DataError, match=r"2\.csv: episode 0 begins in .*1\.csv too; episodes need different names"):
        load_demonstrations(tmp_path)
    second.write_text(f"{header}\n1,0,hall,0.5\n")
    with pytest.raises(DataError, match=r"2\.csv: column observation\.x holds string, but that of .*1\.csv holds doub"):
        load_demonstrations(tmp_path)
    second.write_text(f"{header}\n1,zero,1.5,0.5\n")
    with pytest.raises(DataError, match=r"2\.csv: column step holds string, but that of .*1\.csv holds int64"):
        load_demonstrations(tmp_path)
    with pytest.raises(DataError, match=r"\*\.nothing: no file has such a name"):
        load_demonstrations(str(tmp_path / "*.nothing"))
    with pytest.raises(DataError, match=r"^0 files: needs at least one file \(\.parquet, \.pq, .*\), got none"):
        load_demonstrations([])
    for name, kind in (("1", ["action.a"]), ("2", [])):
        table = pa.table({"episode": [name], "step": [0], "observation.x": [0.5], "action.a": [0.5]})
        save_demonstrations(load_demonstrations(table, angular=kind), tmp_path / f"{name}.parquet")
    with pytest.raises(DataError, match=r"2\.parquet: actions differ from those of .*1\.parquet: signal 0 is"):
        load_demonstrations(str(tmp_path / "*.parquet"))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("config.json", '{"format": "tvae-model"}'),
        ("manifest.json", '{"format": "tvae-onnx"}'),
        ("demonstrations.json", '{"format": "tvae-demonstrations"}'),
    ],
)
def test_what_we_wrote_below_is_no_data(parts: Path, name: str, said: str) -> None:
    kept = load_demonstrations(parts)
    (parts / "runs/one/rollouts").mkdir(parents=True)
    for path in ("styles.parquet", "rollouts/style-0.parquet"):
        pq.write_table(pa.table({"episode": ["b"], "style": [0]}), parts / "runs/one" / path)
    for own in ('{"format": "of someone else"}', "[]", "no JSON"):
        (parts / "runs/one" / name).write_text(own)
        with pytest.raises(DataError, match=r"style-0\.parquet: needs the same columns as"):
            load_demonstrations(parts)
    (parts / "runs/one" / name).write_text(said)
    assert_same(load_demonstrations(parts), kept)


TWICE = "episode,step,observation.x,observation.x,action.a\n0,0,1.5,2.5,0.5\n"


def test_columns_that_are_there_twice(tmp_path: Path) -> None:
    first, second = tmp_path / "1.csv", tmp_path / "2.csv"
    first.write_text(TWICE)
    second.write_text(TWICE.replace("\n0,", "\n1,"))
    with pytest.raises(DataError, match=r"1\.csv: column observation\.x: is there 2 times$"):
        load_demonstrations(tmp_path)
    first.write_text("episode,step,observation.x,observation.y,action.a\n0,0,1.5,2.5,0.5\n")
    with pytest.raises(DataError, match=r"2\.csv: column observation\.x: is there 2 times$"):
        load_demonstrations(tmp_path)
    (issue,) = validate(second, preparation=Preparation(columns=("observation", "action")))
    assert str(issue) == "column observation.x: is there 2 times"
    second.write_text("episode,step,note,note,observation.x,action.a\n0,0,a,b,1.5,0.5\n")
    kept = load_demonstrations(second, preparation=Preparation(columns=("observation.x", "action")))
    assert kept.observations.tolist() == [[1.5]]


def days(directory: Path, *starts: float, player: str = "") -> Path:
    """A file a day with the episodes 0 and 1 at three times each."""
    for day, start in enumerate(starts, 1):
        rows = [f"{e},{player}{day},{start + t},{t}.5,0.5\n" for e in range(2) for t in range(3)]
        (directory / f"day{day}.csv").write_text("".join(["episode,player,t,observation.x,action.a\n", *rows]))
    return directory


@pytest.mark.parametrize("rule", [None, hold_last])
def test_by_a_clock_an_episode_goes_on_later(tmp_path: Path, rule: Any) -> None:
    clock = Preparation(clock=Clock("t", resample=rule), roles=Roles(ignored=("player",)))
    assert load_demonstrations(days(tmp_path, 0, 3), preparation=clock).lengths.tolist() == [6, 6]
    said = r"day2\.csv: episode 0 is in .*day1\.csv too, at the same times \(t\); different episodes need different nam"
    for start in (0, 0.5, 2, -2):
        with pytest.raises(DataError, match=said):
            load_demonstrations(days(tmp_path, 0, start), preparation=clock)
    with pytest.raises(DataError, match=r"day3\.csv: episode 0 is in .*day1\.csv too"):
        load_demonstrations(days(tmp_path, 0, 6, 1), preparation=clock)
    dates = pd.read_csv(tmp_path / "day1.csv")
    for day, first in ((1, "2026-01-01 10:00:00"), (2, "2026-01-01 10:00:01.5"), (3, "2026-01-02")):
        dates.assign(t=pd.Timestamp(first) + pd.to_timedelta(dates.t, "s")).to_csv(tmp_path / f"day{day}.csv")
    with pytest.raises(DataError, match=said):
        load_demonstrations(tmp_path, preparation=clock)


def test_a_file_for_each_player(tmp_path: Path) -> None:
    by_time = Preparation(player="player", clock=Clock("t"))
    kept = load_demonstrations(days(tmp_path, 0, 0), preparation=by_time)
    assert sorted(kept.attributes["episode"].tolist()) == ["0/1", "0/2", "1/1", "1/2"]
    by_step = Preparation(player="player", roles=Roles(step="t"))
    assert load_demonstrations(tmp_path, preparation=by_step).lengths.tolist() == kept.lengths.tolist() == [3] * 4
    (tmp_path / "day3.csv").write_bytes((tmp_path / "day2.csv").read_bytes())
    for rules, said in ((by_time, "is in"), (by_step, "begins in")):
        with pytest.raises(DataError, match=rf"day3\.csv: episode 0, player 2 {said} .*day2\.csv too"):
            load_demonstrations(tmp_path, preparation=rules)


def test_files_in_which_no_episode_or_time_is_told(tmp_path: Path) -> None:
    for name in ("a", "b"):
        table = pa.table({"episode": [[0]], "step": [0], "t": ["now"], "observation.x": [0.5], "action.a": [0.5]})
        pq.write_table(table, tmp_path / f"{name}.parquet")
    with pytest.raises(DataError, match=r"column episode: needs integers or text, got list"):
        load_demonstrations(tmp_path)
    with pytest.raises(DataError, match=r"needs a column 'time'"):
        load_demonstrations(tmp_path, preparation=Preparation(clock=Clock("time")))
    found = validate(tmp_path, preparation=Preparation(clock=Clock("t")))
    assert "column t: needs numbers or times, got string" in map(str, found)


# HDF5


def write_robomimic(path: Path, *, length: int = 3) -> Path:
    with h5py.File(path, "w") as file:
        for number in (10, 2):
            demo = file.create_group(f"data/demo_{number}")
            demo["actions"] = np.arange(2.0 * length).reshape(length, 2) + number
            demo["rewards"] = np.arange(float(length))
            demo["dones"] = np.arange(length) == length - 1
            demo["states"] = np.zeros((length, 40))
            for group, shift in (("obs", 0), ("next_obs", 1)):
                demo[f"{group}/eef"] = np.arange(3.0 * length).reshape(length, 3) + 3 * shift
                demo[f"{group}/gripper"] = np.arange(1.0 * length)[:, None] + shift
        file["mask/better"] = np.array([b"demo_10"])
    return path


def test_robomimic(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "a.hdf5")
    kept = load_demonstrations(path)
    assert kept.observation_space.names == ("eef.0", "eef.1", "eef.2", "gripper")
    assert kept.action_space.signals == (Continuous("0"), Continuous("1"))
    assert kept.attributes["episode"].tolist() == ["demo_2", "demo_10"]
    assert kept.attributes["mask.better"].tolist() == [False, True]
    assert kept.final_observed.all()
    assert kept[1].observations[:, 0].tolist() == [0, 3, 6, 9]
    assert kept[1].observations[:, 3].tolist() == [0, 1, 2, 3]
    assert kept[1].actions.tolist() == [[10, 11], [12, 13], [14, 15]]
    assert kept[1].steps["reward"].tolist() == [0, 1, 2]
    assert kept[1].steps["done"].tolist() == [False, False, True]
    assert validate(path) == []
    narrow = load_demonstrations(path, preparation=Preparation(columns=("observation.gripper", "action")))
    assert narrow.observation_space.names == ("gripper",)


def put(group: h5py.Group, name: str, values: Any) -> None:
    """Other values, or an empty group, instead of what is there."""
    if name in group:
        del group[name]
    if values is None:
        group.create_group(name)
    else:
        group[name] = values


def test_robomimic_with_observations_in_one_array(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "a.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            put(demo, "obs", np.arange(6.0).reshape(3, 2))
            put(demo, "next_obs", np.arange(6.0).reshape(3, 2) + 2)
    kept = load_demonstrations(path)
    assert kept.observation_space.names == ("0", "1")
    assert kept[0].observations.tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]


def test_robomimic_of_another_machine(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "a.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            del demo["next_obs"]
    kept = load_demonstrations(path)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            for name in ("actions", "rewards", "obs/eef", "obs/gripper"):
                put(demo, name, demo[name][()].astype(">f8"))
    assert_same(load_demonstrations(path), kept)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda demo: demo.create_dataset("obs/camera", data=np.zeros((3, 4, 4, 3))),
            r"demo_2: obs/camera needs numbers of the shape \(steps,\) or \(steps, signals\), got the shape "
            r"\(3, 4, 4, 3\) of dtype float64: images cannot be learned from; name the columns to read instead",
        ),
        (lambda demo: demo.create_dataset("obs/mood", data=np.zeros(3)), "demo_2: needs next_obs/mood, as there is an"),
        (lambda demo: demo.pop("actions"), "demo_2: needs 'actions'; there are dones, next_obs, obs, rewards, states"),
        (lambda demo: (demo.pop("obs/eef"), demo.pop("next_obs/eef")), "demo_10: needs the same columns as demo_2; th"),
        (
            lambda demo: (demo.pop("rewards"), demo.create_dataset("rewards", data=np.zeros(9))),
            r"demo_2: reward needs 3 values, as many as actions, got shape \(9,\)",
        ),
        (
            lambda demo: (demo.pop("obs/eef"), demo.create_dataset("obs/eef", data=np.zeros((9, 3)))),
            "demo_2: obs/eef needs 3 rows, as many as actions, got 9",
        ),
        (lambda demo: put(demo, "actions", None), "demo_2: actions needs an array of numbers, got a group of none"),
        (lambda demo: put(demo, "rewards", None), "demo_2: rewards needs an array of numbers, got a group of none"),
        (
            lambda demo: put(demo, "obs/eef", np.array([b"a", b"b", b"c"])),
            r"demo_2: obs/eef needs an array of numbers, got an array of dtype \|S1 and shape \(3,\)",
        ),
        (lambda demo: put(demo, "actions", np.zeros((0, 2))), "demo_2: needs at least one action, got none"),
        (lambda demo: put(demo, "next_obs", np.zeros((3, 3))), "demo_2: needs next_obs/eef, as there is an obs/eef"),
        (lambda demo: put(demo, "obs", np.zeros((3, 3))), "demo_2: needs next_obs, as there is an obs"),
        (
            lambda demo: put(demo, "next_obs/eef", np.zeros((3, 4))),
            "demo_2: next_obs/eef needs 3 signals, as obs/eef has, got 4",
        ),
        (
            lambda demo: put(demo.parent, "demo_2", np.zeros(3)),
            r"demo_2: needs to be a group with 'obs' and 'actions', got an array of dtype float64 and shape \(3,\)",
        ),
        (
            lambda demo: put(demo.file, "mask/train", np.array([2, 10])),
            r"mask/train needs names of demonstrations, such as demo_0, got an array of dtype int64 and shape \(2,\)",
        ),
        (lambda demo: put(demo.file, "mask/train", None), "mask/train needs names .*, got a group of none"),
        (lambda demo: put(demo.file, "mask", np.zeros(2)), r"mask needs to be a group with .*, got an array of dtype"),
        (
            lambda demo: demo["obs/eef"].write_direct(np.full((3, 3), np.nan)),
            r"episode demo_2, step 0, column observation\.eef\.0: is missing or not a number",
        ),
    ],
)
def test_robomimic_that_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    path = write_robomimic(tmp_path / "a.hdf5")
    with h5py.File(path, "r+") as file:
        change(file["data/demo_2"])
    with pytest.raises(DataError, match=rf"a\.hdf5: {message}"):
        load_demonstrations(path)


def test_images_of_robomimic_are_left_out(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "a.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            demo["obs/camera"] = demo["next_obs/camera"] = np.zeros((3, 4, 4, 3))
    kept = load_demonstrations(path, preparation=Preparation(columns=("observation.eef", "action")))
    assert kept.observation_space.names == ("eef.0", "eef.1", "eef.2")


def test_other_hdf5(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["observations"] = np.zeros(3)
    with pytest.raises(DataError, match=r"a\.h5: needs a group 'data', as robomimic writes it; there are observations"):
        load_demonstrations(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_group("data")
    with pytest.raises(DataError, match=r"a\.h5: needs at least one demonstration in 'data', got none"):
        load_demonstrations(tmp_path / "a.h5")
    (tmp_path / "a.h5").write_text("nothing")
    with pytest.raises(DataError, match=r"a\.h5: no whole HDF5 file: "):
        load_demonstrations(tmp_path / "a.h5")
    with pytest.raises(DataError, match=r"b\.h5: there is no such file"):
        load_demonstrations(tmp_path / "b.h5")


# LeRobot


def write_lerobot(root: Path, *, version: str = "v3.0", camera: bool = False) -> Path:
    numbers = {"dtype": "float32", "shape": [2]}
    index = {"dtype": "int64", "shape": [1], "names": None}
    features: dict[str, Any] = {
        "observation.state": {**numbers, "names": {"motors": ["shoulder", "elbow"]}},
        "observation.force": {"dtype": "float32", "shape": [1], "names": None},
        "action": {**numbers, "names": ["same", "same"]},
        "next.reward": {"dtype": "float32", "shape": [1], "names": None},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), index),
    }
    if camera:
        features["observation.images.top"] = {"dtype": "video", "shape": [3, 4, 4], "names": None}
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (root / part).mkdir(parents=True)
    (root / "meta/info.json").write_text(json.dumps({"codebase_version": version, "fps": 10, "features": features}))
    pq.write_table(
        pa.table({"episode_index": [0, 1], "length": [2, 3], "tasks": [["push"], ["pull"]]}),
        root / "meta/episodes/chunk-000/file-000.parquet",
    )
    pd.DataFrame({"task_index": [0, 1]}, index=["push", "pull"]).to_parquet(root / "meta/tasks.parquet")
    frames = pa.table(
        {
            "observation.state": pa.array([[i, i + 0.5] for i in range(5)], pa.list_(pa.float32(), 2)),
            "observation.force": pa.array([[1.0 * i] for i in range(5)], pa.list_(pa.float32())),
            "action": pa.array([[-i, i] for i in range(5)], pa.list_(pa.float32())),
            "next.reward": pa.array([0, 1, 0, 0, 1], pa.float32()),
            "timestamp": pa.array([0, 0.1, 0, 0.1, 0.2], pa.float32()),
            "frame_index": [0, 1, 0, 1, 2],
            "episode_index": [0, 0, 1, 1, 1],
            "index": list(range(5)),
            "task_index": [0, 0, 1, 1, 1],
        }
    )
    pq.write_table(frames.slice(0, 3), root / "data/chunk-000/file-000.parquet")
    pq.write_table(frames.slice(3), root / "data/chunk-000/file-001.parquet")
    return root


def test_lerobot(tmp_path: Path) -> None:
    root = write_lerobot(tmp_path / "arm")
    kept = load_demonstrations(root)
    assert kept.observation_space.names == ("state.shoulder", "state.elbow", "force")
    assert kept.action_space.names == ("0", "1")
    assert kept.attributes["episode"].tolist() == [0, 1]
    assert kept.attributes["task"].tolist() == ["push", "pull"]
    assert kept[1].observations.tolist() == [[2, 2.5, 2], [3, 3.5, 3], [4, 4.5, 4]]
    assert kept[1].actions.tolist() == [[-2, 2], [-3, 3], [-4, 4]]
    assert kept[1].steps["reward"].tolist() == [0, 0, 1]
    assert kept[1].steps["timestamp"].tolist() == pytest.approx([0, 0.1, 0.2])
    assert validate(str(root)) == []


def test_images_of_lerobot_are_refused_or_left_out(tmp_path: Path) -> None:
    root = write_lerobot(tmp_path / "arm", camera=True)
    message = (
        r"arm: observation\.images\.top of the shape \[3, 4, 4\] and dtype video: images cannot be learned from, only "
        r"single values and vectors of numbers, booleans or text; name the columns to read instead \(--only\), such "
    )
    with pytest.raises(DataError, match=message + r"as observation\.state, observation\.force, action"):
        load_demonstrations(root)
    kept = load_demonstrations(root, preparation=Preparation(columns=("observation.state", "action")))
    assert kept.observation_space.names == ("state.shoulder", "state.elbow")
    assert kept.attributes.keys() == {"episode"}


def test_lerobot_that_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"old: needs a LeRobot data set of version 3, got v2\.1"):
        load_demonstrations(write_lerobot(tmp_path / "old", version="v2.1"))
    root = write_lerobot(tmp_path / "arm")
    (root / "data/chunk-000/file-001.parquet").rename(tmp_path / "away")
    with pytest.raises(DataError, match="arm: episode 1: needs 3 frames, as meta/episodes says, got 1"):
        load_demonstrations(root)
    (root / "data/chunk-000/file-001.parquet").write_bytes(b"PAR1")
    with pytest.raises(DataError, match=r"file-001\.parquet: no whole Parquet file: "):
        load_demonstrations(root)
    pq.write_table(pa.table({"action": [0.5]}), root / "data/chunk-000/file-001.parquet")
    with pytest.raises(DataError, match=r"file-001\.parquet: lacks observation\.state, .*, which meta/info\.json"):
        load_demonstrations(root)
    for path in (root / "data/chunk-000").iterdir():
        path.unlink()
    with pytest.raises(DataError, match="arm: there is no Parquet file in data"):
        load_demonstrations(root)
    (root / "meta/tasks.parquet").unlink()
    (root / "meta/info.json").write_text('{"codebase_version": "v3.0", "features": {"action": {}}}')
    with pytest.raises(DataError, match="arm: needs the features episode_index and frame_index, got action"):
        load_demonstrations(root)
    (root / "meta/info.json").write_text("{")
    with pytest.raises(DataError, match=r"arm: meta/info\.json does not describe a LeRobot data set: "):
        load_demonstrations(root)


def test_lists_of_lerobot_that_are_no_vectors(tmp_path: Path) -> None:
    root = write_lerobot(tmp_path / "arm")
    path = root / "data/chunk-000/file-001.parquet"
    table = pq.read_table(path)
    at = table.column_names.index("action")
    pq.write_table(table.set_column(at, "action", pa.array([[1.0], [2.0]], pa.list_(pa.float32()))), path)
    with pytest.raises(DataError, match=r"action: needs lists of one length, as its shape \[2\] says, got \[2, 1\]"):
        load_demonstrations(root)


def test_matrices_of_lerobot(tmp_path: Path) -> None:
    root = write_lerobot(tmp_path / "arm")
    info = json.loads((root / "meta/info.json").read_text())
    info["features"]["observation.state"] |= {"dtype": "float32", "shape": [2, 1]}
    (root / "meta/info.json").write_text(json.dumps(info))
    message = r"arm: observation\.state of the shape \[2, 1\] and dtype float32: cannot be learned from, only single"
    with pytest.raises(DataError, match=message):
        load_demonstrations(root)
    assert len(load_demonstrations(root, preparation=Preparation(columns=("observation.force", "action")))) == 2


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([[1.0, 2.0]] * 4, "list<item: double>, the first of 2 values: make a column of each, such as NAME.0, NAME.1"),
        ([None, [[[0]] * 3] * 2, None, None], "the first of the shape (2, 3, 1): images cannot be learned from"),
        ([{"bytes": b"png", "path": "a"}] * 4, "struct<bytes: binary, path: string>: images and other files cannot be"),
        ([b"png"] * 4, "binary: images and other files cannot be learned from"),
    ],
)
def test_images_in_tables(values: list[Any], message: str) -> None:
    rows = pa.table({**COLUMNS, "observation.camera": values})
    with pytest.raises(DataError) as caught:
        load_demonstrations(rows)
    assert "column observation.camera: needs numbers, booleans or text, got" in str(caught.value)
    assert message in str(caught.value)
    kept = load_demonstrations(rows, preparation=Preparation(columns=("observation.x", "action")))
    assert kept.observation_space.names == ("x",)


def test_images_in_arrays() -> None:
    with pytest.raises(DataError, match=r"episode 0: observations need .*, got uint8 of the shape \(3, 8, 8, 3\): ima"):
        from_arrays([np.zeros((3, 8, 8, 3), np.uint8)], [[0.5, 1.5]])
