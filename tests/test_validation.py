from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from data_strategies import demonstrations, quick
from tvae.data import validation
from tvae.data.arrays import from_arrays
from tvae.data.demonstrations import Demonstrations
from tvae.data.issues import Issue
from tvae.data.sources import save_demonstrations
from tvae.data.validation import AttributeSummary, SignalSummary, Summary, summarise, validate
from tvae.spaces import Angular, Categorical, Continuous, Space

STRAY = "but most values are: say which texts are missing values, or that the column is categorical"
BAD = """\
episode,step,observation.x,observation.n,action.a,action.b,label
1,0,inf,0,1.0,a,fast
1,1,0.5,1,,a,fast
1,3,,2,1.0,b,fast
2,0,inf,3,1.0,b,
2,0,inf,4,,,slow
3,0,0.5,5,,,slow
"""
OF_ACTIONS = (
    Issue("is missing or not a number, while other actions of the step are there", "action.a", 1, 1),
    Issue("is empty in the whole episode: an episode needs at least one action", "action.*", 3, 0),
    Issue("is missing or not a number", "label", 2, 0),
)


def test_everything_that_is_wrong_at_once(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text(BAD + "".join(f"4,{i},0.5,{i},1.0,a,slow\n" for i in range(30)))
    assert validate(tmp_path / "bad.csv") == [
        Issue("stands there more than once", "step", 2, 0),
        Issue("leaves a gap: it follows step 1", "step", 1, 3),
        Issue("needs a finite number, got inf", "observation.x", 1, 0, 3),
        Issue(
            "holds 30 different integers, more than 20: say whether it is continuous, angular or categorical",
            "observation.n",
        ),
        Issue("is missing or not a number", "observation.x", 1, 3),
        *OF_ACTIONS,
    ]
    assert validate(tmp_path / "bad.csv", continuous=["n"])[3:] == [
        Issue("is missing or not a number", "observation.x", 1, 3),
        *OF_ACTIONS,
    ]


def test_columns_that_are_missing(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("observation.x,speed\n0.5,1\n")
    messages = [str(issue) for issue in validate(tmp_path / "bad.csv", angular=["heading"])]
    assert messages == [
        "needs a column 'episode'; the columns are observation.x, speed",
        "needs a column 'step'",
        "needs at least one column action.*",
        "column heading: was given a kind, but is no column of a signal; these are: observation.x",
    ]


def test_text_among_numbers(tmp_path: Path) -> None:
    rows = [f"1,{i},{i / 8},{i / 8}" for i in range(40)]
    rows[7] = "1,7,ten,10,5"
    rows[9] = "1,9,ten,0.5"
    rows[30] = "1,30,-,0.5"
    (tmp_path / "bad.csv").write_text("\n".join(["episode,step,observation.x,action.a", *rows]))
    stray = f"is no number, got 'ten' or '-', {STRAY}"
    uneven = Issue("line 9 of bad.csv has 5 values, but the first line has 4")
    assert validate(tmp_path / "bad.csv") == [
        uneven,
        Issue("leaves a gap: it follows step 6", "step", 1, 8),
        Issue(stray, "observation.x", 1, 9, 2),
    ]
    assert validate(tmp_path / "bad.csv", categorical=["observation.x"])[2:] == []


def test_columns_are_checked_where_rows_belong_to_no_episode(tmp_path: Path) -> None:
    rows = [f"7,{i},{i / 8 if i != 4 else 'x'},{i},0.5" for i in range(40)]
    rows[3] = "7,,0.5,3,0.5"
    (tmp_path / "bad.csv").write_text("\n".join(["episode,step,observation.x,observation.n,action.a", *rows]))
    stray = f"is no number, got 'x', {STRAY}"
    assert validate(tmp_path / "bad.csv") == [
        Issue("is missing, first in row 4 of the data", "step"),
        Issue(f"{stray}, first in row 5 of the data", "observation.x"),
        Issue(
            "holds 40 different integers, more than 20: say whether it is continuous, angular or categorical",
            "observation.n",
        ),
    ]


@quick
@given(demonstrations())
def test_what_is_sound_has_no_issues(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    directory = tmp_path_factory.mktemp("sound")
    for name in ("a.parquet", "a.csv", "a.tvae"):
        save_demonstrations(kept, directory / name)
        assert validate(directory / name) == []


def test_other_sources_give_the_first_problem(tmp_path: Path) -> None:
    (issue,) = validate(tmp_path / "nowhere")
    assert "no such file" in issue.message
    (tmp_path / "a.csv").write_bytes(b"PAR1")
    (issue,) = validate(tmp_path / "a.csv")
    assert "the contents are Parquet" in issue.message
    save_demonstrations(from_arrays([[0.0]], [[0.0]]), tmp_path / "a.tvae")
    (issue,) = validate(tmp_path / "a.tvae", angular=["action.9"])
    assert "action.9" in issue.message


def test_a_summary() -> None:
    space = Space((Continuous("x"), Angular("heading"), Categorical("room", ("hall", "attic"))))
    kept = from_arrays(
        [
            [[1.0, 3.0, 0.0], [2.0, -3.0, 1.0], [3.0, 3.0, 1.0]],
            [[6.0, -3.0, 1.0]],
        ],
        [[True, False], [False]],
        observation_space=space,
        labels=["fast", "slow"],
    )
    summary = summarise(kept)
    x, heading, room, jump = summary.signals
    assert x == SignalSummary("observation.x", "continuous", 1.0, 3.0, 6.0, ())
    assert heading.mean is not None
    assert abs(heading.mean) == pytest.approx(np.pi)
    assert (heading.kind, heading.minimum, heading.maximum) == ("angular", -3.0, 3.0)
    assert room.frequencies == (("hall", 0.25), ("attic", 0.75))
    assert room.kind == "categorical (2)"
    assert jump.column == "action.0"
    assert dict(jump.frequencies) == pytest.approx({"0": 2 / 3, "1": 1 / 3})
    assert summary == Summary(
        num_episodes=2,
        num_steps=3,
        length_quantiles=(1.0, 1.25, 1.5, 1.75, 2.0),
        num_final_observed=1,
        signals=summary.signals,
        steps=(),
        attributes=(
            AttributeSummary("episode", 2, ((0, 1), (1, 1))),
            AttributeSummary("label", 2, (("fast", 1), ("slow", 1))),
        ),
    )


@quick
@given(demonstrations())
def test_parts_make_the_same_summary(kept: Demonstrations) -> None:
    whole = summarise(kept)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "_BLOCK_STEPS", 1)
        parts = summarise(kept)
    for mine, theirs in zip(whole.signals, parts.signals, strict=True):
        assert (mine.minimum, mine.maximum) == (theirs.minimum, theirs.maximum)
        assert mine.frequencies == theirs.frequencies
    chosen = summarise(kept.select([0]))
    rows = kept[0].actions
    for index, signal in enumerate(chosen.signals[len(kept.observation_space.signals) :]):
        if signal.minimum is not None:
            assert (signal.minimum, signal.maximum) == (rows[:, index].min(), rows[:, index].max())
