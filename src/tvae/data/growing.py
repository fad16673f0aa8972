"""Rows that arrive one episode at a time and may become more than memory should hold."""

from __future__ import annotations

import tempfile
from typing import IO

import numpy as np

from tvae.spaces import FloatArray

SPILL_BYTES = 1 << 30


class GrowingRows:
    """Rows of `width` numbers: in memory, and beyond `SPILL_BYTES` in an unnamed temporary file.

    >>> rows = GrowingRows(width=2)
    >>> rows.append(np.zeros((3, 2)))
    >>> rows.append(np.ones((1, 2)))
    >>> rows.finish().shape
    (4, 2)
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._parts: list[FloatArray] = []
        self._pending_bytes = 0
        self._num_rows = 0
        self._file: IO[bytes] | None = None

    def append(self, rows: FloatArray) -> None:
        """Add rows (N, width)."""
        part = np.ascontiguousarray(rows, dtype=np.float64)
        self._parts.append(part)
        self._pending_bytes += part.nbytes
        self._num_rows += len(part)
        if self._pending_bytes > SPILL_BYTES:
            self._file = self._spilled()

    def _spilled(self) -> IO[bytes]:
        """The file that now holds every row so far."""
        file = self._file or tempfile.TemporaryFile()  # noqa: SIM115 - `finish` closes it
        for part in self._parts:
            part.tofile(file)
        self._parts, self._pending_bytes = [], 0
        return file

    def finish(self) -> FloatArray:
        """All rows (N, width): an array, or a read-only map of the file, which lives as long as the map."""
        if self._file is None:
            return np.concatenate(self._parts) if self._parts else np.zeros((0, self._width))
        with self._spilled() as file:
            file.flush()
            return np.memmap(file, dtype=np.float64, mode="r", shape=(self._num_rows, self._width))
