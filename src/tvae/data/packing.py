"""Rows of some episodes, written one after another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.format import dtype_to_descr, write_array_header_1_0
from numpy.typing import NDArray

from tvae.data.ragged import blocks, ranges
from tvae.spaces import IntArray

_BLOCK_ROWS = 1 << 20


def write_rows(path: Path, flat: NDArray[Any], starts: IntArray, counts: IntArray) -> None:
    """Write the rows of `flat` that episodes hold, `counts` from `starts` on, as a `.npy` file; few are in memory.

    Raises `OSError` where the disk is full, which a map of the file would end the process for.

    >>> import tempfile
    >>> import numpy as np
    >>> path = Path(tempfile.mkdtemp()) / "rows.npy"
    >>> write_rows(path, np.arange(5.0), np.array([3, 0]), np.array([2, 1]))
    >>> np.load(path).tolist()
    [3.0, 4.0, 0.0]
    """
    shape = (int(counts.sum()), *flat.shape[1:])
    with path.open("wb") as file:
        header = {"descr": dtype_to_descr(flat.dtype), "fortran_order": False, "shape": shape}
        write_array_header_1_0(file, header)
        for part in blocks(counts, _BLOCK_ROWS):
            file.write(np.ascontiguousarray(flat[ranges(starts[part], counts[part])]).data)
