"""The uniform numbers that a graph is given, turned into what each draw needs, all of them at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tvae.export.arranged import Affine, Arranged, mapped
from tvae.export.draws import SMALLEST
from tvae.export.sheet import Value
from tvae.heads import Head

_UPPER = (-1.0, 1.0)
"""Slope and shift of 1 - u."""
_SAME = (1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Numbers:
    """What draws need of the numbers u in [0, 1), in the order of `noise_names`; None for what is not drawn.

    Where the most likely row is wanted, they are what makes a draw the mode, but for components and categories.
    """

    certain: Value
    """(1,) whether the most likely row is wanted."""
    component: Value | None
    """(..., 1) 1 - u"""
    radius: Value | None
    """(..., number of continuous signals) 1 - u"""
    turn: Value | None
    """(..., number of continuous signals) 2 pi u"""
    below: Value | None
    """(..., number of angles) 2 u"""
    beyond: Value | None
    """(..., number of angles) 2 - 2 u"""
    side: Value | None
    """(..., number of angles) 2 u - 1"""
    binary: Value | None
    """(..., number of buttons) u"""
    categorical: Value | None
    """(..., number of categorical signals) 1 - u"""
    further: Value | None
    """(..., number of them) u of numbers that stand behind those of the head"""


def numbers_of(noise: Value, most_likely: Value, head: Head, further: int, rank: int) -> Numbers:
    """What draws from the law of a head need, and `further` thresholds, of `noise` (..., U)."""
    sheet, space = noise.sheet, head.space
    kinds = (  # how many numbers, where the mode is, slope and shift of what is made of each
        (int(head.num_components > 1), 0.5, (_UPPER,)),
        (len(space.continuous), 0.0, (_UPPER,)),
        (len(space.continuous), 0.0, ((2 * math.pi, 0.0),)),
        (len(space.angular), 0.5, ((2.0, 0.0), (-2.0, 2.0), (2.0, -1.0))),
        (len(space.binary), 0.5, (_SAME,)),
        (len(space.categorical), 0.5, (_UPPER,)),
        (further, 0.5, (_SAME,)),
    )
    width = sum(count for count, _, _ in kinds)
    weights, shifts, begin = [], [], 0
    for count, _, lines in kinds:
        own = np.eye(width, dtype=np.float32)[begin : begin + count]
        weights += [slope * own for slope, _ in lines]
        shifts += [np.full(count, shift, dtype=np.float32) for _, shift in lines]
        begin += count
    certain = most_likely.above(0.5)
    modes = np.concatenate([np.full(count, mode) for count, mode, _ in kinds])
    settled = sheet.where(certain, modes, sheet.node("Clip", noise, SMALLEST, 1 - SMALLEST))
    lines_of_all = Affine(np.concatenate(weights), np.concatenate(shifts))
    made = mapped(Arranged(settled, np.arange(width)), lines_of_all, rank=rank)
    return Numbers(certain, *sheet.split(made, [len(shift) for shift in shifts]))
