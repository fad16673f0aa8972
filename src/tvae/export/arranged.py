"""Rows whose columns stand in an order of their own, and affine maps of such rows, many in one operator.

An engine takes about as long for one small operator as for the next, whatever it computes. So rows are put together
once, in the order in which their parts come; maps that read the same rows are one `Gemm`, whose weights are put in that
order when the graph is written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import nn

from tvae.export.sheet import Value, as_rows
from tvae.spaces import IntArray


@dataclass(frozen=True, eq=False)
class Arranged:
    """Rows (..., C) of which column i is column `order[i]` of what a layer reads; what is missing there is zero."""

    rows: Value
    order: IntArray

    def in_order(self, size: int) -> Value:
        """All `size` columns as a layer reads them."""
        if np.array_equal(self.order, np.arange(size)):
            return self.rows
        places = np.zeros((len(self.order), size), dtype=np.float32)
        places[np.arange(len(self.order)), self.order] = 1
        return self.rows.sheet.node("MatMul", self.rows, places)


@dataclass(frozen=True, eq=False)
class Affine:
    """weight x + bias, for a row x in the order of a layer."""

    weight: NDArray[np.float32]
    """(O, C)"""
    bias: NDArray[np.float32]
    """(O,)"""

    @classmethod
    def of(cls, layer: nn.Linear) -> Affine:
        """What a layer computes."""
        return cls(as_rows(layer.weight), as_rows(layer.bias))

    def placed(self, columns: IntArray, width: int) -> Affine:
        """The same of wider rows, which have what it reads at `columns`."""
        weight = np.zeros((len(self.bias), width), dtype=np.float32)
        weight[:, columns] = self.weight
        return Affine(weight, self.bias)


def joined(parts: Sequence[Arranged]) -> Arranged:
    """Parts of the same rows side by side."""
    sheet = parts[0].rows.sheet
    return Arranged(sheet.join([part.rows for part in parts]), np.concatenate([part.order for part in parts]))


def stacked(maps: Sequence[Affine]) -> Affine:
    """Maps of the same rows as one, which gives the results side by side."""
    return Affine(np.concatenate([one.weight for one in maps]), np.concatenate([one.bias for one in maps]))


def apart(maps: Sequence[Affine]) -> Affine:
    """Maps of rows that stand side by side as one, which gives the results side by side."""
    width, found, begin = sum(one.weight.shape[1] for one in maps), [], 0
    for one in maps:
        size = one.weight.shape[1]
        found.append(one.placed(np.arange(begin, begin + size), width))
        begin += size
    return stacked(found)


def mapped(rows: Arranged, one: Affine, *, rank: int = 2) -> Value:
    """What a map gives, of rows or of sequences of rows (rank 3)."""
    sheet, weight = rows.rows.sheet, np.ascontiguousarray(one.weight[:, rows.order])
    if rank == 2:
        return sheet.node("Gemm", rows.rows, weight, one.bias, transB=1)
    return sheet.node("MatMul", rows.rows, weight.T) + one.bias


def each(rows: Arranged, maps: Sequence[Affine]) -> list[Value]:
    """What each of several maps gives, of the same rows."""
    pieces = rows.rows.sheet.split(mapped(rows, stacked(maps)), [len(one.bias) for one in maps])
    return [piece for piece in pieces if piece is not None]
