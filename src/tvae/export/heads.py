"""The law of a row and a draw from it, written down as ONNX; `laws` and `draws` say what is computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from tvae.data.normalizer import Normalizer
from tvae.export.arranged import Affine, Arranged, mapped, stacked
from tvae.export.draws import CELLS
from tvae.export.sheet import Value, as_rows
from tvae.export.uniform import Numbers
from tvae.heads import Head
from tvae.spaces import IntArray

Law = dict[str, Value]


def wrapped(angle: Value) -> Value:
    """The same direction in [-pi, pi]."""
    return angle - (angle * (1 / (2 * math.pi))).apply("Round") * (2 * math.pi)


def law_of(
    head: Head,
    normalizer: Normalizer,
    features: Arranged,
    rank: int,
    origin: Value | None = None,
    used: Value | None = None,
) -> Law:
    """The law's tensors in raw units, as `tvae.export.laws.law_tensors` gives them.

    `origin` are standardised rows (zeros if left out); where `used` (..., N) is given, binary columns that are not
    used have the probability 0.
    """
    sheet, space, components = features.rows.sheet, head.space, head.num_components
    continuous, angular = torch.from_numpy(space.continuous), torch.from_numpy(space.angular)
    unit, std = head.unit[continuous], normalizer.std[continuous]
    found: Law = {}
    outputs = mapped(features, _parameters(head, normalizer, settled=origin is None), rank=rank)
    heaviness, rest = sheet.split(outputs, [components if components > 1 else 0, components * sum(head._sizes)])
    assert rest is not None
    if heaviness is not None:
        found["weights"] = sheet.node("Softmax", heaviness, axis=-1)
    parameters = rest.reshape(*[0] * (rank - 1), components, -1)
    mean, spread, x, y, width, log_odds, weights = sheet.split(parameters, head._sizes)
    start = None if origin is None else origin.unsqueeze(rank - 1)
    if mean is not None and spread is not None:
        if start is not None:
            mean = (mean + start.columns(space.continuous)) * std + normalizer.mean[continuous]
        found["mean"] = mean
        found["deviation"] = (spread.apply("Softplus") + head.floor) * (unit * std)
    if x is not None and y is not None and width is not None:
        angle = _direction(x, y)
        found["angle"] = angle if start is None else wrapped(angle + start.columns(space.angular))
        deviation = width.apply("Softplus") + head.floor
        found["angle_deviation"] = deviation if start is None else deviation * head.unit[angular]
    if log_odds is not None:
        probability = log_odds.apply("Sigmoid")
        found["probability"] = probability if used is None else probability * used.unsqueeze(rank - 1)
    if weights is not None:
        mask = space.category_mask
        slots = np.where(mask, np.cumsum(mask).reshape(mask.shape) - 1, 0)
        missing = np.where(mask, 0.0, -1e9)
        found["probabilities"] = sheet.node("Softmax", weights.columns(slots) + missing, axis=-1)
    return found


def _parameters(head: Head, normalizer: Normalizer, *, settled: bool) -> Affine:
    """The head's layers as one: log-weights of components, then the parameters of each.

    The unit of a change is in the weights, and 1 is added to what x is; where no origin is still to be added
    (`settled`), a mean comes in raw units.
    """
    layer, sizes = Affine.of(head.parameters_of_law), head._sizes
    continuous = head.space.continuous
    scale, shift = np.ones(sum(sizes)), np.zeros(sum(sizes))
    scale[: sizes[0]] = as_rows(head.unit)[continuous]
    if settled:
        scale[: sizes[0]] *= as_rows(normalizer.std)[continuous]
        shift[: sizes[0]] = as_rows(normalizer.mean)[continuous]
    shift[2 * sizes[0] : 2 * sizes[0] + sizes[2]] = 1
    scales, shifts = np.tile(scale, head.num_components), np.tile(shift, head.num_components)
    own = Affine(
        (layer.weight * scales[:, None]).astype(np.float32), (layer.bias * scales + shifts).astype(np.float32)
    )
    return stacked([Affine.of(head.weights), own] if head.num_components > 1 else [own])


def hazard(law: Law) -> Value:
    """The probability of each binary column, over all components."""
    if "weights" not in law:
        return law["probability"].squeeze(1)
    return (law["probability"] * law["weights"].unsqueeze(-1)).sum(-2)


@dataclass(frozen=True, eq=False)
class Choice:
    """What was drawn."""

    row: Value
    """(..., C) in raw units"""
    binary: Value | None
    """(..., number of buttons) of it"""


def choice(head: Head, law: Law, numbers: Numbers, rank: int) -> Choice:
    """The raw row that uniform numbers choose from the law of a head, as `tvae.export.laws.choose` does."""
    sheet, space = numbers.certain.sheet, head.space
    if numbers.component is None:
        law = {name: tensor.squeeze(rank - 1) for name, tensor in law.items()}
    else:
        weights = law["weights"]
        one = sheet.node("Hardmax", _preferred(numbers.certain, numbers.component, weights), axis=-1)
        law = _of_component(head, law, one.unsqueeze(-1), rank)
    parts: list[tuple[IntArray, Value]] = []
    buttons = None
    if numbers.radius is not None and numbers.turn is not None:
        length = (numbers.radius.apply("Log") * -2.0).apply("Sqrt")
        parts.append((space.continuous, law["mean"] + law["deviation"] * length * numbers.turn.apply("Cos")))
    if numbers.below is not None and numbers.beyond is not None and numbers.side is not None:
        outside = sheet.node("Min", numbers.below, numbers.beyond)
        away = _von_mises(outside, numbers.side, law["angle_deviation"], len(space.angular))
        parts.append((space.angular, wrapped(law["angle"] + away)))
    if numbers.binary is not None:
        buttons = law["probability"].above(numbers.binary).number()
        parts.append((space.binary, buttons))
    if numbers.categorical is not None:
        preferred = _preferred(numbers.certain, numbers.categorical.unsqueeze(-1), law["probabilities"])
        parts.append((space.categorical, sheet.node("ArgMax", preferred, axis=-1, keepdims=0).number()))
    parts.sort(key=lambda part: int(part[0][0]))
    order = np.concatenate([columns for columns, _ in parts])
    row = sheet.join([value for _, value in parts])
    return Choice(row if (order == np.arange(len(order))).all() else row.columns(np.argsort(order)), buttons)


def _preferred(certain: Value, upper: Value, probabilities: Value) -> Value:
    """Numbers (..., K), the first of the largest of which is the choice: `draws.category` of 1 - u, or the mode."""
    sheet = certain.sheet
    behind = sheet.node("CumSum", probabilities, np.array(-1), exclusive=1, reverse=1)
    return sheet.where(certain, probabilities, upper.above(behind).number())


def _of_component(head: Head, law: Law, one: Value, rank: int) -> Law:
    """The law of the component that is 1 in `one` (..., K, 1), without the axis of components."""
    sheet, space = one.sheet, head.space
    categories = space.category_mask.shape
    widths = {
        "mean": len(space.continuous),
        "deviation": len(space.continuous),
        "angle": len(space.angular),
        "angle_deviation": len(space.angular),
        "probability": len(space.binary),
        "probabilities": categories[0] * categories[1],
    }
    there = [name for name in widths if name in law]
    parts = [law[name] for name in there]
    if "probabilities" in law:
        parts[-1] = parts[-1].reshape(*[0] * rank, widths["probabilities"])
    pieces = sheet.split((sheet.join(parts) * one).sum(rank - 1), [widths[name] for name in there])
    found = {name: piece for name, piece in zip(there, pieces, strict=True) if piece is not None}
    if "probabilities" in found:
        found["probabilities"] = found["probabilities"].reshape(*[0] * (rank - 1), *categories)
    return found


def _direction(x: Value, y: Value) -> Value:
    """atan2(y, x)."""
    sheet = x.sheet
    half_turn = sheet.where(y.below(0.0), -math.pi, math.pi)
    return (y / x).apply("Atan") + sheet.where(x.below(0.0), half_turn, 0.0)


def _von_mises(outside: Value, side: Value, deviation: Value, count: int) -> Value:
    """`draws.von_mises` of `count` angles at the concentration k = 1 / deviation^2.

    With d = deviation and t = `towards`, -2 k s = 1 / (-d^2 (1 + 1 / t) / 2 - 2 / t).
    """
    sheet, square = outside.sheet, deviation * deviation
    middles = (np.arange(CELLS) + 0.5) / CELLS
    inverse = np.tan(math.pi / 2 * middles) ** 2

    def cells(value: Value) -> Value:
        return value if count == 1 else value.unsqueeze(-1)

    exponent = (cells(square) * (-(1 + inverse) / 2) + -2 * inverse).apply("Reciprocal")
    density = exponent.apply("Exp") * (0.5 - exponent)
    before = sheet.node("CumSum", density, np.array(-1), exclusive=1)
    target = cells(outside) * sheet.node("ReduceSum", density, np.array([-1]), keepdims=1)
    filled = sheet.node("Clip", (target - before) / density, 0.0, 1.0)  # inf, and so 1, where a cell is too thin
    quarter = sheet.node("MatMul", filled, np.full((CELLS, 1), math.pi / 2 / CELLS))
    turned = (quarter if count == 1 else quarter.squeeze(-1)).apply("Tan")
    away = (deviation / (square + 4.0).apply("Sqrt") / turned).apply("Atan")
    return away * (side.apply("Sign") * 2.0)
