import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_strategies import quick, rows, spaces
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space, describe, kind_name

MIXED = Space((Continuous("x"), Angular("heading"), Categorical("move", ("left", "right")), Binary("jump")))


def test_columns_of_each_kind() -> None:
    assert MIXED.continuous.tolist() == [0]
    assert MIXED.angular.tolist() == [1]
    assert MIXED.categorical.tolist() == [2]
    assert MIXED.binary.tolist() == [3]
    assert MIXED.num_categories == (2,)
    assert MIXED.num_columns == 4
    assert MIXED.num_features == 1 + 2 + 2 + 1
    assert MIXED.column("move") == 2


def test_kinds_in_words() -> None:
    assert [kind_name(signal) for signal in MIXED.signals] == [
        "continuous",
        "angular",
        "categorical",
        "binary",
    ]
    assert [describe(signal) for signal in MIXED.signals][2] == "categorical (2)"


def test_unknown_column_says_which_there_are() -> None:
    with pytest.raises(KeyError, match="no signal 'y'; there are x, heading, move, jump"):
        MIXED.column("y")


def test_names_are_unique() -> None:
    with pytest.raises(ValueError, match="must be unique, got x"):
        Space((Continuous("x"), Binary("x")))


@pytest.mark.parametrize("categories", [(), ("a", "a")])
def test_categories_differ_and_are_there(categories: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="categor"):
        Categorical("move", categories)


@pytest.mark.parametrize(
    ("row", "column", "message"),
    [
        ([np.nan, 0, 0, 0], "x", "needs a finite number, got nan"),
        ([0, np.inf, 0, 0], "heading", "needs a finite number, got inf"),
        ([-1e300, 0, 0, 0], "x", "needs a number of at most 3.4e38 in size, got -1e+300"),
        ([0, 0, 2, 0], "move", "needs a category index from 0 to 1, got 2"),
        ([0, 0, 0.5, 0], "move", "needs a category index from 0 to 1, got 0.5"),
        ([0, 0, -1, 0], "move", "needs a category index from 0 to 1, got -1"),
        ([0, 0, 0, 2], "jump", "is binary and needs 0 or 1, got 2"),
    ],
)
def test_first_problem(row: list[float], column: str, message: str) -> None:
    problem = MIXED.first_problem(np.array([[1.0, 9.0, 1.0, 1.0], row, [np.nan] * 4]))
    assert problem is not None
    assert (problem.row, problem.column, problem.message) == (1, column, message)


@quick
@given(st.data(), spaces(), st.integers(1, 4))
def test_what_a_space_describes_is_no_problem(data: st.DataObject, space: Space, count: int) -> None:
    assert space.first_problem(data.draw(rows(space, count))) is None


@quick
@given(spaces())
def test_json_gives_the_same_space(space: Space) -> None:
    assert Space.from_json(space.to_json()) == space
    assert space.differences(Space.from_json(space.to_json())) == []


def test_json_of_an_unknown_kind() -> None:
    with pytest.raises(ValueError, match=r"signal kind must be one of .*, got 'colour'"):
        Space.from_json([{"kind": "colour", "name": "x"}])


def test_differences_name_both_sides() -> None:
    other = Space((Continuous("a"), Continuous("b"), Categorical("c", (0, 1, 2))))
    assert MIXED.differences(other) == [
        "4 signals against 3",
        "signal 1 is angular ('heading') against continuous ('b')",
        "signal 2 is categorical (2) ('move') against categorical (3) ('c')",
    ]
