"""Angles that were recorded in degrees: x degrees are pi x / 180 radians, and only these are learned from."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import pyarrow as pa
import pyarrow.compute as pc

from tvae.data.issues import Issue, Remedy
from tvae.data.table_roles import named_kinds
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.texts import as_numbers, no_numbers
from tvae.spaces import Angular, Signal, Space

RADIANS_PER_DEGREE = math.pi / 180


def with_degrees(
    kinds: Mapping[str, type[Signal]], degrees: Sequence[str], names: Sequence[str], recorded: Mapping[str, str]
) -> tuple[dict[str, type[Signal]], list[str], list[Issue]]:
    """The kinds, among them that of each column in degrees; these columns; what is wrong with how they are named.

    >>> with_degrees({}, ["turn"], ["step", "action.turn"], {})
    ({'action.turn': <class 'tvae.spaces.Angular'>}, ['action.turn'], [])
    """
    angles, issues = named_kinds(dict.fromkeys(degrees, Angular), names, recorded)
    twice = [name for name in angles if kinds.get(name, Angular) is not Angular]
    issues += [Issue("is said to be an angle in degrees, and of another kind", column=name) for name in twice]
    return {**kinds, **angles}, list(angles), issues


def angles(observation_space: Space, action_space: Space) -> dict[str, Angular]:
    """The angles of two spaces by the names of their columns.

    >>> angles(Space((Angular("heading"),)), Space(())).keys()
    dict_keys(['observation.heading'])
    """
    return {
        prefix + signal.name: signal
        for prefix, space in ((OBSERVATION, observation_space), (ACTION, action_space))
        for signal in space.signals
        if isinstance(signal, Angular)
    }


def without_radians(columns: Sequence[str], schema: TableSchema | None, recorded: Mapping[str, str]) -> list[str]:
    """The columns that are not yet in radians: what we wrote as an angle is."""
    ours = {} if schema is None else angles(schema.observation_space, schema.action_space)
    return [column for column in columns if recorded.get(column, column) not in ours]


def radians_issue(column: str, angle: Angular | None) -> Issue:
    """That a column that is in radians already is said to be in degrees; `angle` is what is known of it, if anything.

    >>> print(radians_issue("action.turn", Angular("turn", recorded_in_degrees=True)))
    column action.turn: is said to be in degrees, but these have been converted to radians already
    """
    if angle is not None and angle.recorded_in_degrees:
        message = "is said to be in degrees, but these have been converted to radians already"
    else:
        message = "is said to be in degrees, but was written here as an angle in radians"
    return Issue(message, column=column, remedy=Remedy.OMIT_DEGREES)


def noted(space: Space, prefix: str, columns: Collection[str]) -> Space:
    """The same space, in which angles in these columns were recorded in degrees.

    >>> noted(Space((Angular("turn"),)), "action.", ["action.turn"]).signals
    (Angular(name='turn', recorded_in_degrees=True),)
    """
    return Space(
        tuple(
            replace(signal, recorded_in_degrees=True)
            if isinstance(signal, Angular) and prefix + signal.name in columns
            else signal
            for signal in space.signals
        )
    )


def in_radians(table: pa.Table, columns: Collection[str]) -> pa.Table:
    """The same with these columns in radians instead of degrees; what is no number stays as it is.

    >>> in_radians(pa.table({"heading": [90, None], "x": [90, 0]}), ["heading"]).to_pydict()
    {'heading': [1.5707963267948966, None], 'x': [90, 0]}
    """
    for at, name in enumerate(table.column_names):
        if name not in columns:
            continue
        values = table[name]
        if pa.types.is_string(values.type) and not no_numbers(values).any():
            values = as_numbers(values)
        if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
            radians = pc.multiply(values.cast(pa.float64(), safe=False), RADIANS_PER_DEGREE)
            table = table.set_column(at, name, radians)
    return table
