"""Any demonstrations: every kind of signal, with and without final observations, facts of every type."""

from __future__ import annotations

import string

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.spaces import Angular, Binary, Categorical, Continuous, Signal, Space

quick = settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=4)
names = st.text(string.ascii_letters + string.digits + "._/- äß%", min_size=1, max_size=5)
integers = st.integers(-(2**53), 2**53)
floats = st.floats(allow_nan=False, allow_infinity=False)
singles = st.floats(-3.4e38, 3.4e38)
"""Of signals, with which models compute in single precision."""


@st.composite
def signals(draw: st.DrawFn, name: str) -> Signal:
    kind = draw(st.sampled_from([Continuous, Angular, Binary, Categorical]))
    if kind is Angular:
        return Angular(name, recorded_in_degrees=draw(st.booleans()))
    if kind is not Categorical:
        return kind(name)
    some = {"min_size": 1, "max_size": 3, "unique": True}
    first = draw(st.integers(-3, 3))
    return Categorical(
        name,
        draw(
            st.one_of(
                st.just(tuple(range(first, first + 3))),
                st.lists(st.integers(-100, 100), **some).map(tuple),
                st.lists(texts, **some).map(tuple),
                st.lists(st.one_of(st.integers(0, 9), st.sampled_from("abc")), **some).map(tuple),
            )
        ),
    )


@st.composite
def spaces(draw: st.DrawFn) -> Space:
    chosen = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    return Space(tuple(draw(signals(name)) for name in chosen))


@st.composite
def rows(draw: st.DrawFn, space: Space, count: int) -> np.ndarray:
    def values(signal: Signal) -> st.SearchStrategy:
        match signal:
            case Continuous():
                return singles
            case Angular():
                return st.one_of(st.floats(-np.pi, np.pi), st.floats(-10, 10))
            case Binary():
                return st.sampled_from([0.0, 1.0])
            case Categorical(_, categories):
                return st.integers(0, len(categories) - 1).map(float)

    columns = [draw(st.lists(values(s), min_size=count, max_size=count)) for s in space.signals]
    return np.array(columns, dtype=np.float64).T


FACTS = {"text": texts, "count": integers, "height": floats, "flag": st.booleans()}


@st.composite
def demonstrations(draw: st.DrawFn) -> Demonstrations:
    observation_space, action_space = draw(spaces()), draw(spaces())
    identities = draw(
        st.one_of(
            st.lists(texts, min_size=1, max_size=3, unique=True),
            st.lists(integers, min_size=1, max_size=3, unique=True),
        )
    )
    step_kinds = draw(st.sets(st.sampled_from(sorted(FACTS))))
    rewards, ends = draw(st.booleans()), draw(st.booleans())
    attributes = st.sampled_from(["label", "group", "seed", "a/b"])
    attribute_kinds = draw(st.dictionaries(attributes, st.sampled_from(sorted(FACTS))))
    episodes = []
    for identity in identities:
        length = draw(st.integers(1, 4))

        def column(values: st.SearchStrategy, length: int = length) -> np.ndarray:
            return np.array(draw(st.lists(values, min_size=length, max_size=length)))

        steps = {f"info.{kind}": column(FACTS[kind]) for kind in sorted(step_kinds)}
        if rewards:
            steps["reward"] = column(floats)
        if ends:
            steps |= {name: column(st.booleans()) for name in ("terminated", "truncated")}
        episodes.append(
            Trajectory(
                draw(rows(observation_space, length + draw(st.integers(0, 1)))),
                draw(rows(action_space, length)),
                steps,
                {"episode": identity, **{name: draw(FACTS[kind]) for name, kind in attribute_kinds.items()}},
            )
        )
    return Demonstrations.from_trajectories(episodes, observation_space, action_space)


def assert_same(left: Demonstrations, right: Demonstrations) -> None:
    """Every number, fact and name is the same, to the last bit."""
    assert left.observation_space == right.observation_space
    assert left.action_space == right.action_space
    assert len(left) == len(right)
    assert left.steps.keys() == right.steps.keys()
    assert left.attributes.keys() == right.attributes.keys()
    for name in left.steps:
        assert left.steps[name].dtype.kind == right.steps[name].dtype.kind
    for name in left.attributes:
        assert left.attributes[name].dtype.kind == right.attributes[name].dtype.kind
    for mine, theirs in zip(left, right, strict=True):
        np.testing.assert_array_equal(mine.observations, theirs.observations)
        np.testing.assert_array_equal(mine.actions, theirs.actions)
        for name, values in mine.steps.items():
            np.testing.assert_array_equal(values, theirs.steps[name])
        assert mine.attributes == theirs.attributes
