"""The law of a row and a draw from it, written down as ONNX; `laws` and `draws` say what is computed."""

from __future__ import annotations

import math

import numpy as np
import torch

from tvae.data.normalizer import Normalizer
from tvae.export.draws import CELLS, EDGE, SMALLEST
from tvae.export.layers import linear
from tvae.export.sheet import Value
from tvae.heads import Head
from tvae.model.events import NEVER

Law = dict[str, Value]


def wrapped(angle: Value) -> Value:
    """The same direction in [-pi, pi]."""
    return angle - (angle * (1 / (2 * math.pi))).apply("Round") * (2 * math.pi)


def law_of(
    head: Head, normalizer: Normalizer, rows: Value, rank: int, origin: Value | None = None, used: Value | None = None
) -> Law:
    """The law's tensors in raw units, as `tvae.export.laws.law_tensors` gives them.

    `origin` are standardised rows (zeros if left out); where `used` (..., N) is given, binary columns that are not
    used have the probability 0.
    """
    sheet, space, components = rows.sheet, head.space, head.num_components
    found: Law = {}
    if components > 1:
        found["weights"] = sheet.node("Softmax", linear(head.weights, rows, rank=rank), axis=-1)
    keep = [0] * (rank - 1)
    outputs = linear(head.parameters_of_law, rows, rank=rank).reshape(*keep, components, -1)
    mean, spread, x, y, width, log_odds, weights = sheet.split(outputs, head._sizes)
    start = None if origin is None else origin.unsqueeze(rank - 1)
    if mean is not None and spread is not None:
        unit = head.unit[torch.from_numpy(space.continuous)]
        std = normalizer.std[torch.from_numpy(space.continuous)]
        middle = mean * unit if start is None else mean * unit + start.columns(space.continuous)
        found["mean"] = middle * std + normalizer.mean[torch.from_numpy(space.continuous)]
        found["deviation"] = (spread.apply("Softplus") + head.floor) * (unit * std)
    if x is not None and y is not None and width is not None:
        angle = _direction(x + 1.0, y)
        unit = head.unit[torch.from_numpy(space.angular)]
        found["angle"] = angle if start is None else wrapped(angle + start.columns(space.angular))
        found["angle_deviation"] = (width.apply("Softplus") + head.floor) * unit
    if log_odds is not None:
        if used is not None:
            log_odds = sheet.where(used.above(0.5).unsqueeze(rank - 1), log_odds, NEVER)
        found["probability"] = log_odds.apply("Sigmoid")
    if weights is not None:
        mask = space.category_mask
        slots = np.where(mask, np.cumsum(mask).reshape(mask.shape) - 1, 0)
        missing = np.where(mask, 0.0, -1e9)
        found["probabilities"] = sheet.node("Softmax", weights.columns(slots) + missing, axis=-1)
    return found


def hazard(law: Law) -> Value:
    """The probability of each binary column, over all components."""
    if "weights" not in law:
        return law["probability"].squeeze(1)
    return (law["probability"] * law["weights"].unsqueeze(-1)).sum(-2)


