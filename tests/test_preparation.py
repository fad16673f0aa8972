"""Recordings as they come: missing values, uneven steps, several players."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_strategies import quick
from tvae.data.demonstrations import Demonstrations
from tvae.data.estimates import drop_episode, hold_last, interpolate
from tvae.data.preparation import Clock, Preparation
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.trajectory import DataError
from tvae.data.validation import validate


def load(columns: dict[str, Any], **preparation: Any) -> Demonstrations:
    angular = [name for name in columns if name.endswith("heading")]
    return load_demonstrations(pa.table(columns), angular=angular, preparation=Preparation(**preparation))


def issues(columns: dict[str, Any], **preparation: Any) -> list[str]:
    return [str(issue) for issue in validate(pa.table(columns), preparation=Preparation(**preparation))]


# Missing values

NO_VALUE = "is missing or not a number, and the rule has no value for it"
GAPS = {
    "episode": [0, 0, 0, 0, 1, 1],
    "step": [0, 1, 2, 3, 0, 1],
    "observation.x": [1.0, None, None, 4.0, 5.0, 6.0],
    "observation.heading": [3.0, None, -3.0, None, 0.0, 0.0],
    "observation.room": ["hall", None, "attic", "attic", "hall", "hall"],
    "action.go": [True, None, False, None, True, None],
}


def test_missing_values_are_refused_with_counts_and_places() -> None:
    assert issues(GAPS) == [
        "episode 0, step 1, column observation.x: is missing or not a number (2 times)",
        "episode 0, step 1, column observation.heading: is missing or not a number (2 times)",
        "episode 0, step 1, column observation.room: is missing or not a number",
        "episode 0, step 1, column action.*: is empty, which only the last row of an episode may be",
    ]


def test_the_last_value_holds() -> None:
    kept = load(GAPS, missing=hold_last)
    assert kept[0].observations.tolist() == [[1, 3, 1], [1, 3, 1], [1, -3, 0], [4, -3, 0]]
    assert kept[0].actions.tolist() == [[1], [1], [0]]
    assert kept.final_observed.tolist() == [True, True]
    first = {**GAPS, "observation.x": [None, None, 3.0, 4.0, 5.0, 6.0]}
    assert issues(first, missing=hold_last) == [
        f"episode 0, step 0, column observation.x: {NO_VALUE} (2 times)"
    ]


def test_the_straight_line_between_values() -> None:
    known_end = {**GAPS, "observation.heading": [3.0, None, -3.0, -3.0, 0.0, 0.0]}
    kept = load(known_end, missing=interpolate)
    assert kept[0].observations[:, 0].tolist() == [1, 2, 3, 4]
    assert abs(kept[0].observations[1, 1]) == pytest.approx(np.pi)
    assert kept[0].observations[:, 2].tolist() == [1, 1, 0, 0]
    assert issues(GAPS, missing=interpolate) == [
        f"episode 0, step 3, column observation.heading: {NO_VALUE}"
    ]


def test_episodes_that_lack_a_value_are_left_out() -> None:
    kept = load({**GAPS, "label": list("aaaabb")}, missing=drop_episode)
    assert kept.attributes["episode"].tolist() == [1]
    assert kept.attributes["label"].tolist() == ["b"]
    assert kept[0].observations.tolist() == [[5, 0, 1], [6, 0, 1]]
    holes = {**GAPS, "observation.x": [1.0, None, None, 4.0, 5.0, None]}
    assert issues(holes, missing=drop_episode) == ["all 2 episodes lack a value and are left out"]


def test_a_rule_fills_no_whole_episode() -> None:
    holes = {**GAPS, "observation.x": [1.0, 2.0, 3.0, 4.0, None, None]}
    assert issues(holes, missing=hold_last) == [
        f"episode 1, step 0, column observation.x: {NO_VALUE} (2 times)"
    ]


# Uneven steps


def test_times_instead_of_steps() -> None:
    columns = {
        "episode": [0, 0, 0, 1],
        "t": [0.2, 0.0, 0.1, 7.0],
        "observation.x": [3.0, 1.0, 2.0, 9.0],
        "action.go": [True, False, True, True],
    }
    kept = load(columns, clock=Clock("t"))
    assert kept[0].observations[:, 0].tolist() == [1, 2, 3]
    assert kept[0].steps["t"].tolist() == [0, 0.1, 0.2]
    assert kept.lengths.tolist() == [3, 1]
    assert issues(columns, clock=Clock("t", every=0.2)) == [
        "episode 0, step 1, column t: is 0.1 after the row before, but steps are 0.2 apart: resample by a rule"
        " (2 times)"
    ]
    assert issues({**columns, "t": [0.1, 0.0, 0.1, 7.0]}, clock=Clock("t")) == [
        "episode 0, step 2, column t: stands there more than once in the episode"
    ]
    assert issues({**columns, "t": [0.1, None, 0.2, 7.0]}, clock=Clock("t")) == [
        "column t: is missing, first in row 2 of the data"
    ]
    assert issues({**columns, "t": ["a", "b", "c", "d"]}, clock=Clock("t")) == [
        "column t: needs numbers or times, got string"
    ]
    assert issues({**columns, "t": [0.1, np.inf, 0.2, 7.0]}, clock=Clock("t")) == ["column t: needs finite numbers"]
    assert issues(columns, clock=Clock("seconds")) == [
        "needs a column 'seconds'; the columns are episode, t, observation.x, action.go"
    ]


UNEVEN = {
    "episode": [0, 0, 0, 0, 0],
    "t": [10.0, 10.5, 11.0, 13.0, 14.0],
    "observation.x": [0.0, 5.0, 1.0, 3.0, 4.0],
    "action.dx": [1.0, 9.0, 1.0, 3.0, None],
    "action.jump": [False, True, False, False, None],
    "reward": [1.0, 2.0, 3.0, 4.0, None],
    "terminated": [False, False, False, True, None],
    "note": ["a", "b", "c", "d", None],
}


def test_uneven_steps_are_resampled_by_interpolation() -> None:
    kept = load(UNEVEN, clock=Clock("t", every=1.0, resample=interpolate))
    assert kept[0].observations[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert kept[0].actions.tolist() == [[1, 1], [1, 0], [2, 0], [3, 0]]
    assert kept[0].steps["reward"].tolist() == [3, 3, 0, 4]
    assert kept[0].steps["terminated"].tolist() == [False, False, False, True]
    assert kept[0].steps["note"].tolist() == ["a", "c", "c", "d"]
    assert kept[0].steps["t"].tolist() == [10, 11, 12, 13]


def test_one_time_of_another_kind_makes_no_endless_episode() -> None:
    times = [5.0, 6.0, 0.0, 1.7e9, 1.7e9 + 1, 1.7e9 + 2]
    columns = {"episode": list("aabbbb"), "t": times, "observation.x": [0.5] * 6, "action.a": [0.5] * 6}
    (found,) = issues(columns, clock=Clock("t", resample=hold_last))
    assert found == (
        "episode b, step 1, column t: is 1,700,000,000 after the row before; at a step every 1 the episode's 4 rows "
        "would become 1,700,000,003 steps, more than 1,000 times as many: mend the time, or say a longer one from step "
        "to step (--every)"
    )
    longer = load(columns, clock=Clock("t", every=1e6, resample=hold_last))
    assert longer.lengths.tolist() == [1, 1701]
    (found,) = issues({**columns, "t": [*times[:5], 1e300]}, clock=Clock("t", resample=hold_last))
    assert found.startswith("episode b, step 3, column t: is 1e+300 after the row before")


def test_uneven_steps_are_resampled_by_holding() -> None:
    kept = load(UNEVEN, clock=Clock("t", every=1.0, resample=hold_last))
    assert kept[0].observations[:, 0].tolist() == [0, 1, 1, 3, 4]
    assert kept[0].actions[:, 0].tolist() == [1, 1, 1, 3]
    coarse = load(UNEVEN, clock=Clock("t", every=1.5, resample=hold_last))
    assert coarse[0].observations[:, 0].tolist() == [0, 1, 3]
    assert coarse.final_observed.tolist() == [False]
    assert coarse[0].actions.tolist() == [[1, 1], [1, 0], [3, 0]]
    assert coarse[0].steps["terminated"].tolist() == [False, False, True]
    assert coarse[0].steps["reward"].sum() == 10


def test_resampling_hides_nothing_that_is_missing() -> None:
    holes = {**UNEVEN, "reward": [1.0, None, 3.0, 4.0, None], "terminated": [False, None, False, True, None]}
    assert issues(holes, clock=Clock("t", every=1.0, resample=hold_last)) == [
        "episode 0, step 1, column reward: is missing or not a number",
        "episode 0, step 1, column terminated: is missing or not a number",
    ]


def test_times_of_the_day() -> None:
    clock = pa.array([0, 1, 2, 4, 5], pa.time32("s"))
    kept = load({**UNEVEN, "t": clock}, clock=Clock("t", every=1.0, resample=hold_last))
    assert kept[0].observations[:, 0].tolist() == [0, 5, 1, 1, 3, 4]
    assert kept[0].steps["t"].tolist() == ["00:00:00", "00:00:01", "00:00:02", "00:00:02", "00:00:04"]


def test_dates_and_times() -> None:
    moments = pa.array([0, 500, 1000, 3000, 4000], pa.timestamp("ms"))
    kept = load({**UNEVEN, "t": moments}, clock=Clock("t", every=1.0, resample=interpolate))
    assert kept[0].observations[:, 0].tolist() == [0, 1, 2, 3, 4]
    assert kept[0].steps["t"].tolist()[2].startswith("1970-01-01 00:00:02")


@settings(quick, max_examples=10)
@given(
    st.lists(st.integers(1, 6), min_size=1, max_size=3),
    st.sampled_from([hold_last, interpolate]),
    st.sampled_from([0.1, 1.0, 0.25]),
    st.booleans(),
)
def test_even_steps_stay_as_they_are(lengths: list[int], rule: Any, every: float, final: bool) -> None:
    rng = np.random.default_rng(sum(lengths))
    steps = np.concatenate([np.arange(length + final) for length in lengths])
    member = np.repeat(np.arange(len(lengths)), np.array(lengths) + final)
    count = len(steps)
    acting = np.ones(count, np.bool_)
    if final:
        acting[np.cumsum(np.array(lengths) + 1) - 1] = False
    columns = {
        "episode": member,
        "step": steps,
        "t": 17.3 + steps * every,
        "observation.x": rng.normal(size=count),
        "observation.heading": rng.uniform(-9, 9, size=count),
        "action.dx": pa.array(rng.normal(size=count), mask=~acting),
        "action.go": pa.array(rng.random(count) < 0.5, mask=~acting),
        "reward": pa.array(rng.normal(size=count), mask=~acting),
    }
    kept, again = load(columns), load(columns, clock=Clock("t", every=every, resample=rule))
    np.testing.assert_array_equal(again.observations, kept.observations)
    np.testing.assert_array_equal(again.actions, kept.actions)
    np.testing.assert_array_equal(again.steps["reward"], kept.steps["reward"])
    assert again.lengths.tolist() == kept.lengths.tolist()
    assert again.final_observed.tolist() == kept.final_observed.tolist()


@pytest.mark.parametrize(("options", "message"), [({"every": 0.0}, "every needs"), ({"tolerance": 0.5}, "tolerance")])
def test_clocks_that_make_no_sense(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Clock("t", **options)


# Several players

PLAYED = {
    "episode": [0, 0, 0, 0, 1],
    "step": [0, 0, 1, 1, 0],
    "player": ["anna", "bert", "anna", "bert", "anna"],
    "observation.x": [0.0, 10.0, 1.0, 11.0, 2.0],
    "action.dx": [1.0, -1.0, 1.0, -1.0, 1.0],
}


def test_each_player_has_an_episode() -> None:
    assert issues(PLAYED) == ["episode 0, step 0, column step: stands there more than once (2 times)"]
    kept = load(PLAYED, player="player")
    assert kept.attributes["episode"].tolist() == ["0/anna", "0/bert", "1/anna"]
    assert kept.attributes["session"].tolist() == [0, 0, 1]
    assert kept.attributes["player"].tolist() == ["anna", "bert", "anna"]
    assert kept[1].observations[:, 0].tolist() == [10, 11]


def test_players_that_are_refused() -> None:
    assert issues({**PLAYED, "player": ["anna", None, "anna", "bert", "anna"]}, player="player") == [
        "column player: is missing, first in row 2 of the data"
    ]
    assert issues({**PLAYED, "session": [1] * 5}, player="player") == [
        "column session: is there already, but names the episode that players share"
    ]
    alike = {**PLAYED, "episode": ["a", "a/b", "a", "a/b", "c"], "player": ["b/c", "c", "b/c", "c", "d"]}
    assert issues(alike, player="player") == ["column player: and the episode look alike when joined by /"]
    with pytest.raises(DataError, match="needs a column 'hero'; the columns are episode, step, player"):
        load(PLAYED, player="hero")


@pytest.mark.parametrize("name", ["walks.parquet", "walks.csv"])
def test_what_we_wrote_is_not_told_apart_or_timed_again_for_a_model(tmp_path: Path, name: str) -> None:
    """Sessions of a model are read as its own were, also those that are converted already or that it imagined."""
    timed = {**PLAYED, "seconds": [0.0, 0.0, 0.5, 0.5, 0.0]}
    preparation = Preparation(player="player", clock=Clock("seconds", every=0.5))
    walks = load_demonstrations(pa.table(timed), preparation=preparation)
    spaces = {"observation_space": walks.observation_space, "action_space": walks.action_space}
    for known in (walks.attributes, {"episode": walks.attributes["episode"]}):
        converted = replace(walks, attributes=known, steps=walks.steps if "player" in known else {})
        save_demonstrations(converted, tmp_path / name, overwrite=True)
        again = load_demonstrations(tmp_path / name, preparation=preparation, **spaces)
        assert again.attributes["episode"].tolist() == ["0/anna", "0/bert", "1/anna"]
        assert again.observations.tolist() == walks.observations.tolist()
        with pytest.raises(DataError, match=r"session: is there already|needs a column 'player'"):
            load_demonstrations(tmp_path / name, preparation=preparation)
    others = load_demonstrations(pa.table(timed), preparation=preparation, **spaces)  # what others wrote is prepared
    assert others.attributes["episode"].tolist() == ["0/anna", "0/bert", "1/anna"]


def test_all_at_once() -> None:
    columns = {
        "episode": [0] * 6,
        "player": [1, 2, 1, 2, 1, 2],
        "t": [0.0, 0.1, 1.0, 1.1, 3.0, 3.1],
        "observation.x": [0.0, 5.0, None, 6.0, 3.0, 7.0],
        "action.a": [1.0, 2.0, 1.0, 2.0, 1.0, 2.0],
    }
    kept = load(columns, player="player", clock=Clock("t", every=1.0, resample=hold_last), missing=interpolate)
    assert kept.attributes["episode"].tolist() == ["0/1", "0/2"]
    assert kept[0].observations[:, 0].tolist() == [0, 1, 1, 3]
    assert kept[1].observations[:, 0].tolist() == [5, 6, 6, 7]
