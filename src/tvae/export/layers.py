"""The parts of a model, written down as ONNX: normalisers, layers, and what a trunk sees.

What each computes stands in the module of the same name in `tvae.model`, `tvae.data` or PyTorch; the check of every
export against PyTorch holds the two together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from tvae.data.normalizer import Normalizer
from tvae.export.arranged import Affine
from tvae.export.sheet import Input, Sheet, Value, as_rows
from tvae.model.ranks import Ranks
from tvae.model.trunks import LARGEST


def values(normalizer: Normalizer, raw: Value) -> Value:
    """`Normalizer.values`."""
    return (raw - normalizer.mean) / normalizer.std


def features(normalizer: Normalizer, rows: Value) -> Value:
    """`Normalizer.features` of standardised rows."""
    space, parts = normalizer.space, []
    if len(space.continuous):
        parts.append(rows.columns(space.continuous))
    if len(space.angular):
        angles = rows.columns(space.angular)
        parts += [angles.apply("Cos"), angles.apply("Sin")]
    if len(space.binary):
        parts.append(rows.columns(space.binary) * 2.0 - 1.0)
    if len(space.categorical):
        columns = np.repeat(space.categorical, space.num_categories)
        numbers = np.concatenate([np.arange(count) for count in space.num_categories])
        parts.append(rows.sheet.node("Equal", rows.columns(columns), numbers.astype(np.float32)).number())
    return rows.sheet.join(parts)


def changes_of_ranks(ranks: Ranks, raw: Value, step: Value) -> tuple[Value, Value]:
    """`Ranks.forward` of raw rows (B, T, C) in two halves, the ranks and their changes; `step` is 0, 1, ..., T - 1."""
    sheet = raw.sheet
    there = (raw.columns(ranks.columns.cpu().numpy()) - ranks.mean) / ranks.deviation
    before = sheet.where(step.above(np.array(0)), step - np.array(1), step)
    return there, there - sheet.node("Gather", there, before, axis=1)


def areas_of(ranks: Ranks, there: Value, changes: Value) -> Value:
    """What `Ranks.areas` takes the mean of."""
    first, second = (pairs.cpu().numpy() for pairs in (ranks.first, ranks.second))
    return there.columns(first) * changes.columns(second) - there.columns(second) * changes.columns(first)


def linear(layer: nn.Linear, rows: Value, *, rank: int = 2) -> Value:
    """An affine layer on rows, or on sequences of rows (rank 3)."""
    if rank == 2:
        return rows.sheet.node("Gemm", rows, layer.weight, layer.bias, transB=1)
    return rows.sheet.node("MatMul", rows, as_rows(layer.weight).T) + layer.bias


def silu(rows: Value) -> Value:
    """x sigmoid(x)."""
    return rows * rows.apply("Sigmoid")


def chain(layers: nn.Sequential, rows: Value, *, rank: int = 2) -> Value:
    """Affine layers and SiLU, one after the other."""
    for layer in layers:
        match layer:
            case nn.Linear():
                rows = linear(layer, rows, rank=rank)
            case nn.SiLU():
                rows = silu(rows)
            case _:
                raise TypeError(f"no layer of this kind can be written as ONNX: {type(layer).__name__}")
    return rows


@dataclass(frozen=True)
class Remembered:
    """What an LSTM gives."""

    every: Value
    """(T, 1, N, H) after each step"""
    hidden: Value
    """(1, N, H) after the last one"""
    cell: Value
    """(1, N, H) after the last one"""


def lstm(net: nn.LSTM, steps: Value, hidden: Value | None = None, cell: Value | None = None) -> Remembered:
    """An LSTM over `steps` (T, N, F), from states (1, N, H) or from zero."""
    into, back, bias, second = (_in_order(rows) for rows in _weights(net))
    inputs: list[Input] = [steps, into[None], back[None], np.concatenate([bias, second])[None], None, hidden, cell]
    found = steps.sheet.nodes_of("LSTM", inputs[:4] if hidden is None else inputs, 3, hidden_size=net.hidden_size)
    return Remembered(*found)


def gates(net: nn.LSTM) -> list[Affine]:
    """Input gate, output gate and candidate of an LSTM in a state of zero, where its forget gate has no say."""
    into, _, bias, second = _weights(net)
    found = [Affine(*pair) for pair in zip(np.split(into, 4), np.split(bias + second, 4), strict=True)]
    return [found[0], found[3], found[2]]


def lstm_once(take: Value, give: Value, candidate: Value) -> Value:
    """The output (N, H) of an LSTM after one row from a state of zero, of what `gates` gave."""
    return (take.apply("Sigmoid") * candidate.apply("Tanh")).apply("Tanh") * give.apply("Sigmoid")


def _weights(net: nn.LSTM) -> list[NDArray[np.float32]]:
    """Of the input and of the state, and their biases."""
    names = ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
    return [as_rows(net.get_parameter(name)) for name in names]


def _in_order(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """PyTorch's gates (input, forget, cell, output) as ONNX has them (input, output, forget, cell)."""
    gates = np.split(rows, 4)
    return np.concatenate([gates[0], gates[3], gates[1], gates[2]])


def over_time(net: nn.LSTM, rows: Value) -> Value:
    """The outputs (B, T, H) of an LSTM over rows (B, T, F), from a state of zero."""
    steps = rows.sheet.node("Transpose", rows, perm=[1, 0, 2])
    return rows.sheet.node("Transpose", lstm(net, steps).every.squeeze(1), perm=[1, 0, 2])


def changes(inputs: Value, last: Value, unit: Tensor) -> Value:
    """The last change in typical changes, as `ReactiveTrunk` has it."""
    return inputs.sheet.node("Clip", (inputs - last) / unit, -LARGEST, LARGEST)


def at_every_step(z: Value, rows: Value, size: int) -> Value:
    """z (B, Z) beside every row of (B, T, F)."""
    sheet = z.sheet
    shape = sheet.join([sheet.node("Shape", rows, start=0, end=2), sheet.constant(np.array([size]))])
    return sheet.node("Expand", z.unsqueeze(1), shape)


def present(sheet: Sheet, parts: list[Value | None]) -> Value:
    """Those that are there, side by side."""
    return sheet.join([part for part in parts if part is not None])
