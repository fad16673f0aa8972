"""Tables whose columns have names of their own."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from commands import call, refused
from data_strategies import assert_same
from tvae.data.demonstrations import Demonstrations
from tvae.data.estimates import hold_last
from tvae.data.issues import Issue
from tvae.data.preparation import Preparation
from tvae.data.roles import Roles
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.trajectory import DataError
from tvae.data.validation import validate
from tvae.experiments.remedies import options_for
from tvae.experiments.source import Reading, Source
from tvae.spaces import Angular, Binary, Categorical, Continuous

COLUMNS: dict[str, list[Any]] = {
    "match": ["b", "b", "a", "a"],
    "t": [0, 1, 0, 1],
    "map": ["sea", "sea", "sea", "sea"],
    "hp": [9.5, 8.5, 7.5, 6.5],
    "pos.x": [0.5, 1.5, 2.5, 3.5],
    "move_x": [0.25, 0.5, 0.75, 1.0],
    "move_y": [0.0, 0.5, 0.0, 0.5],
    "jump": [0, 1, 0, 0],
    "reward": [0.0, 1.0, 0.0, 1.0],
}
ROLES = Roles("match", "t", actions=("move_*", "jump"))


def read(roles: Roles, table: dict[str, list[Any]] = COLUMNS, **other: Any) -> Demonstrations:
    return load_demonstrations(pa.table(table), preparation=Preparation(roles=roles), **other)


def test_columns_are_what_they_are_said_to_be() -> None:
    kept = read(ROLES, binary=["jump"], angular=["move_y"])
    assert kept.observation_space.names == ("hp", "pos.x")
    assert kept.action_space.signals == (Continuous("move_x"), Angular("move_y"), Binary("jump"))
    assert kept[1].actions.tolist() == [[0.75, 0.0, 0.0], [1.0, 0.5, 0.0]]
    assert kept.attributes["episode"].tolist() == ["b", "a"]
    assert kept.attributes["map"].tolist() == ["sea", "sea"]
    assert list(kept.steps) == ["reward"]
    ours = {"match": "episode", "t": "step", "hp": "observation.hp", "pos.x": "observation.pos.x"}
    ours |= {name: f"action.{name}" for name in ("move_x", "move_y", "jump")}
    renamed = {ours.get(name, name): values for name, values in COLUMNS.items()}
    assert_same(load_demonstrations(pa.table(renamed), binary=["jump"], angular=["action.move_y"]), kept)


def test_what_is_left_over() -> None:
    assert read(Roles("match", "t", ("move_*",), ignored=("pos", "ju*"))).observation_space.names == ("hp",)
    assert read(Roles("match", "t", ("move_*",), ("pos",))).observation_space.names == ("pos.x",)
    everything = read(Roles("match", "t", ("move_x",), ("*",), ("reward", "map")))
    assert everything.observation_space.names == ("hp", "pos.x", "move_y", "jump")
    marked = {("observation.hp" if name == "hp" else name): values for name, values in COLUMNS.items()}
    kept = read(ROLES, marked)
    assert kept.observation_space.names == ("hp",)
    assert set(kept.steps) == {"pos.x", "reward"}


def test_a_players_own_rows_say_what_changes() -> None:
    table = pa.table({**COLUMNS, "match": ["m"] * 4, "who": ["ann", "ann", "bob", "bob"], "team": ["r", "r", "b", "b"]})
    kept = load_demonstrations(table, preparation=Preparation(roles=ROLES, player="who"))
    assert kept.attributes["team"].tolist() == ["r", "b"]
    assert kept.observation_space.names == ("hp", "pos.x")


def test_a_model_says_what_is_left_over() -> None:
    space = read(ROLES).observation_space
    still = {**COLUMNS, "hp": [9.5] * 4}
    assert read(ROLES, still).observation_space.names == ("pos.x",)
    assert read(ROLES, still, observation_space=space).observation_space.names == ("hp", "pos.x")


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        (Roles("matches", "t", ("jump",)), "no column is called 'matches'; perhaps match is meant; the columns are m"),
        (Roles("match", "t", ("jumps", "move_*")), "no column is called 'jumps'; perhaps jump is meant"),
        (Roles("match", "t", ("jump",), ignored=("z_*",)), "no column is called 'z_*'; the columns are match, t"),
        (Roles("match", "t", ("jump",), ("jump",)), "column jump: is named as an action and as an observation"),
        (Roles("match", "t", ("t",)), "column t: is named as a signal, but says which row is which step"),
        (Roles("match", "t"), "needs at least one column observation.*; the columns are match, t"),
        (Roles("match", "t", ("*",), ignored=("hp", "pos", "map")), "needs at least one column observation.*"),
    ],
)
def test_roles_that_do_not_fit(roles: Roles, message: str) -> None:
    found = validate(pa.table(COLUMNS), preparation=Preparation(roles=roles))
    assert message in "\n".join(map(str, found))


def test_a_column_that_is_called_like_one_of_ours() -> None:
    (issue,) = validate(pa.table({**COLUMNS, "episode": [0] * 4}), preparation=Preparation(roles=ROLES))
    assert issue == Issue("is there, but another column is named instead", "episode")
    assert options_for(issue) == "--ignore episode"


def test_issues_name_columns_as_the_table_does() -> None:
    bad = {**COLUMNS, "hp": [None, 8.5, float("inf"), 6.5], "t": [0, 2, 0, 1]}
    found = validate(pa.table(bad), angular=["turn"], preparation=Preparation(roles=ROLES))
    assert [issue.column for issue in found] == ["turn", "hp"]
    found = validate(pa.table(bad), preparation=Preparation(roles=ROLES))
    places = [(issue.column, issue.episode, issue.step) for issue in found]
    assert places == [("t", "b", 2), ("hp", "a", 0), ("hp", "b", 0)]
    assert options_for(found[0]) == "--time t with --resample hold or --resample linear"


def test_many_files(tmp_path: Path) -> None:
    table = pa.table(COLUMNS)
    for at in (0, 2):
        pq.write_table(table.slice(at, 2), tmp_path / f"{at}.parquet")
    assert_same(load_demonstrations(tmp_path, preparation=Preparation(roles=ROLES)), read(ROLES))
    pq.write_table(table.slice(0, 2), tmp_path / "2.parquet")
    with pytest.raises(DataError, match="episode b begins in"):
        load_demonstrations(tmp_path, preparation=Preparation(roles=ROLES))


def test_a_table_that_we_wrote_needs_no_roles(tmp_path: Path) -> None:
    save_demonstrations(read(ROLES), tmp_path / "ours.parquet")
    ours = Source(str(tmp_path / "ours.parquet"), Reading("match", "t", ("move_*", "jump"), ignore=("pos",)))
    kept = ours.load()
    assert kept.action_space == read(ROLES).action_space
    assert kept.observation_space.names == ("hp", "pos.x")
    chosen = Source(str(tmp_path / "ours.parquet"), Reading("match", "t", only=("observation.hp", "action"))).load()
    assert chosen.observation_space.names == ("hp",)
    issues = validate(pa.table(COLUMNS).slice(0, 0), preparation=Preparation(roles=ROLES))
    assert issues[-1].message == "needs at least one row, got none"


def test_text_among_the_numbers_of_many_files(tmp_path: Path) -> None:
    for name, values in (("a", "1.5\n2.5"), ("b", "3.5\n4.5\nlost")):
        rows = "".join(f"{name},{step},{value},0.5\n" for step, value in enumerate(values.split()))
        (tmp_path / f"{name}.csv").write_text("match,t,hp,jump\n" + rows)
    reading = Preparation(roles=Roles("match", "t", ("jump",), ("hp",)))
    found = validate(tmp_path, continuous=["hp"], preparation=reading)
    assert str(found[0]).startswith("episode b, step 2, column hp: is no number, got 'lost'")
    mended = Preparation(roles=reading.roles, nulls=("lost",), missing=hold_last)
    assert load_demonstrations(tmp_path, preparation=mended)[1].observations.tolist() == [[3.5], [4.5], [4.5]]


def test_numbers_as_text_and_names_are_no_categories() -> None:
    count = 300
    table = {
        "match": ["m"] * count,
        "t": list(range(count)),
        "ping": [str(at / 2) for at in range(count)],
        "when": [f"at {at}" for at in range(count)],
        "jump": [0.5] * count,
    }
    found = validate(pa.table(table), preparation=Preparation(roles=Roles("match", "t", ("jump",))))
    assert [options_for(issue) for issue in found] == [
        "--continuous ping, --angular ping (in radians), --degrees ping or --categorical ping; or --ignore ping",
        "--ignore when or --categorical when",
    ]
    kept = read(Roles("match", "t", ("jump",)), table, continuous=["ping"], categorical=["when"])
    assert kept.observations[:3, 0].tolist() == [0.0, 0.5, 1.0]
    assert isinstance(kept.observation_space.signals[1], Categorical)


def test_kinds_by_pattern() -> None:
    kept = read(ROLES, angular=["move_*"], continuous=["move_x"])
    assert kept.action_space.signals[:2] == (Continuous("move_x"), Angular("move_y"))
    with pytest.raises(DataError, match="column move_x: needs one kind, got two"):
        read(ROLES, angular=["move_*"], continuous=["*_x"])


def test_a_reading_of_an_earlier_run() -> None:
    assert Source.from_json({"path": "a.csv", "missing": "hold"}).reading.missing == ("hold",)
    assert Source.from_json({"path": "a.csv", "reading": {"missing": None}}).reading.missing == ()


def raids(path: Path) -> None:
    """A CSV of another game in which two columns are wrong: one has holes, one has text among its numbers."""
    rng = np.random.default_rng(0)
    lines = ["when,match_id,tick,player,hp,ping,dist,move,turn,shoot"]
    for match in range(24):
        left = 1 if match % 2 else -1
        for tick in range(1, 13):
            hp = "" if rng.random() < 0.05 else f"{rng.uniform(0, 100):.1f}"
            ping = "lost" if rng.random() < 0.05 else str(rng.integers(10, 90))
            move = rng.choice(["left", "right"])
            numbers = f"{rng.uniform(0, 9):.2f},{move},{left * 0.2 + 0.1 * rng.standard_normal():.3f},{match % 2}"
            lines.append(f"on day {match}.{tick},m{match},{tick},p{match % 5},{hp},{ping},{numbers}")
    path.write_text("\n".join(lines) + "\n")


def test_a_table_of_another_game_from_csv_to_bot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raids(tmp_path / "raids.csv")
    for said in (
        [],
        ["--episode", "match_id", "--time", "tick", "--action", "move", "--action", "turn", "--action", "shoot"],
    ):
        with pytest.raises(SystemExit) as stopped:
            call("data", "validate", tmp_path / "raids.csv", *said)
        assert stopped.value.code == 1
    words = " ".join(capsys.readouterr().out.split())
    for told in (
        "name it: --episode COLUMN",
        "name it: --step COLUMN where steps are numbered 0, 1, 2, ..., else --time COLUMN",
        "--action COLUMN, once for each",
        "column ping: is no number, got 'lost', but most values are",
        "--null TEXT reads a text as a missing value",
        "column hp: is missing or not a number (",
        "--missing hold, --missing linear or --missing drop; or --ignore hp",
        "--ignore when or --categorical when",
    ):
        assert told in words
    mended = ["--continuous", "ping", "--binary", "shoot", "--ignore", "when", "--null", "lost"]
    options = [*said, *mended, "--missing", "hold", "--missing", "drop"]
    call("data", "validate", tmp_path / "raids.csv", *options)
    assert "is sound Columns that no option names were taken for" in " ".join(capsys.readouterr().out.split())
    small = ["--training.num-steps", "10", "--model.hidden-features", "8", "--device", "cpu"]
    call("fit", tmp_path / "raids.csv", "--out", tmp_path / "run", *options, *small)
    assert pq.read_table(tmp_path / "run/styles.parquet")["episode"][0].as_py().startswith("m")
    assert (tmp_path / "run/report.html").stat().st_size > 0
    call("styles", tmp_path / "run", "--data", tmp_path / "raids.csv", "--out", tmp_path / "labels.parquet")
    assert len(pq.read_table(tmp_path / "labels.parquet")) > 0
    call("export", tmp_path / "run", "--out", tmp_path / "bot")
    manifest = json.loads((tmp_path / "bot/manifest.json").read_text())
    assert "hp" in json.dumps(manifest)
    assert list((tmp_path / "bot").glob("*.onnx"))
    assert "no column is called 'tock'; perhaps tick" in refused(
        capsys, "fit", tmp_path / "raids.csv", "--out", tmp_path / "no", "--episode", "match_id", "--step", "tock"
    )
    assert not (tmp_path / "no").exists()