def chosen(head: Head, law: Law, noise: Value, most_likely: Value, rank: int) -> Value:
    """The raw row that uniform numbers choose from the law of a head, as `tvae.export.laws.choose` does."""
    sheet, space, certain = noise.sheet, head.space, most_likely.above(0.5)
    several = head.num_components > 1
    sizes = [int(several), len(space.continuous), len(space.continuous)]
    sizes += [len(space.angular), len(space.binary), len(space.categorical)]
    which, radius, turn, angles, buttons, codes = sheet.split(_first(noise, sum(sizes)), sizes)
    if which is None:
        law = {name: tensor.squeeze(rank - 1) for name, tensor in law.items()}
    else:
        law = _of_component(head, law, _component(law["weights"], which, certain, head.num_components), rank)
    parts: list[Value] = []
    if radius is not None and turn is not None:
        length = (sheet.node("Max", 1.0 - radius, SMALLEST).apply("Log") * -2.0).apply("Sqrt")
        away = law["deviation"] * length * (turn * (2 * math.pi)).apply("Cos")
        parts.append(law["mean"] + sheet.where(certain, 0.0, away))
    if angles is not None:
        away = _von_mises(angles, law["angle_deviation"], rank)
        parts.append(wrapped(law["angle"] + sheet.where(certain, 0.0, away)))
    if buttons is not None:
        parts.append(law["probability"].above(sheet.where(certain, 0.5, buttons)).number())
    if codes is not None:
        most = sheet.node("ArgMax", law["probabilities"], axis=-1, keepdims=0).number()
        drawn = _category(codes.unsqueeze(-1), law["probabilities"], space.category_mask.shape[1]).squeeze(-1)
        parts.append(sheet.where(certain, most, drawn))
    order = np.concatenate([space.continuous, space.angular, space.binary, space.categorical])
    rows = sheet.join(parts)
    return rows if (order == np.arange(len(order))).all() else rows.columns(np.argsort(order))


def _first(noise: Value, count: int) -> Value:
    """The first columns."""
    return noise.sheet.node("Slice", noise, np.array([0]), np.array([count]), np.array([-1]))


def _component(weights: Value, which: Value, certain: Value, count: int) -> Value:
    """The number (..., 1) of the component drawn, or of the heaviest."""
    heaviest = weights.sheet.node("ArgMax", weights, axis=-1, keepdims=1).number()
    return weights.sheet.where(certain, heaviest, _category(which, weights, count))


def _category(uniform: Value, probabilities: Value, count: int) -> Value:
    """`draws.category`, as a number (..., 1) of `uniform` (..., 1)."""
    sheet = uniform.sheet
    if count == 1:
        return uniform * 0.0
    up_to = sheet.node("CumSum", probabilities, np.array(-1))
    edges = up_to.columns(np.arange(count - 1))
    inner = sheet.node("Less", edges, up_to.columns([count - 1])).number()
    beyond = sheet.node("GreaterOrEqual", uniform, edges).number() * inner
    return sheet.node("ReduceSum", beyond, np.array([-1]), keepdims=1)


def _of_component(head: Head, law: Law, index: Value, rank: int) -> Law:
    """The law of the component with this number (..., 1), without the axis of components."""
    sheet, space = index.sheet, head.space
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
    numbers = np.arange(head.num_components, dtype=np.float32)
    one = sheet.node("Equal", index, numbers).number().unsqueeze(-1)
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


def _von_mises(uniform: Value, deviation: Value, rank: int) -> Value:
    """`draws.von_mises` at the concentration 1 / deviation^2."""
    sheet = uniform.sheet
    k = (deviation * deviation).apply("Reciprocal")
    wide = k * 4.0 + 1.0
    middles = (np.arange(CELLS) + 0.5) / CELLS
    towards = (1 / np.tan(math.pi / 2 * middles) ** 2).astype(np.float32)
    s = sheet.constant(towards) / (wide.unsqueeze(-1) + towards)
    ks = s * k.unsqueeze(-1)
    density = (ks * -2.0).apply("Exp") * (ks * 4.0 + 1.0)
    up_to = sheet.node("CumSum", density, np.array(-1))
    outside = sheet.node("Max", sheet.node("Min", uniform, 1.0 - uniform) * 2.0, EDGE).unsqueeze(-1)
    target = outside * up_to.columns([CELLS - 1])
    filled = (target - (up_to - density)) / sheet.node("Max", density, 1e-30)
    share = sheet.node("Clip", filled, 0.0, 1.0)
    mean = sheet.node("ReduceMean", share, axes=[-1], keepdims=0)
    away = ((mean * (math.pi / 2)).apply("Tan") * wide.apply("Sqrt")).apply("Reciprocal").apply("Atan") * 2.0
    return sheet.where(uniform.below(0.5), away.apply("Neg"), away)
