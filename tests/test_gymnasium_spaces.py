from collections import OrderedDict
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces as gym
from hypothesis import given
from hypothesis import strategies as st

from data_strategies import quick, rows, spaces
from tvae.gymnasium_spaces import (
    UnsupportedSpaceError,
    flatten,
    gymnasium_from_space,
    named_spaces,
    space_from_gymnasium,
    unflatten,
    wrap,
)
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

shapes = st.sampled_from([(), (1,), (3,), (2, 2)])


@st.composite
def boxes(draw: st.DrawFn) -> gym.Box:
    shape = draw(shapes)
    low, high, dtype = draw(
        st.sampled_from(
            [
                (-np.inf, np.inf, np.float64),
                (0.0, np.inf, np.float32),
                (-1.5, 2.5, np.float32),
                (-np.pi, np.pi, np.float64),
                (-3, 9, np.int32),
                (0, 255, np.uint8),
            ]
        )
    )
    return gym.Box(low, high, shape, dtype)


leaves = st.one_of(
    boxes(),
    st.builds(gym.Discrete, st.integers(1, 5), start=st.integers(-3, 3)),
    st.lists(st.integers(1, 4), min_size=1, max_size=3).map(gym.MultiDiscrete),
    st.just(gym.MultiDiscrete(np.array([[2, 3], [4, 5]]), start=np.array([[1, -1], [0, 7]]))),
    st.sampled_from([gym.MultiBinary(1), gym.MultiBinary(3), gym.MultiBinary((2, 2))]),
)
any_space = st.recursive(
    leaves,
    lambda parts: st.one_of(
        st.dictionaries(st.sampled_from("abc"), parts, min_size=1).map(gym.Dict),
        st.lists(parts, min_size=1, max_size=3).map(gym.Tuple),
    ),
    max_leaves=5,
)


def equal(left: Any, right: Any) -> bool:
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(equal(left[key], right[key]) for key in left)
    if isinstance(left, tuple):
        return len(left) == len(right) and all(map(equal, left, right))
    left, right = np.asarray(left), np.asarray(right)
    return left.dtype == right.dtype and np.array_equal(left, right)


@quick
@given(any_space, st.integers(0, 1000))
def test_unflatten_inverts_flatten(space: gymnasium.Space[Any], seed: int) -> None:
    space.seed(seed)
    value = space.sample()
    row = flatten(space, value)
    signals = space_from_gymnasium(space)
    assert row.shape == (signals.num_columns,)
    assert signals.first_problem(row[None]) is None
    assert equal(unflatten(space, row), value)


@quick
@given(any_space, st.integers(1, 4))
def test_batches_and_episodes_flatten_along_the_last_axis(space: gymnasium.Space[Any], count: int) -> None:
    values = [space.sample() for _ in range(count)]
    batch = gymnasium.vector.utils.concatenate(
        space, values, gymnasium.vector.utils.create_empty_array(space, count)
    )
    together = np.stack([flatten(space, value) for value in values])
    assert np.array_equal(flatten(space, batch), together)
    assert np.array_equal(flatten(space, unflatten(space, together)), together)


@pytest.mark.parametrize(
    ("space", "signals"),
    [
        (gym.Box(0, 1, (2,)), (Continuous("0"), Continuous("1"))),
        (gym.Box(-np.pi, np.pi, ()), (Angular("0"),)),
        (gym.Box(-np.pi, np.pi, (1,), np.float64), (Angular("0"),)),
        (
            gym.Box(np.array([-np.pi, -3.14]), np.array([np.pi, 3.14]), dtype=np.float64),
            (Angular("0"), Continuous("1")),
        ),
        (gym.Discrete(2, start=5), (Categorical("0", (5, 6)),)),
        (gym.MultiDiscrete([2, 1]), (Categorical("0", (0, 1)), Categorical("1", (0,)))),
        (gym.MultiBinary(2), (Binary("0"), Binary("1"))),
        (
            gym.Dict(OrderedDict(go=gym.Discrete(2), at=gym.Box(0, 1, (2,)))),
            (Categorical("go", (0, 1)), Continuous("at.0"), Continuous("at.1")),
        ),
        (
            gym.Tuple((gym.Discrete(1), gym.Dict({"deep": gym.MultiBinary(1)}))),
            (Categorical("0", (0,)), Binary("1.deep")),
        ),
    ],
)
def test_signals_of_each_space(space: gymnasium.Space[Any], signals: tuple[Any, ...]) -> None:
    assert space_from_gymnasium(space).signals == signals


