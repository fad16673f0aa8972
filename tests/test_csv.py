"""CSV files as spreadsheets and people of other countries write them."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import call, refused
from data_strategies import assert_same, demonstrations, quick
from tvae.data.csv_files import CsvFormat, read_csv
from tvae.data.demonstrations import Demonstrations
from tvae.data.preparation import Preparation
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.tabular import read_table
from tvae.data.trajectory import DataError
from tvae.data.validation import validate
from tvae.experiments.source import Reading, Source
from tvae.spaces import Categorical, Continuous

PLAIN = """\
episode,step,observation.x,action.key
0,0,0.5,left
0,1,-1.25e-3,right
1,0,2,left
1,1,.5,stay
"""


def elsewhere(text: str, separator: str, mark: str) -> str:
    """The same table with another separator and decimal mark."""
    return "\n".join(separator.join(part.replace(".", mark) for part in line.split(",")) for line in text.split("\n"))


def european(separator: str = ";", mark: str = ",") -> str:
    head, rows = PLAIN.split("\n", 1)
    return head.replace(",", separator) + "\n" + elsewhere(rows, separator, mark)


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("mark", [",", "."])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("name", ["a.csv", "a.tsv", "a.csv.gz"])
def test_what_separates_and_marks_is_found_out(
    tmp_path: Path, separator: str, mark: str, encoding: str, name: str
) -> None:
    (tmp_path / "plain.csv").write_text(PLAIN)
    content = european(separator, mark).replace("\n", "\r\n").encode(encoding)
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    kept = load_demonstrations(tmp_path / name)
    assert kept.observation_space.signals == (Continuous("x"),)
    assert_same(kept, load_demonstrations(tmp_path / "plain.csv"))


def test_a_line_of_spreadsheets_names_the_separator(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("sep=|\r\n" + european("|", ","), newline="")
    kept = load_demonstrations(tmp_path / "a.csv")
    assert kept.observations[:, 0].tolist() == [0.5, -0.00125, 2.0, 0.5]
    uneven = "sep=;\n" + european() + "2;0\n"
    (tmp_path / "b.csv").write_text(uneven)
    line = len(uneven.splitlines())
    (issue,) = validate(tmp_path / "b.csv")
    assert issue.message == f"line {line} of b.csv has 2 values, but the first line has 4"


def test_names_in_quotes_may_hold_any_character(tmp_path: Path) -> None:
    text = PLAIN.replace("observation.x", '"observation.x; y\t(m)"').replace("episode", '"episode"')
    (tmp_path / "a.csv").write_text("\ufeff" + text, encoding="utf-8")
    assert read_table(tmp_path / "a.csv").observation_space.names == ("x; y\t(m)",)
    text = PLAIN.replace("observation.x", '"observation.;\n""x"""')
    (tmp_path / "a.csv").write_text(text)
    assert read_table(tmp_path / "a.csv").observation_space.names == (';\n"x"',)


def test_a_separator_that_could_be_another_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("observation.x", "observation.x (m;s)"))
    message = r"a\.csv: the line with the names of the columns has 3 times ',' \(comma\) and 1 times ';' \(semicolon\)"
    with pytest.raises(DataError, match=message):
        load_demonstrations(path)
    kept = load_demonstrations(path, preparation=Preparation(csv=CsvFormat(separator=",")))
    assert kept.observation_space.names == ("x (m;s)",)
    path.write_text(european("|", "."))
    with pytest.raises(DataError, match="needs a column 'episode'"):
        load_demonstrations(path)
    assert len(load_demonstrations(path, preparation=Preparation(csv=CsvFormat("|")))) == 2


def test_a_decimal_mark_that_could_be_another_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("episode;step;version;observation.x;action.cell\n0;0;1.10;0,5;3,7\n0;1;1.10;1;3,8\n")
    with pytest.raises(DataError, match=r"a decimal comma, but 1\.10 in column version has a decimal point: say"):
        load_demonstrations(path)
    kept = load_demonstrations(path, preparation=Preparation(csv=CsvFormat(decimal=",")))
    assert kept.observations[:, 0].tolist() == [0.5, 1.0]
    assert kept.action_space.signals == (Continuous("cell"),)
    assert kept.attributes["version"].tolist() == ["1.10"]
    kept = load_demonstrations(path, preparation=Preparation(csv=CsvFormat(decimal=".")))
    assert kept.action_space.signals == (Categorical("cell", ("3,7", "3,8")),)
    assert kept.attributes["version"].tolist() == [1.1]


def test_decimal_commas_between_commas_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('episode,step,observation.x,action.cell\n0,0,"0,5","3,7"\n0,1,"1,5","3,8"\n')
    assert load_demonstrations(path).action_space.signals == (Categorical("cell", ("3,7", "3,8")),)
    with pytest.raises(DataError, match="cannot be both the separator of columns and the decimal mark"):
        load_demonstrations(path, preparation=Preparation(csv=CsvFormat(",", ",")))
    kept = load_demonstrations(path, preparation=Preparation(csv=CsvFormat(decimal=",")))
    assert kept.actions[:, 0].tolist() == [3.7, 3.8]


def test_decimal_commas_that_were_not_named_are_suspected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.csv"
    for count in (5, 30):
        rows = [f'0,{step},"{step},5",go\n' for step in range(count)]
        path.write_text("".join(["episode,step,observation.x,action.key\n", *rows]))
        if count == 5:
            call("data", "validate", path)
            said = "column observation.x: is a category, but has values such as '0,5': are they numbers with a decimal"
        else:
            with pytest.raises(SystemExit):
                call("data", "validate", path)
            said = "column observation.x: holds 30 different texts, such as '0,5': are they numbers with a decimal"
        shown = " ".join(capsys.readouterr().out.split())
        assert said in shown
        assert "--decimal , reads them as numbers, of CSV files; or --categorical observation.x" in shown
        call("data", "validate", path, "--decimal", ",")
        assert "is sound" in " ".join(capsys.readouterr().out.split())


