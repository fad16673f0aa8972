"""Named rules for the value of a signal where none was recorded.

A rule is called with a signal, the times `at` (N,) at which a value is wanted, and the `times` (M,) and `values` (M,),
M at least 1, that one episode has of it, in order. It gives (N,) values, NaN where it has none, or None: the episode
is then left out. Any function of this form is a rule.

>>> from tvae.spaces import Angular, Continuous
>>> wanted, times, values = np.array([0.5, 1.5, 2.5]), np.array([1.0, 2.0]), np.array([3.0, -3.0])
>>> hold_last(Continuous("x"), wanted, times, values).tolist()
[nan, 3.0, -3.0]
>>> interpolate(Continuous("x"), wanted, times, values).tolist()
[nan, 0.0, nan]
>>> interpolate(Angular("heading"), wanted, times, values)[1].round(6).item() == round(np.pi, 6)
True
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from tvae.spaces import Angular, Continuous, FloatArray, Signal

Estimate: TypeAlias = Callable[[Signal, FloatArray, FloatArray, FloatArray], FloatArray]
"""A rule that always gives values."""
MissingRule: TypeAlias = Callable[[Signal, FloatArray, FloatArray, FloatArray], FloatArray | None]
"""A rule that may also leave the episode out."""


def hold_last(signal: Signal, at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """The latest value that was recorded until then; none before the first."""
    before = np.searchsorted(times, at, side="right") - 1
    return np.where(before >= 0, values[np.maximum(before, 0)], np.nan)


def interpolate(signal: Signal, at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    """On the straight line between the values before and after, of angles on the shorter arc; none outside of them.

    Categories and yes or no have nothing between them: the latest value holds.
    """
    match signal:
        case Continuous():
            return np.interp(at, times, values, left=np.nan, right=np.nan)
        case Angular():
            turned = np.interp(at, times, np.unwrap(values), left=np.nan, right=np.nan)
            return _as_recorded(at, times, values, np.angle(np.exp(1j * turned)))
        case _:
            return hold_last(signal, at, times, values)


def in_turn(*rules: MissingRule) -> MissingRule:
    """The first rule, and each later one where those before it have no value.

    >>> from tvae.spaces import Continuous
    >>> rule = in_turn(interpolate, hold_last)
    >>> rule(Continuous("x"), np.array([1.5, 9.0]), np.array([1.0, 2.0]), np.array([3.0, 5.0])).tolist()
    [4.0, 5.0]
    """

    def rule(signal: Signal, at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray | None:
        found = np.full(len(at), np.nan)
        for one in rules:
            left = np.isnan(found)
            estimated = one(signal, at[left], times, values) if left.any() else found[left]
            if estimated is None:
                return None
            found[left] = estimated
        return found

    return rule


def drop_episode(signal: Signal, at: FloatArray, times: FloatArray, values: FloatArray) -> None:
    """Leave out every episode that lacks a value."""


def _as_recorded(at: FloatArray, times: FloatArray, values: FloatArray, estimated: FloatArray) -> FloatArray:
    """Where a value was recorded, that value and not one that differs by a full turn."""
    before = np.maximum(np.searchsorted(times, at, side="right") - 1, 0)
    return np.where(times[before] == at, values[before], estimated)
