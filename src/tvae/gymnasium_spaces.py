"""Gymnasium spaces, read for what they are, and their values as rows of numbers and back.

| Gymnasium       | signals                                                              |
|-----------------|----------------------------------------------------------------------|
| `Box`           | continuous, one a number; angular where its bounds are exactly +-pi  |
| `Discrete`      | one categorical                                                      |
| `MultiDiscrete` | one categorical a number                                             |
| `MultiBinary`   | one binary a number                                                  |
| `Dict`, `Tuple` | those of its parts, in order, named `part.signal`                    |

An environment may name its numbers in `metadata["signal_names"]`, a mapping with the keys `observation` and
`action`; without it they are numbered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces as gym
from gymnasium.vector import VectorEnv

from tvae.spaces import Angular, Binary, Categorical, Continuous, FloatArray, Signal, Space

_MOST_COLUMNS = 4096


def space_from_gymnasium(space: gymnasium.Space[Any], names: Sequence[str] | None = None) -> Space:
    """The signals of a Gymnasium space.

    Raises `TypeError` for a space that is no vector of numbers (an image, a text, a graph).

    >>> import numpy as np
    >>> action = gym.Dict({"heading": gym.Box(-np.pi, np.pi, dtype=np.float64), "attack": gym.MultiBinary(1)})
    >>> [s.name for s in space_from_gymnasium(action).signals]
    ['attack', 'heading']
    """
    signals = tuple(_signals(space, ()))
    if names is not None:
        if len(names) != len(signals):
            raise ValueError(f"{len(signals)} signals need as many names, got {len(names)}: {', '.join(names)}")
        signals = tuple(_renamed(signal, name) for signal, name in zip(signals, names, strict=True))
    return Space(signals)


def _renamed(signal: Signal, name: str) -> Signal:
    if isinstance(signal, Categorical):
        return Categorical(name, signal.categories)
    return type(signal)(name)


def _names(path: tuple[str, ...], count: int) -> list[str]:
    """Names of a leaf's numbers: the path alone for a single number inside a Dict or Tuple."""
    if count == 1 and path:
        return [".".join(path)]
    return [".".join((*path, str(index))) for index in range(count)]


def _signals(space: gymnasium.Space[Any], path: tuple[str, ...]) -> Iterator[Signal]:
    match space:
        case gym.Box():
            count = int(np.prod(space.shape))
            if np.issubdtype(space.dtype, np.integer) and len(space.shape) >= 2 and count > _MOST_COLUMNS:
                raise TypeError(f"images are not supported: {_where(path)} is {space}; give features instead")
            if count > _MOST_COLUMNS:
                raise TypeError(f"at most {_MOST_COLUMNS} numbers are supported, {_where(path)} is {space}")
            bounds = zip(space.low.ravel(), space.high.ravel(), _names(path, count), strict=True)
            for low, high, name in bounds:
                angular = math.isclose(low, -math.pi, rel_tol=1e-6) and math.isclose(high, math.pi, rel_tol=1e-6)
                yield Angular(name) if angular else Continuous(name)
        case gym.Discrete():
            categories = tuple(range(int(space.start), int(space.start) + int(space.n)))
            yield Categorical(_names(path, 1)[0], categories)
        case gym.MultiDiscrete():
            starts, counts = np.ravel(space.start), np.ravel(space.nvec)
            for start, n, name in zip(starts, counts, _names(path, len(counts)), strict=True):
                yield Categorical(name, tuple(range(int(start), int(start) + int(n))))
        case gym.MultiBinary():
            for name in _names(path, int(np.prod(space.shape))):
                yield Binary(name)
        case gym.Dict():
            for key, part in space.spaces.items():
                yield from _signals(part, (*path, str(key)))
        case gym.Tuple():
            for index, part in enumerate(space.spaces):
                yield from _signals(part, (*path, str(index)))
        case _:
            raise TypeError(
                f"{_where(path)} must be a Box, Discrete, MultiDiscrete, MultiBinary, Dict or Tuple, got {space}"
            )


def _where(path: tuple[str, ...]) -> str:
    return f"space {'.'.join(path)!r}" if path else "the space"


def flatten(space: gymnasium.Space[Any], value: Any) -> FloatArray:
    """Values of a Gymnasium space as rows, shape (*lead, C).

    `value` may be one value (`lead` empty), a batch as a vector environment gives it, or a whole episode as
    Minari gives it: its arrays have the shape (*lead, *space.shape).
    """
    match space:
        case gym.Dict():
            return np.concatenate([flatten(part, value[key]) for key, part in space.spaces.items()], axis=-1)
        case gym.Tuple():
            return np.concatenate([flatten(p, v) for p, v in zip(space.spaces, value, strict=True)], axis=-1)
        case gym.Discrete():
            return np.asarray(value, dtype=np.float64)[..., None] - float(space.start)
    array = np.asarray(value, dtype=np.float64)
    shape = _leaf_shape(space)
    lead = array.shape[: array.ndim - len(shape)]
    if array.shape[len(lead) :] != shape:
        raise ValueError(f"a value of {space} needs the shape {shape}, got {array.shape}")
    if isinstance(space, gym.MultiDiscrete):
        array = array - space.start
    return array.reshape(*lead, -1)


def unflatten(space: gymnasium.Space[Any], rows: FloatArray) -> Any:
    """The inverse of `flatten`: rows (*lead, C) as values that the space contains.

    Numbers of a Box are clipped to its bounds; angles are first wrapped to [-pi, pi).

    >>> unflatten(gym.Dict({"go": gym.Discrete(3, start=1), "x": gym.Box(0, 1, (2,))}), np.array([2.0, 0.5, 9.0]))
    {'go': array(3), 'x': array([0.5, 1. ], dtype=float32)}
    """
    match space:
        case gym.Dict():
            parts = zip(space.spaces.items(), _split(space.spaces.values(), rows), strict=True)
            return {key: unflatten(part, columns) for (key, part), columns in parts}
        case gym.Tuple():
            parts_ = zip(space.spaces, _split(space.spaces, rows), strict=True)
            return tuple(unflatten(part, columns) for part, columns in parts_)
        case gym.Discrete():
            return np.asarray(rows[..., 0] + float(space.start)).astype(space.dtype)
    values = rows.reshape((*rows.shape[:-1], *_leaf_shape(space)))
    if isinstance(space, gym.MultiDiscrete):
        values = values + space.start
    if isinstance(space, gym.Box):
        angles = space_from_gymnasium(space).angular
        if len(angles):
            rows = rows.copy()
            rows[..., angles] = wrap(rows[..., angles])
            values = rows.reshape(values.shape)
        values = np.clip(values.astype(space.dtype), space.low, space.high)
    return np.asarray(values, dtype=space.dtype)


def wrap(angle: FloatArray) -> FloatArray:
    """The same directions in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _leaf_shape(space: gymnasium.Space[Any]) -> tuple[int, ...]:
    assert space.shape is not None
    return tuple(space.shape)


def _split(parts: Any, rows: FloatArray) -> Iterator[FloatArray]:
    start = 0
    for part in parts:
        width = space_from_gymnasium(part).num_columns
        yield rows[..., start : start + width]
        start += width


def spaces_of(envs: VectorEnv[Any, Any, Any]) -> tuple[Space, Space]:
    """Observation and action space of one copy, named by the environment's `signal_names` where it has them."""
    names: Mapping[str, Sequence[str]] = envs.metadata.get("signal_names", {})
    return (
        space_from_gymnasium(envs.single_observation_space, names.get("observation")),
        space_from_gymnasium(envs.single_action_space, names.get("action")),
    )
