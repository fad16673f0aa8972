from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_strategies import assert_same, demonstrations, quick
from tvae.data.arrays import from_arrays
from tvae.data.demonstrations import Demonstrations
from tvae.data.segments import segment, segment_at_event, segment_by_column
from tvae.data.sources import load_demonstrations
from tvae.data.tabular import read_table, write_parquet
from tvae.data.trajectory import DataError


def recordings(*lengths: int, final: bool = True) -> Demonstrations:
    return from_arrays(
        [np.arange(length + final, dtype=float) + 100 * index for index, length in enumerate(lengths)],
        [np.arange(length, dtype=float) for length in lengths],
        labels=[f"style {index}" for index in range(len(lengths))],
    )


def test_segments_cover_a_recording() -> None:
    parts = segment(recordings(7, 2, 4), 3)
    assert parts.lengths.tolist() == [3, 3, 1, 2, 3, 1]
    assert parts.attributes["episode"].tolist() == list(range(6))
    assert parts.attributes["recording"].tolist() == [0, 0, 0, 1, 2, 2]
    assert parts.attributes["segment"].tolist() == [0, 1, 2, 0, 0, 1]
    assert parts.attributes["label"].tolist() == [f"style {index}" for index in (0, 0, 0, 1, 2, 2)]
    assert parts[1].observations[:, 0].tolist() == [3, 4, 5, 6]
    assert parts[1].actions[:, 0].tolist() == [3, 4, 5]
    assert parts[3].observations[:, 0].tolist() == [100, 101, 102]


def test_the_end_is_observed_inside_a_recording() -> None:
    parts = segment(recordings(7, final=False), 3)
    assert parts.final_observed.tolist() == [True, True, False]
    assert parts[2].observations[:, 0].tolist() == [6]


@pytest.mark.parametrize(
    ("length", "stride", "minimum", "starts", "lengths"),
    [
        (4, 2, 1, [0, 2, 4, 6], [4, 4, 4, 4]),
        (4, 3, 1, [0, 3, 6], [4, 4, 4]),
        (4, 4, 1, [0, 4, 8], [4, 4, 2]),
        (4, 4, 3, [0, 4], [4, 4]),
        (2, 9, 1, [0, 9], [2, 1]),
        (2, 10, 1, [0], [2]),
        (50, 1, 1, [0], [10]),
    ],
)
def test_stride_and_minimum(
    length: int, stride: int, minimum: int, starts: list[int], lengths: list[int]
) -> None:
    parts = segment(recordings(10), length, stride=stride, minimum=minimum)
    assert [part.observations[0, 0] for part in parts] == starts
    assert parts.lengths.tolist() == lengths


@quick
@given(demonstrations(), st.integers(1, 5))
def test_segments_joined_are_the_recordings(
    tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations, length: int
) -> None:
    parts = segment(kept, length)
    assert parts.num_steps == kept.num_steps
    assert np.array_equal(np.concatenate([part.actions for part in parts]), kept.actions)
    for name, values in kept.steps.items():
        assert np.array_equal(np.concatenate([part.steps[name] for part in parts]), values)
    for part in parts:
        assert part.attributes["recording"] in kept.attributes["episode"]
    path = tmp_path_factory.mktemp("segments") / "a.parquet"
    write_parquet(parts, path)
    assert_same(read_table(path), parts)


def test_a_split_keeps_recordings_whole() -> None:
    train, held_out = segment(recordings(9, 9, 9, 9), 2).split(0.5, group="recording")
    assert not set(train.attributes["recording"]) & set(held_out.attributes["recording"])


def test_what_cannot_be_cut() -> None:
    with pytest.raises(DataError, match="no segment has 5 steps or more; the longest episode has 4"):
        segment(recordings(4, 3), 6, minimum=5)
    with pytest.raises(DataError, match="attribute 'recording' already: they are segments"):
        segment(segment(recordings(4), 2), 1)
    for wrong in ({"length": 0}, {"length": 3, "stride": 0}, {"length": 3, "minimum": 4}):
        with pytest.raises(ValueError, match="length and stride need to be at least 1"):
            segment(recordings(4), **wrong)


def levels() -> Demonstrations:
    table = pa.table(
        {
            "episode": ["a"] * 5 + ["b"] * 3,
            "step": [0, 1, 2, 3, 4, 0, 1, 2],
            "observation.x": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
            "action.go": [True, False, False, True, None, True, True, False],
            "level": ["one", "two", "two", "one", None, "one", "one", "one"],
            "goal": [0, 0, 1, 0, 0, 0, 1, 0],
        }
    )
    return load_demonstrations(table)


def test_cut_where_a_column_changes() -> None:
    parts = segment_by_column(levels(), "level")
    assert parts.lengths.tolist() == [1, 2, 1, 3]
    assert parts.final_observed.tolist() == [True, True, True, False]
    assert parts.attributes["recording"].tolist() == ["a", "a", "a", "b"]
    assert parts.attributes["segment"].tolist() == [0, 1, 2, 0]
    assert parts[1].observations[:, 0].tolist() == [1, 2, 3]
    assert parts[2].observations[:, 0].tolist() == [3, 4]
    assert segment_by_column(levels(), "observation.x").lengths.tolist() == [1] * 7
    assert segment_by_column(levels(), "episode").lengths.tolist() == [4, 3]


def test_cut_behind_an_event() -> None:
    parts = segment_at_event(levels(), "goal")
    assert parts.lengths.tolist() == [3, 1, 2, 1]
    assert parts[0].observations[:, 0].tolist() == [0, 1, 2, 3]
    assert segment_at_event(levels(), "action.go").lengths.tolist() == [1, 3, 1, 1, 1]


@quick
@given(demonstrations(), st.integers(0, 99))
def test_segments_by_a_column_joined_are_the_recordings(kept: Demonstrations, seed: int) -> None:
    chance = np.random.default_rng(seed).random(kept.num_steps) < 0.5
    marked = replace(kept, steps={**kept.steps, "mark": chance})
    for parts in (segment_by_column(marked, "mark"), segment_at_event(marked, "mark")):
        assert np.array_equal(np.concatenate([part.actions for part in parts]), kept.actions)
        assert set(parts.attributes["recording"].tolist()) == set(kept.attributes["episode"].tolist())
    for part in segment_by_column(marked, "mark"):
        assert len(set(part.steps["mark"].tolist())) == 1
    for part in segment_at_event(marked, "mark"):
        assert not part.steps["mark"][:-1].any()


def test_columns_that_cut_nothing() -> None:
    with pytest.raises(DataError, match=r"no column 'z' to cut by; there are: observation\.x, action\.go, level, goal"):
        segment_by_column(levels(), "z")
    with pytest.raises(DataError, match="column level: an event needs to be true or false, got 'one'"):
        segment_at_event(levels(), "level")
    with pytest.raises(DataError, match=r"column observation\.x: an event needs to be true or false, got 2\.0"):
        segment_at_event(levels(), "observation.x")
    with pytest.raises(DataError, match="attribute 'recording' already: they are segments"):
        segment_at_event(segment_by_column(levels(), "level"), "goal")
