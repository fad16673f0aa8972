"""Rows of episodes of different lengths in flat arrays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tvae.spaces import IntArray


def ranges(starts: IntArray, counts: IntArray) -> IntArray:
    """`counts[i]` consecutive numbers from `starts[i]` on, for each i, one after another.

    >>> ranges(np.array([10, 0]), np.array([3, 2])).tolist()
    [10, 11, 12, 0, 1]
    """
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    shifts: IntArray = np.repeat(starts - (ends - counts), counts)
    return np.arange(total, dtype=np.int64) + shifts


def blocks(lengths: IntArray, most: int) -> Iterator[slice]:
    """Slices of consecutive episodes that hold at most `most` steps together; a longer episode stands alone.

    >>> [(part.start, part.stop) for part in blocks(np.array([3, 3, 9, 1]), most=6)]
    [(0, 2), (2, 3), (3, 4)]
    """
    ends = np.cumsum(lengths)
    first = 0
    while first < len(lengths):
        before = int(ends[first] - lengths[first])
        last = max(first + 1, int(np.searchsorted(ends, before + most, side="right")))
        yield slice(first, last)
        first = last
