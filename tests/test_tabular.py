import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_strategies import assert_same, demonstrations, quick
from tvae.data import tabular
from tvae.data.demonstrations import Demonstrations
from tvae.data.preparation import Preparation
from tvae.data.tabular import read_table, write_csv, write_parquet
from tvae.data.trajectory import DataError, Trajectory
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

SESSIONS = """\
episode,step,observation.x,observation.room,action.heading,action.jump,reward,label,lamp
b,0,0.5,hall,3.1,true,0,fast,on
b,1,1.5,attic,-3.1,false,1,fast,off
b,2,2.5,hall,,,,,
a,0,0.0,attic,0.0,false,0,slow,on
"""


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def save_parquet(path: Path, columns: dict[str, Any]) -> Path:
    pq.write_table(pa.table(columns), path)
    return path


def one_walk(**attributes: Any) -> Demonstrations:
    space = Space((Angular("heading"),))
    episode = Trajectory(np.zeros((3, 1)), np.ones((2, 1)), {"reward": np.arange(2.0)}, attributes)
    return Demonstrations.from_trajectories([episode], space, space)


HEADER = "episode,step,observation.x,action.a\n"


# What is read


def test_kinds_follow_from_types(tmp_path: Path) -> None:
    kept = read_table(write(tmp_path / "sessions.csv", SESSIONS))
    assert kept.observation_space.signals == (Continuous("x"), Categorical("room", ("attic", "hall")))
    assert kept.action_space.signals == (Continuous("heading"), Binary("jump"))
    assert kept.attributes["episode"].tolist() == ["b", "a"]
    assert kept.attributes["label"].tolist() == ["fast", "slow"]
    assert kept.lengths.tolist() == [2, 1]
    assert kept.final_observed.tolist() == [True, False]
    assert kept[0].observations.tolist() == [[0.5, 1.0], [1.5, 0.0], [2.5, 1.0]]
    assert kept[0].actions.tolist() == [[3.1, 1.0], [-3.1, 0.0]]
    assert kept[0].steps["reward"].tolist() == [0, 1]
    assert kept[0].steps["lamp"].tolist() == ["on", "off"]
    assert kept[1].observations.tolist() == [[0.0, 0.0]]
    assert kept[1].steps["reward"].tolist() == [0]


def test_kinds_are_overridden(tmp_path: Path) -> None:
    rows = "".join(f"0,{i},{i},{i},{float(i % 2)},{i % 2}\n" for i in range(25))
    path = write(tmp_path / "a.csv", "episode,step,observation.n,observation.m,action.f,action.i\n" + rows)
    kept = read_table(
        path,
        angular=["observation.n"],
        continuous=["observation.m", "action.i"],
        categorical=["action.f"],
    )
    assert kept.observation_space.signals == (Angular("n"), Continuous("m"))
    assert kept.action_space.signals == (Categorical("f", (0, 1)), Continuous("i"))
    with pytest.raises(
        DataError, match=r"column observation\.n: holds 25 different integers, more than 20: say"
    ):
        read_table(path)
    assert len(read_table(path, categorical=["observation.n", "observation.m"]).observation_space.names) == 2


def test_rows_in_any_order(tmp_path: Path) -> None:
    header, *lines = SESSIONS.splitlines()
    shuffled = "\n".join([header, lines[2], lines[3], lines[0], lines[1]]) + "\n"
    sorted_, mixed = write(tmp_path / "a.csv", SESSIONS), write(tmp_path / "b.csv", shuffled)
    assert_same(read_table(sorted_), read_table(mixed))


@quick
@given(st.permutations(range(6)))
def test_every_order_of_rows_gives_the_same_steps(
    tmp_path_factory: pytest.TempPathFactory, order: list[int]
) -> None:
    columns = {
        "episode": pa.array([4, 4, 4, 2, 2, 7]),
        "step": pa.array([0, 1, 2, 0, 1, 0]),
        "observation.x": pa.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
        "action.a": pa.array([0.0, 1.0, None, 3.0, 4.0, 5.0]),
    }
    shuffled = {name: values.take(pa.array(order)) for name, values in columns.items()}
    kept = read_table(save_parquet(tmp_path_factory.mktemp("t") / "a.parquet", shuffled))
    found = {episode.attributes["episode"]: episode.observations[:, 0].tolist() for episode in kept}
    assert found == {4: [0.0, 1.0, 2.0], 2: [3.0, 4.0], 7: [5.0]}


