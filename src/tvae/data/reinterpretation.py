"""The same recordings with other kinds of signals."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from tvae.data.columns import KindError, decode, encode, signal_of
from tvae.data.degrees import RADIANS_PER_DEGREE, angles, noted, radians_issue, with_degrees
from tvae.data.demonstrations import Demonstrations
from tvae.data.table_roles import named_kinds
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.data.trajectory import DataError
from tvae.spaces import FloatArray, Signal, Space


def with_kinds(
    demonstrations: Demonstrations, kinds: Mapping[str, type[Signal]], degrees: Sequence[str] = ()
) -> Demonstrations:
    """Take columns, such as `observation.heading` or `heading`, as signals of another kind.

    Those that are named in `degrees` become angles; what is an angle already is in radians and stays as it is
    (`check_degrees` refuses it).

    Raises `DataError` for an unknown column and for values that cannot be of that kind.

    >>> from tvae.data.arrays import from_arrays
    >>> from tvae.spaces import Angular
    >>> walk = from_arrays([np.zeros((4, 1))], [np.ones((3, 1))])
    >>> with_kinds(walk, {"action.0": Angular}).action_space.signals
    (Angular(name='0', recorded_in_degrees=False),)
    """
    kinds, in_degrees = told(demonstrations, kinds, degrees)
    observation_space, observations = _changed(
        OBSERVATION, demonstrations.observation_space, demonstrations.observations, kinds, in_degrees
    )
    action_space, actions = _changed(ACTION, demonstrations.action_space, demonstrations.actions, kinds, in_degrees)
    return replace(
        demonstrations,
        observation_space=observation_space,
        action_space=action_space,
        observations=observations,
        actions=actions,
    )


def check_degrees(demonstrations: Demonstrations, degrees: Sequence[str]) -> None:
    """Raise `DataError` for a column that is said to be in degrees, and is an angle in radians already."""
    known = angles(demonstrations.observation_space, demonstrations.action_space)
    for column in told(demonstrations, {}, degrees)[1]:
        if column in known:
            raise DataError(str(radians_issue(column, known[column])))


def told(
    demonstrations: Demonstrations, kinds: Mapping[str, type[Signal]], degrees: Sequence[str]
) -> tuple[dict[str, type[Signal]], list[str]]:
    """The kind of each column that is meant, by its whole name, and which of them are in degrees.

    Raises `DataError` for an unknown column.
    """
    columns = [OBSERVATION + name for name in demonstrations.observation_space.names]
    columns += [ACTION + name for name in demonstrations.action_space.names]
    named, issues = named_kinds(kinds, columns, {})
    named, in_degrees, found = with_degrees(named, degrees, columns, {})
    issues += found
    if issues:
        raise DataError(str(issues[0]))
    return named, in_degrees


def _changed(
    prefix: str, space: Space, rows: FloatArray, kinds: Mapping[str, type[Signal]], degrees: Collection[str]
) -> tuple[Space, FloatArray]:
    """The space and, copied only where values change, its rows (N, C)."""
    signals = list(space.signals)
    turned: list[str] = []
    for index, old in enumerate(space.signals):
        kind = kinds.get(prefix + old.name, type(old))
        if kind is type(old):
            continue
        try:
            column = np.ascontiguousarray(rows[:, index])
            values = pa.chunked_array([decode(old, column)])
            signals[index] = signal_of(old.name, values, kind)
            encoded = encode(signals[index], values)
        except KindError as error:
            raise DataError(f"column {prefix}{old.name}: {error}") from None
        if prefix + old.name in degrees:
            encoded = encoded * RADIANS_PER_DEGREE
            turned.append(prefix + old.name)
        if not np.array_equal(encoded, column):
            rows = np.array(rows)
            rows[:, index] = encoded
    return noted(Space(tuple(signals)), prefix, turned), rows
