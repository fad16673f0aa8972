"""Long recordings cut into shorter episodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.data.trajectory import DataError


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
    for name in ("recording", "segment"):
        if name in demonstrations.attributes:
            raise DataError(f"episodes have an attribute {name!r} already: they are segments")
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
    source, number, first, lengths = source[kept], number[kept], first[kept], lengths[kept]
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