def test_types_that_other_tools_write(tmp_path: Path) -> None:
    path = save_parquet(
        tmp_path / "a.parquet",
        {
            "episode": pa.array([1.0, 1.0]),
            "step": pa.array([0.0, 1.0]),
            "observation.room": pa.array(["b", "a"]).dictionary_encode(),
            "observation.price": pa.array([1, 2], pa.int32()).cast(pa.decimal128(20, 2)),
            "action.move": pa.array(["x", None], pa.large_string()),
            "time": pa.array([0, 0], pa.timestamp("ms")),
            "day": pa.array([3, 3], pa.date32()),
            "empty": pa.nulls(2),
        },
    )
    kept = read_table(path)
    assert kept.observation_space.signals == (Categorical("room", ("a", "b")), Continuous("price"))
    assert kept[0].observations.tolist() == [[1.0, 1.0], [0.0, 2.0]]
    assert kept[0].attributes == {"episode": 1, "time": "1970-01-01 00:00:00.000", "day": "1970-01-04"}


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        (
            "observation.x",
            pa.array([[1.0], [2.0]]),
            r"column observation\.x: needs numbers, booleans or text, got list",
        ),
        (
            "camera",
            pa.array([b"a", b"b"]),
            "column camera: needs numbers, booleans, text or times, got binary",
        ),
        ("step", pa.array([[0], [1]]), r"column step: needs the integers 0, 1, 2, \.\.\., got list"),
        ("episode", pa.array([[0], [0]]), "column episode: needs integers or text, got list"),
    ],
)
def test_types_that_are_no_single_value(tmp_path: Path, column: str, values: Any, message: str) -> None:
    columns: dict[str, Any] = {
        "episode": [0, 0],
        "step": [0, 1],
        "observation.x": [0.0, 1.0],
        "action.a": [1.0, 2.0],
    }
    path = save_parquet(tmp_path / "a.parquet", {**columns, column: values})
    with pytest.raises(DataError, match=message):
        read_table(path)


def test_lists_are_no_categories(tmp_path: Path) -> None:
    lists = {"episode": [0], "step": [0], "observation.x": [[1.0]], "action.a": [1.0]}
    path = save_parquet(tmp_path / "a.parquet", lists)
    with pytest.raises(DataError, match=r"column observation\.x: cannot be categorical"):
        read_table(path, categorical=["observation.x"])


def test_a_day_may_name_an_episode(tmp_path: Path) -> None:
    rows = "2024-02-29,0,0.5,1.0\n2024-03-01,0,0.5,1.0\n"
    kept = read_table(write(tmp_path / "a.csv", HEADER + rows))
    assert kept.attributes["episode"].tolist() == ["2024-02-29", "2024-03-01"]


def test_half_precision(tmp_path: Path) -> None:
    half = pa.array(np.array([0.5, 1.5], dtype=np.float16))
    path = save_parquet(
        tmp_path / "a.parquet", {"episode": [0, 0], "step": [0, 1], "observation.x": half, "action.a": half}
    )
    assert read_table(path)[0].actions[:, 0].tolist() == [0.5, 1.5]


def test_nan_counts_as_empty_in_the_last_row(tmp_path: Path) -> None:
    path = save_parquet(
        tmp_path / "a.parquet",
        {"episode": [0, 0], "step": [0, 1], "observation.x": [0.0, 1.0], "action.a": [1.0, float("nan")]},
    )
    assert read_table(path)[0].has_final_observation


def test_an_episode_of_one_step(tmp_path: Path) -> None:
    kept = read_table(write(tmp_path / "a.csv", "episode,step,observation.x,action.a\n5,0,0.5,1.5\n"))
    assert (len(kept), len(kept[0]), kept[0].has_final_observation) == (1, 1, False)


