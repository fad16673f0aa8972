"""Long recordings cut into shorter episodes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.data.signal_names import called
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.data.trajectory import DataError
from tvae.spaces import IntArray


def segment(
    demonstrations: Demonstrations, length: int, *, stride: int | None = None, minimum: int = 1
) -> Demonstrations:
    """Cut episodes into segments of at most `length` steps; no step is copied.

    A segment begins every `stride` steps (default: `length`, so that they neither overlap nor leave gaps)
    until one reaches the end of its recording; the last may be shorter and is left out below `minimum` steps.
    Inside a recording the observation after a segment's last action is known: it is the next one's first.

    Segments keep the attributes of their recording. `recording` (the attribute `episode` of the source, or
    its position) and `segment` (0, 1, ... within it) are added, and `episode` numbers the segments.

    Raises `DataError` if no segment is left or the episodes are segments already.

    >>> from tvae.data.arrays import from_arrays
    >>> walk = from_arrays([np.zeros((8, 1))], [np.ones((7, 1))])
    >>> parts = segment(walk, 3)
    >>> parts.lengths.tolist(), parts.attributes["segment"].tolist(), parts.final_observed.tolist()
    ([3, 3, 1], [0, 1, 2], [True, True, True])
    """
    stride = length if stride is None else stride
    if length < 1 or stride < 1 or not 1 <= minimum <= length:
        raise ValueError(
            "length and stride need to be at least 1, and minimum from 1 to length, "
            f"got length {length}, stride {stride}, minimum {minimum}"
        )
    _check_whole(demonstrations)
    # The last segment is the first that reaches the end, or the last that begins before it.
    whole = demonstrations.lengths
    counts = 1 + np.minimum(-(-np.maximum(whole - length, 0) // stride), (whole - 1) // stride)
    source = np.repeat(np.arange(len(whole)), counts)
    number = ranges(np.zeros_like(counts), counts)
    first = number * stride
    lengths = np.minimum(length, whole[source] - first)
    kept = lengths >= minimum
    if not kept.any():
        raise DataError(f"no segment has {minimum} steps or more; the longest episode has {whole.max()}")
    return _segments(demonstrations, source[kept], number[kept], first[kept], lengths[kept])


def segment_by_column(demonstrations: Demonstrations, column: str) -> Demonstrations:
    """Cut episodes wherever the value of a column changes, such as a level or a round; no step is copied.

    The column is a step column, or a signal such as `observation.room` or `room`. Segments have all that those of
    `segment` have.

    Raises `DataError` for a column that is not there and for episodes that are segments already.

    >>> from tvae.data.arrays import from_arrays
    >>> rooms = np.array(["hall", "hall", "attic", "hall"])
    >>> parts = segment_by_column(from_arrays([rooms], [np.ones(4)]), "observation.0")
    >>> parts.lengths.tolist()
    [2, 1, 1]
    """
    values = _of_steps(demonstrations, column)
    changed = np.ones(len(values), dtype=np.bool_)
    changed[1:] = values[1:] != values[:-1]
    return _cut_before(demonstrations, changed)


def segment_at_event(demonstrations: Demonstrations, column: str) -> Demonstrations:
    """Cut episodes behind every step at which a column is true, such as a goal; no step is copied.

    The column is a step column, or a signal such as `action.attack`, of 0 and 1. Segments have all that those of
    `segment` have.

    Raises `DataError` for a column that is not there or holds anything else, and for episodes that are segments
    already.

    >>> from tvae.data.arrays import from_arrays
    >>> goals = np.array([False, True, False, False])
    >>> parts = segment_at_event(from_arrays([np.zeros(4)], [goals]), "action.0")
    >>> parts.lengths.tolist()
    [2, 2]
    """
    values = _of_steps(demonstrations, column)
    if values.dtype.kind not in "biuf" or not np.isin(values, (0, 1)).all():
        other = values[~np.isin(values, (0, 1))][0] if values.dtype.kind in "biuf" else values[0]
        raise DataError(f"column {column}: an event needs to be true or false, got {other.item()!r}")
    behind = np.zeros(len(values), dtype=np.bool_)
    behind[1:] = values[:-1] == 1
    return _cut_before(demonstrations, behind)


def _check_whole(demonstrations: Demonstrations) -> None:
    for name in ("recording", "segment"):
        if name in demonstrations.attributes:
            raise DataError(f"episodes have an attribute {name!r} already: they are segments")


def _of_steps(demonstrations: Demonstrations, column: str) -> NDArray[Any]:
    """(sum of lengths,) the values of a column at all actions, episode after episode."""
    _check_whole(demonstrations)
    lengths = demonstrations.lengths
    acting = ranges(demonstrations.action_starts, lengths)
    if column in demonstrations.steps:
        return np.asarray(demonstrations.steps[column][acting])
    if column in demonstrations.attributes:
        return np.repeat(demonstrations.attributes[column], lengths)
    there = [
        *(OBSERVATION + name for name in demonstrations.observation_space.names),
        *(ACTION + name for name in demonstrations.action_space.names),
    ]
    signal = called(column, there)
    for prefix, space, flat, rows in (
        (
            OBSERVATION,
            demonstrations.observation_space,
            demonstrations.observations,
            ranges(demonstrations.observation_starts, lengths),
        ),
        (ACTION, demonstrations.action_space, demonstrations.actions, acting),
    ):
        if signal is not None and signal.startswith(prefix):
            return np.asarray(flat[rows, space.names.index(signal.removeprefix(prefix))])
    listed = ", ".join([*there, *demonstrations.steps])
    raise DataError(f"there is no column {column!r} to cut by; there are: {listed}")


def _cut_before(demonstrations: Demonstrations, cut: NDArray[np.bool_]) -> Demonstrations:
    """Segments that begin at these steps (sum of lengths,) and at the beginning of every episode."""
    begins = np.cumsum(demonstrations.lengths) - demonstrations.lengths
    cut = cut.copy()
    cut[begins] = True
    at = np.flatnonzero(cut)
    source = np.searchsorted(begins, at, side="right") - 1
    counts = np.bincount(source, minlength=len(begins))
    number = ranges(np.zeros_like(counts), counts)
    return _segments(demonstrations, source, number, at - begins[source], np.diff(at, append=len(cut)))


def _segments(
    demonstrations: Demonstrations, source: IntArray, number: IntArray, first: IntArray, lengths: IntArray
) -> Demonstrations:
    """Parts of episodes: which one, the how manieth of it, from which step, how long."""
    whole = demonstrations.lengths
    recordings = demonstrations.attributes.get("episode", np.arange(len(whole)))
    return replace(
        demonstrations,
        observation_starts=demonstrations.observation_starts[source] + first,
        action_starts=demonstrations.action_starts[source] + first,
        lengths=lengths,
        final_observed=(first + lengths < whole[source]) | demonstrations.final_observed[source],
        attributes={
            **{name: values[source] for name, values in demonstrations.attributes.items()},
            "episode": np.arange(len(source)),
            "recording": recordings[source],
            "segment": number,
        },
    )
