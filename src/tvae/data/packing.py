"""Rows of some episodes, written one after another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from tvae.data.ragged import blocks, ranges
from tvae.spaces import IntArray

_BLOCK_ROWS = 1 << 20


def write_rows(path: Path, flat: NDArray[Any], starts: IntArray, counts: IntArray) -> None:
    """Write the rows of `flat` that episodes hold, `counts` from `starts` on, as a `.npy` file; few are in memory.

    >>> import tempfile
    >>> import numpy as np
    >>> path = Path(tempfile.mkdtemp()) / "rows.npy"
    >>> write_rows(path, np.arange(5.0), np.array([3, 0]), np.array([2, 1]))
    >>> np.load(path).tolist()
    [3.0, 4.0, 0.0]
    """
    written = open_memmap(path, mode="w+", dtype=flat.dtype, shape=(int(counts.sum()), *flat.shape[1:]))
    at = 0
    for part in blocks(counts, _BLOCK_ROWS):
        rows = ranges(starts[part], counts[part])
        written[at : at + len(rows)] = flat[rows]
        at += len(rows)
    written.flush()