def test_many_rows(tmp_path: Path) -> None:
    count = 100_000
    path = save_parquet(
        tmp_path / "a.parquet",
        {
            "episode": np.repeat(np.arange(count // 100), 100),
            "step": np.tile(np.arange(100), count // 100),
            "observation.x": np.arange(count, dtype=float),
            "action.a": np.arange(count) % 5,
            "group": np.repeat(np.arange(count // 100) // 7, 100),
        },
    )
    kept = read_table(path)
    assert kept.num_steps == count
    assert kept[-1].observations[-1, 0] == count - 1
    assert kept.attributes["group"].tolist() == [index // 7 for index in range(count // 100)]


# What is written


@quick
@given(demonstrations())
def test_nothing_is_lost(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    directory = tmp_path_factory.mktemp("tables")
    write_parquet(kept, directory / "a.parquet")
    from_parquet = read_table(directory / "a.parquet")
    assert_same(from_parquet, kept)
    write_csv(from_parquet, directory / "b.csv")
    from_csv = read_table(directory / "b.csv")
    assert_same(from_csv, kept)
    write_csv(from_csv, directory / "c.csv.gz")
    assert_same(read_table(directory / "c.csv.gz"), kept)


def test_parts_make_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = read_table(write(tmp_path / "a.csv", SESSIONS))
    monkeypatch.setattr(tabular, "_BLOCK_STEPS", 1)
    write_parquet(kept, tmp_path / "b.parquet")
    write_csv(kept, tmp_path / "c.csv")
    assert_same(read_table(tmp_path / "b.parquet"), kept)
    assert_same(read_table(tmp_path / "c.csv"), kept)


def test_the_text_of_a_csv(tmp_path: Path) -> None:
    write_csv(one_walk(label="a, b"), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines() == [
        '"episode","step","observation.heading","action.heading","reward","label"',
        '0,0,0,1,0,"a, b"',
        '0,1,0,1,1,"a, b"',
        '0,2,0,,,"a, b"',
    ]
    assert (tmp_path / "a.csv.schema.json").is_file()


def test_a_selection_is_written_as_it_is_selected(tmp_path: Path) -> None:
    kept = read_table(write(tmp_path / "a.csv", SESSIONS)).select([1, 0])
    write_parquet(kept, tmp_path / "b.parquet")
    assert_same(read_table(tmp_path / "b.parquet"), kept)


@pytest.mark.parametrize("name", ["a.parquet", "a.csv", "a.csv.gz"])
def test_nothing_is_overwritten_unasked(tmp_path: Path, name: str) -> None:
    writer = write_parquet if name.endswith("parquet") else write_csv
    writer(one_walk(label="first"), tmp_path / name)
    with pytest.raises(FileExistsError, match="exists already"):
        writer(one_walk(label="second"), tmp_path / name)
    assert read_table(tmp_path / name).attributes["label"] == ["first"]
    writer(one_walk(label="second"), tmp_path / name, overwrite=True)
    assert read_table(tmp_path / name).attributes["label"] == ["second"]


def test_categories_that_look_alike_are_not_written(tmp_path: Path) -> None:
    space = Space((Categorical("go", (1, "1")),))
    walk = Trajectory(np.zeros((1, 1)), np.zeros((1, 1)))
    with pytest.raises(
        DataError, match=r"column observation\.go: has categories that look alike as text: 1, 1"
    ):
        write_csv(Demonstrations.from_trajectories([walk], space, space), tmp_path / "a.csv")
    when = np.array(["2024-02-29"], dtype="datetime64[D]")
    with pytest.raises(DataError, match="cannot hold the fact 'when': it is no number, boolean or text"):
        write_csv(one_walk().with_attributes({"when": when}), tmp_path / "a.csv")


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = iter(range(10))

    def fail_later(part: Demonstrations, write: Any = tabular._table) -> pa.Table:
        if next(calls) > 1:
            raise RuntimeError("full")
        return write(part)

    monkeypatch.setattr(tabular, "_table", fail_later)
    monkeypatch.setattr(tabular, "_BLOCK_STEPS", 1)
    two = Demonstrations.from_trajectories(
        [one_walk()[0], one_walk()[0]], one_walk().observation_space, one_walk().action_space
    )
    for writer, name in ((write_parquet, "a.parquet"), (write_csv, "a.csv")):
        calls = iter(range(10))
        with pytest.raises(RuntimeError, match="full"):
            writer(two, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"step": 1}, "cannot hold the fact 'step': another column has this name"),
        ({"action.heading": 1}, r"cannot hold the fact 'action\.heading'"),
        ({"reward": 1}, "cannot hold the fact 'reward'"),
        ({"episode": 1.5}, "'episode' needs integers or text, got float64"),
    ],
)
def test_names_that_a_table_cannot_hold(tmp_path: Path, attributes: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        write_csv(one_walk(**attributes), tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []


def test_episodes_need_their_own_name(tmp_path: Path) -> None:
    twice = one_walk(episode=7).select([0, 0])
    with pytest.raises(DataError, match=r"'episode' needs different values, got .*7.* twice"):
        write_parquet(twice, tmp_path / "a.parquet")
    with pytest.raises(DataError, match="at least one episode"):
        write_parquet(twice.select([]), tmp_path / "a.parquet")
    with pytest.raises(DataError, match=r"needs to end with \.parquet"):
        write_parquet(one_walk(), tmp_path / "a.csv")
    with pytest.raises(DataError, match=r"needs to end with \.csv"):
        write_csv(one_walk(), tmp_path / "a.parquet")


# What is refused


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + "3,0,,1.0\n3,1,0.5,1.0\n", "episode 3, step 0, column observation.x: is missing"),
        (
            HEADER + "3,0,0.5,1.0\n3,1,nan,1.0\n",
            "episode 3, step 1, column observation.x: is missing or not a",
        ),
        (HEADER + "3,0,0.5,1.0\n3,1,inf,1.0\n", "episode 3, step 1, column observation.x: needs a finite"),
        (HEADER + "3,0,0.5,-inf\n", "episode 3, step 0, column action.a: needs a finite number, got -inf"),
        (
            HEADER + "3,0,0.5,1e308\n",
            "episode 3, step 0, column action.a: needs a number of at most 3.4e38 in size, got 1e+308",
        ),
        (
            HEADER + "3,0,0.5,\n3,1,0.5,1.0\n",
            "episode 3, step 0, column action.*: is empty, which only the last",
        ),
        (HEADER + "3,0,0.5,1.0\n3,1,0.5,\n3,2,0.5,\n", "episode 3, step 1, column action.*: is empty, which"),
        (
            HEADER + "2,0,0.5,1.0\n3,0,0.5,\n",
            "episode 3, step 0, column action.*: is empty in the whole episode",
        ),
        (
            HEADER + "2,0,0.5,1\n3,0,1.5,\n3,1,2.5,\n",
            "episode 3, step 1, column action.*: is empty in the whole",
        ),
        (
            HEADER + "3,0,0.5,1.0\n3,2,0.5,1.0\n",
            "episode 3, step 2, column step: leaves a gap: it follows step 0",
        ),
        (
            HEADER + "3,0,0.5,1.0\n3,0,0.5,1.0\n",
            "episode 3, step 0, column step: stands there more than once",
        ),
        (
            HEADER + "3,1,0.5,1.0\n3,2,0.5,1.0\n",
            "episode 3, step 1, column step: is the first of its episode",
        ),
        (HEADER + "3,-1,0.5,1.0\n3,0,0.5,1.0\n", "episode 3, step -1, column step: is the first"),
        (HEADER + "3,0.5,0.5,1.0\n", "column step: needs integers"),
        (HEADER + "3,zero,0.5,1.0\n", "column step: needs the integers 0, 1, 2, ..., got string"),
        (HEADER + "3,,0.5,1.0\n", "column step: is missing, first in row 1"),
        (HEADER + "3,0,0.5,1.0\n,0,0.5,1.0\n", "column episode: is missing, first in row 2"),
        (HEADER + "1.5,0,0.5,1.0\n", "column episode: needs integers"),
        (HEADER, "needs at least one row, got none"),
        ("step,observation.x,action.a\n0,0.5,1.0\n", "needs a column 'episode'; the columns are step, obs"),
        ("episode,observation.x,action.a\n0,0.5,1.0\n", "needs a column 'step'"),
        ("episode,step,action.a\n0,0,1.0\n", "needs at least one column observation.*"),
        ("episode,step,observation.x\n0,0,1.0\n", "needs at least one column action.*"),
        ("episode,step,observation.x,observation.x,action.a\n0,0,1,1,1\n", "observation.x: is there 2 times"),
        (
            "episode,step,observation.x,action.a,action.b\n3,0,0.5,1.0,\n3,1,0.5,1.0,2.0\n",
            "episode 3, step 0, column action.b: is missing or not a number, while other actions",
        ),
        (
            HEADER + "".join(f"3,{i},{i},0.5\n" for i in range(21)),
            "column observation.x: holds 21 different integers, more than 20",
        ),
        (
            HEADER + "3,0,2024-01-01,0.5\n",
            "column observation.x: needs numbers, booleans or text, got date32",
        ),
        (HEADER + "3,0,,0.5\n", "episode 3, step 0, column observation.x: is empty in the whole table"),
        (
            "episode,step,observation.x,action.a,label\n3,0,0.5,1.0,a\n3,1,0.5,1.0,\n",
            "episode 3, step 1, column label: is missing",
        ),
        (
            "episode,step,observation.x,action.a,reward\n3,0,0.5,1.0,0.5\n3,1,0.5,1.0,nan\n",
            "episode 3, step 1, column reward: is missing or not a number",
        ),
        (
            "episode,step,observation.x,action.a,reward\n3,0,0.5,1.0,good\n",
            "column reward: needs numbers, got text",
        ),
    ],
)
def test_bad_tables_are_refused_by_place(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path / "bad.csv", text)
    with pytest.raises(DataError) as caught:
        read_table(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_the_first_problem_says_that_there_are_more(tmp_path: Path) -> None:
    path = write(tmp_path / "bad.csv", HEADER + "3,0,inf,1.0\n3,2,inf,1.0\n")
    with pytest.raises(DataError, match=r"leaves a gap: it follows step 0 \(and 1 other kind of problem\)"):
        read_table(path)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            {"angular": ["observation.y"]},
            "column observation.y: was given a kind, but is no column of a signal",
        ),
        ({"angular": ["y"]}, "column y: was given a kind, but is no column of a signal; these are: obs"),
        (
            {"angular": ["observation.room"]},
            "column observation.room: cannot be angular: needs numbers, got string",
        ),
        ({"continuous": ["observation.room"]}, "column observation.room: cannot be continuous"),
        ({"categorical": ["observation.x"]}, "column observation.x: cannot be categorical"),
        ({"angular": ["action.heading"], "continuous": ["action.heading"]}, "needs one kind, got two"),
    ],
)
def test_kinds_that_cannot_be(tmp_path: Path, overrides: dict[str, list[str]], message: str) -> None:
    path = write(tmp_path / "a.csv", SESSIONS)
    with pytest.raises(DataError) as caught:
        read_table(path, **overrides)
    assert message in str(caught.value)


def test_given_spaces_say_what_is_expected(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", SESSIONS)
    rooms = Categorical("room", ("cellar", "hall", "attic"))
    kept = read_table(path, observation_space=Space((rooms, Continuous("x"))))
    assert kept[0].observations[:, 0].tolist() == [1, 2, 1]
    for space, message in (
        (
            Space((Categorical("room", ("hall",)),)),
            r"column observation\.x: was not expected; expected are obs",
        ),
        (Space((Continuous("y"), Continuous("x"), rooms)), r"column observation\.y: is missing"),
        (
            Space((Continuous("x"), Categorical("room", ("hall",)))),
            r"episode b, step 1, column observation\.room: needs one of hall, got 'attic' \(2 times\)",
        ),
        (
            Space((Continuous("x"), Continuous("room"))),
            r"column observation\.room: needs numbers, got string",
        ),
        (Space((Binary("x"), rooms)), r"episode b, step 0, column observation\.x: needs 0 or 1, got 0\.5"),
        (Space((Categorical("x", (0, 1)), rooms)), r"column observation\.x: cannot be categorical"),
        (
            Space((Continuous("x"), Categorical("room", (0, 1)))),
            r"needs one of the integers 0, 1, got string",
        ),
        (Space((Continuous("x"), Categorical("room", (0, "0")))), "categories that look alike as text: 0, 0"),
    ):
        with pytest.raises(DataError, match=message):
            read_table(path, observation_space=space)


def test_a_category_that_the_schema_does_not_know(tmp_path: Path) -> None:
    path = tmp_path / "b.csv"
    write_csv(read_table(write(tmp_path / "a.csv", SESSIONS)), path)
    write(path, path.read_text().replace('"attic"', '"cellar"'))
    with pytest.raises(
        DataError, match=r"episode b, step 1, column observation\.room: needs one of attic, hall, got"
    ):
        read_table(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.parquet", SESSIONS.encode(), "the name says Parquet, but the contents are text"),
        ("a.parquet", b"", "the contents are empty"),
        ("a.parquet", b"PAR1" + b"\0" * 99, "no whole Parquet file"),
        ("a.csv", b"PAR1" + b"\0" * 99, "the name says text, but the contents are Parquet"),
        ("a.csv", b"\x89HDF\r\n\x1a\n", "the contents are HDF5"),
        ("a.csv", b"PK\x03\x04", "the contents are a zip archive"),
        ("a.csv", b"ab\0cd", "the contents are binary data"),
        ("a.csv", b"\xff\xfea\0b\0", "the contents are text in UTF-16"),
        ("a.csv", "episode,äß\n".encode("latin-1"), "the contents are not UTF-8 text"),
        ("a.csv", gzip.compress(SESSIONS.encode()), "the contents are gzip-compressed data"),
        ("a.csv.gz", SESSIONS.encode(), "the name says gzip-compressed data, but the contents are text"),
        ("a.csv.gz", gzip.compress(SESSIONS.encode())[:-20], "no whole CSV file"),
        ("a.csv", SESSIONS.encode()[:-8], "line 5 of a.csv has 8 values, but the first line has 9"),
        (
            "a.txt",
            SESSIONS.encode(),
            "the name of a table needs to end with one of .parquet, .pq, .csv, .csv.gz",
        ),
    ],
)
def test_contents_that_are_not_what_the_name_says(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError) as caught:
        read_table(tmp_path / name)
    assert message in str(caught.value)
    with pytest.raises(DataError, match="there is no such file"):
        read_table(tmp_path / "nowhere.csv")


@pytest.mark.parametrize("cut", [1, 5, 200, 3000])
def test_a_truncated_parquet_file(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "a.parquet"
    write_parquet(one_walk(), path)
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(DataError, match=r"a\.parquet: "):
        read_table(path)


def test_a_csv_of_ours_that_was_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_csv(one_walk(), path)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:-1]))
    with pytest.raises(DataError, match="written for 3 rows, but there are 2: the file was cut or changed"):
        read_table(path)
    path.write_bytes(whole[:-1])
    with pytest.raises(DataError, match="the last line is not whole"):
        read_table(path)


