"""Arguments of a model, as they are kept in files."""

from __future__ import annotations

from operator import index
from typing import SupportsIndex


def counted(name: str, given: SupportsIndex, least: int = 1, unit: str = "") -> int:
    """A whole number as Python has it, whoever made it.

    Raises `ValueError`, with its `name`, for one below `least` and for what is no whole number.

    >>> import numpy as np
    >>> counted("horizon", np.int64(3))
    3
    >>> counted("horizon", 0, unit=" step")
    Traceback (most recent call last):
    ValueError: horizon must be at least 1 step, got 0
    """
    try:
        whole = index(given)
    except TypeError:
        raise ValueError(f"{name} must be a whole number, got {given!r}") from None
    if whole < least:
        raise ValueError(f"{name} must be at least {least}{unit}, got {whole}")
    return whole