def test_text_among_numbers_with_commas(tmp_path: Path) -> None:
    rows = [f"0;{step};{step},5;go" for step in range(30)]
    rows[7] = "0;7;lost;go"
    (tmp_path / "a.csv").write_text("\n".join(["episode;step;observation.x;action.key", *rows, ""]))
    (issue,) = validate(tmp_path / "a.csv")
    assert str(issue).startswith("episode 0, step 7, column observation.x: is no number, got 'lost'")
    kept = Source(str(tmp_path / "a.csv"), Reading(null=("lost",), missing=("linear",))).load()
    np.testing.assert_allclose(kept.observations[:, 0], np.arange(30) + 0.5)


@pytest.mark.parametrize(
    ("encoding", "said"),
    [("utf-16", "text in UTF-16, not UTF-8"), ("utf-16-be", "text in UTF-16, not"), ("cp1252", "not UTF-8 text")],
)
@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_other_encodings_are_refused(
    tmp_path: Path, encoding: str, said: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = PLAIN.replace("stay", "zurück").encode(encoding)
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    shown = " ".join(refused(capsys, "data", "info", tmp_path / name).split())
    assert f"the name says text, but the contents are {said}" in shown
    assert "save it as UTF-8" in shown


@pytest.mark.parametrize(("separator", "decimal"), [(";;", None), ("", None), ('"', None), (None, "'"), (";", ";")])
def test_formats_that_cannot_be(separator: str | None, decimal: str | None) -> None:
    with pytest.raises(DataError, match=r"needs to be|cannot be both"):
        CsvFormat(separator, decimal)


def test_a_file_of_ours_that_a_spreadsheet_saved_again(tmp_path: Path) -> None:
    (tmp_path / "plain.csv").write_text(PLAIN)
    kept = load_demonstrations(tmp_path / "plain.csv")
    save_demonstrations(kept, tmp_path / "ours.csv")
    head, rows = (tmp_path / "ours.csv").read_text().split("\n", 1)
    (tmp_path / "ours.csv").write_text(head.replace(",", ";") + "\n" + elsewhere(rows, ";", ","))
    assert_same(load_demonstrations(tmp_path / "ours.csv"), kept)


@quick
@given(kept=demonstrations())
def test_tabs_lose_nothing(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    path = tmp_path_factory.mktemp("tabs") / "a.tsv"
    save_demonstrations(kept, path)
    assert "\t" in path.read_text(encoding="utf-8").splitlines()[0]
    assert_same(load_demonstrations(path), kept)


@quick
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_every_number_is_the_same_with_a_comma(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    path = tmp_path_factory.mktemp("commas") / "a.csv"
    path.write_text("n;x\n" + "".join(f"{at};{str(x).replace('.', ',')}\n" for at, x in enumerate([0.5, *values])))
    assert read_csv(path)[0]["x"].to_pylist() == [0.5, *values]


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("right\n", '"right\n', 3),
        ("stay\n", '"stay\n', 5),
        ("left\n1,1", '"le""ft\n1,1', 4),
        ("left\n0", '"le\n""ft"\n0', None),
        ("1,0,2", '1,0,"2', 4),
        ("0,0,0.5,left\n", '0,0,"0.5","le,"\n"0,0,0.5,left\n', 3),
    ],
)
def test_a_quote_that_is_never_closed(
    tmp_path: Path, old: str, new: str, line: int | None, end: str, name: str
) -> None:
    content = PLAIN.replace(old, new, 1).replace("\n", end).encode("utf-8-sig")
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    found = [str(issue) for issue in validate(tmp_path / name)]
    said = f"{tmp_path / name}: line {line} has a quote that is never closed: all behind it would be one value"
    assert found == ([] if line is None else [said])


def test_an_open_quote_before_much_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tvae.data.csv_files._BLOCK_BYTES", 64)
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("right", '"right') + "2,0,0.5,left\n" * 40)
    with pytest.raises(DataError, match=r"a\.csv: line 3 has a quote that is never closed"):
        load_demonstrations(path)


def test_quotes_that_open_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(PLAIN.replace("left", '5" disk', 1).replace("right", '"a,""b"') + '1,2,0.5,"two\nlines"\n')
    kept = load_demonstrations(path)
    assert kept.action_space.signals == (Categorical("key", ('5" disk', 'a,"b', "left", "stay", "two\nlines")),)


def test_every_command_reads_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{e}|{t}|{e * t},5|{'left' if e % 2 else 'right'}" for e in range(12) for t in range(3)]
    path.write_text("\n".join(["episode|step|observation.x|action.key", *rows, ""]))
    said = ("--separator", "|", "--decimal", ",")
    call("data", "validate", path, *said)
    call("data", "info", path, *said)
    assert "12 episodes, 36 steps" in " ".join(capsys.readouterr().out.split())
    run = tmp_path / "run"
    call("fit", path, *said, "--out", run, "--training.num-steps", "2", "--training.evaluate-every", "1")
    capsys.readouterr()
    for verb, more in (("embed", ()), ("score", ("--count", "1"))):
        call(verb, run, path, "--out", tmp_path / f"{verb}.parquet", *more)  # as the run's own were read
        assert "12 sessions" in " ".join(capsys.readouterr().out.split())
    call("data", "convert", path, tmp_path / "b.csv", "--separator", "|")
    (tmp_path / "c.csv").write_text(european("\t", "."))
    call("data", "info", tmp_path / "c.csv", "--separator", "tab")
    assert "2 episodes, 4 steps" in " ".join(capsys.readouterr().out.split())