def test_a_schema_counts_for_its_own_file(tmp_path: Path) -> None:
    plain = write(tmp_path / "a.csv", SESSIONS)
    kept = read_table(plain)
    for name in ("a.csv.gz", "a.tsv"):
        write_csv(read_table(plain, preparation=Preparation(degrees=("action.heading",))), tmp_path / name)
        assert read_table(tmp_path / name).action_space.signals[0] == Angular("heading", recorded_in_degrees=True)
    assert_same(read_table(plain), kept)


def test_a_schema_of_older_versions(tmp_path: Path) -> None:
    path, older = tmp_path / "a.csv", tmp_path / "a.schema.json"
    write_csv(one_walk(), path)
    (tmp_path / "a.csv.schema.json").rename(older)
    assert read_table(path).observation_space.signals == (Angular("heading"),)
    write_csv(one_walk(), tmp_path / "a.csv.gz")
    assert read_table(path).observation_space.signals == (Angular("heading"),)
    (tmp_path / "a.tsv").write_text(path.read_text().replace(",", "\t"))
    for again in (lambda: read_table(path), lambda: write_csv(one_walk(), path, overwrite=True)):
        with pytest.raises(DataError, match=r"a\.csv: a\.schema\.json needs .* one file, but could be .*csv or a\.tsv"):
            again()
    (tmp_path / "a.tsv").unlink()
    write_csv(one_walk(), path, overwrite=True)
    assert not older.exists()
    assert read_table(path).observation_space.signals == (Angular("heading"),)


def test_the_schema_beside_a_csv(tmp_path: Path) -> None:
    path, beside = tmp_path / "a.csv", tmp_path / "a.csv.schema.json"
    write_csv(one_walk(), path)
    assert read_table(path).observation_space.signals == (Angular("heading"),)
    assert read_table(path, continuous=["observation.heading"]).observation_space.signals == (
        Continuous("heading"),
    )
    text = beside.read_text()
    for damaged in (
        text[:-20],
        text.replace('"version": 1', '"version": 99'),
        text.replace("int64", "int65"),
    ):
        beside.write_text(damaged)
        with pytest.raises(DataError, match=r"a\.csv\.schema\.json: the schema is damaged"):
            read_table(path)
    beside.write_text('{"format": "of someone else"}')
    assert read_table(path).observation_space.signals == (Categorical("heading", (0,)),)