def test_names_are_given() -> None:
    space = space_from_gymnasium(gym.Box(0, 1, (2,)), ["x", "y"])
    assert space.names == ("x", "y")
    with pytest.raises(ValueError, match="2 signals need as many names, got 1: x"):
        space_from_gymnasium(gym.Box(0, 1, (2,)), ["x"])


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (
            gym.Dict({"eye": gym.Box(0, 255, (64, 64, 3), np.uint8)}),
            r"space 'eye' has the shape \(64, 64, 3\) and dtype uint8, 12,288 numbers, as images have: images cannot "
            r"be learned from; supported are Discrete, .* Box of at most 4,096 numbers, and Dict and Tuple of them",
        ),
        (gym.Box(0, 1, (100, 100)), r"the space has the shape \(100, 100\) and dtype float32, .*: images cannot be"),
        (gym.Box(0, 1, (5000,)), r"the space has the shape \(5000,\) and dtype float32, 5,000 numbers, which are"),
        (gym.Text(5), r"the space is Text\(.*\), which is no vector of numbers: supported are"),
        (gym.Dict({"talk": gym.Text(5)}), "space 'talk' is Text.*, which is no vector of numbers: supported are"),
        (gym.Sequence(gym.Discrete(2)), "the space is Sequence.*, which is no vector"),
        (gym.Graph(gym.Box(0, 1), None), "the space is Graph.*, which is no vector"),
    ],
)
def test_what_is_no_vector_is_refused(space: gymnasium.Space[Any], message: str) -> None:
    with pytest.raises(UnsupportedSpaceError, match=message):
        space_from_gymnasium(space)
    with pytest.raises(UnsupportedSpaceError, match=rf"^observations of the environment: {message}.* A wrapper can "):
        named_spaces(space, gym.Discrete(2), {})
    with pytest.raises(UnsupportedSpaceError, match=rf"^actions of the environment: {message}"):
        named_spaces(gym.Discrete(2), space, {"action": ["x"]})


def test_a_value_of_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"needs the shape \(2,\), got \(3,\)"):
        flatten(gym.Box(0, 1, (2,)), np.zeros(3))


def test_numbers_beyond_the_bounds() -> None:
    assert unflatten(gym.Box(0, 255, (3,), np.uint8), np.array([-7.0, 2.7, 300.0])).tolist() == [0, 3, 255]
    assert unflatten(gym.Box(-1, 1, (2,)), np.array([-7.0, 0.5])).tolist() == [-1.0, 0.5]
    angle = gym.Box(-np.pi, np.pi, (3,), np.float64)
    turned = unflatten(angle, np.array([0.1, 0.1 + 2 * np.pi, 0.1 - 4 * np.pi]))
    assert turned[0] == 0.1
    np.testing.assert_allclose(turned, 0.1)


@quick
@given(st.floats(-100, 100))
def test_wrap_keeps_the_direction(angle: float) -> None:
    wrapped = wrap(np.array(angle))
    assert -np.pi <= wrapped <= np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-12)


@quick
@given(st.data(), spaces(), st.integers(1, 4))
def test_a_space_of_our_own_is_read_back(data: st.DataObject, space: Space, count: int) -> None:
    theirs = gymnasium_from_space(space)
    back = space_from_gymnasium(theirs, space.names)
    assert space.differences(back) == []
    raw = data.draw(rows(space, count))
    raw[:, space.angular] = np.clip(raw[:, space.angular], -np.pi, np.pi)
    assert np.array_equal(flatten(theirs, unflatten(theirs, raw)), raw)


def test_the_gymnasium_space_of_one_kind_is_no_dict() -> None:
    assert gymnasium_from_space(Space((Angular("a"),))) == gym.Box(-np.pi, np.pi, (1,), np.float64)
    assert gymnasium_from_space(Space((Binary("a"), Binary("b")))) == gym.MultiBinary(2)
    assert gymnasium_from_space(Space((Categorical("a", (3, 4)),))) == gym.Discrete(2, start=3)
    assert gymnasium_from_space(Space((Categorical("a", (3, 5)),))) == gym.Discrete(2)
    assert gymnasium_from_space(
        Space((Categorical("a", ("x", "y")), Categorical("b", (1, 2, 3))))
    ) == gym.MultiDiscrete([2, 3], start=[0, 1])


@pytest.mark.parametrize("space", [gym.Dict({}), gym.Box(-1, 1, (0,)), gym.Tuple((gym.Dict({}),))])
def test_a_space_without_numbers_is_refused(space: gymnasium.Space):
    with pytest.raises(UnsupportedSpaceError, match="holds no numbers at all: supported are"):
        space_from_gymnasium(space)


def test_a_number_alone_stands_for_an_array_of_one():
    space = gym.Dict({"x": gym.Box(-1, 1, (1,)), "jump": gym.MultiBinary(1), "go": gym.Discrete(3)})
    assert flatten(space, {"x": 0.5, "jump": 1, "go": 2}).tolist() == flatten(
        space, {"x": np.array([0.5]), "jump": np.array([1]), "go": np.int64(2)}
    ).tolist()
