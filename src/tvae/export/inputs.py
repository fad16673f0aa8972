"""What the nets of a policy see of an observation, written down as ONNX with few operators.

`TrajectoryVAE.policy_decoder_inputs` says what it is: the features of the row within its range, its further readings
(`tvae.model.perception`), and what was done.
"""

from __future__ import annotations

import numpy as np

from tvae.data.normalizer import Normalizer
from tvae.export.arranged import Arranged
from tvae.export.sheet import Value, as_rows
from tvae.model.perception import MARGIN, NoPerception, Perception

UNBOUNDED = 3e38
"""Stands for no bound: not every engine reads an infinite constant."""


def seen(perception: Perception | NoPerception, normalizer: Normalizer, raw: Value) -> list[Arranged]:
    """Features and further readings of raw rows (B, C), in parts, each with its columns among all of them."""
    space = normalizer.space
    parts = []
    if len(space.continuous) + len(space.binary):
        parts.append(_numbers(perception, normalizer, raw))
    if len(space.angular):
        parts += _directions(perception, normalizer, raw)
    if len(space.categorical):
        columns = np.repeat(space.categorical, space.num_categories)
        codes = np.concatenate([np.arange(count) for count in space.num_categories]).astype(np.float32)
        first = len(space.continuous) + 2 * len(space.angular) + len(space.binary)
        one_hot = raw.sheet.node("Equal", raw.columns(columns), codes).number()
        parts.append(Arranged(one_hot, first + np.arange(len(columns))))
    return parts


def _numbers(perception: Perception | NoPerception, normalizer: Normalizer, raw: Value) -> Arranged:
    """Standardised numbers within their range, buttons as +-1, and standardised logarithms of numbers.

    A button is a number of mean and deviation 1 / 2. A logarithm that is weighed with 0 is left out.
    """
    space, sheet = normalizer.space, raw.sheet
    count, buttons = len(space.continuous), len(space.binary)
    columns = np.concatenate([space.continuous, space.binary])
    rows = raw if np.array_equal(columns, np.arange(space.num_columns)) else raw.columns(columns)
    mean = np.append(as_rows(normalizer.mean)[space.continuous], np.full(buttons, 0.5, dtype=np.float32))
    std = np.append(as_rows(normalizer.std)[space.continuous], np.full(buttons, 0.5, dtype=np.float32))
    order = np.append(np.arange(count), count + 2 * len(space.angular) + np.arange(buttons))
    if not isinstance(perception, NoPerception) and count:
        margin = MARGIN * (perception.largest - perception.least)
        lower, upper = perception.least - margin, perception.largest + margin
        bounds = [as_rows(bound.clamp(-UNBOUNDED, UNBOUNDED))[columns] for bound in (lower, upper)]
        rows = sheet.node("Min", sheet.node("Max", rows, bounds[0]), bounds[1])
        scale = as_rows(perception.log_scale)
        logs = np.flatnonzero(scale)
        if len(logs):
            positive = rows if len(logs) == len(columns) else rows.columns(logs)
            smallest = as_rows(perception.smallest())[logs]
            rows = sheet.join([rows, sheet.node("Max", positive, smallest).apply("Log")])
            mean = np.append(mean, as_rows(perception.log_mean)[logs])
            std = np.append(std, 1 / scale[logs])
            order = np.append(order, space.num_features + logs)
    return Arranged((rows - mean) / std, order)


def _directions(perception: Perception | NoPerception, normalizer: Normalizer, raw: Value) -> list[Arranged]:
    """cos and sin of angles, and of angles relative to the first one."""
    space = normalizer.space
    angular, numbers = len(space.angular), len(space.continuous)
    relative = 0 if isinstance(perception, NoPerception) else angular - 1
    turned = np.zeros((space.num_columns, angular + relative), dtype=np.float32)
    turned[space.angular, np.arange(angular)] = 1
    turned[space.angular[1 : relative + 1], np.arange(angular, angular + relative)] = 1
    turned[space.angular[0], angular:] = -1
    whole = angular == space.num_columns and not relative
    angles = raw if whole else raw.sheet.node("MatMul", raw, turned)
    further = space.num_features + numbers
    return [
        Arranged(angles.apply("Cos"), np.append(numbers + np.arange(angular), further + np.arange(relative))),
        Arranged(
            angles.apply("Sin"),
            np.append(numbers + angular + np.arange(angular), further + relative + np.arange(relative)),
        ),
    ]
