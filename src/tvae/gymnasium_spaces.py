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
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces as gym
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from tvae.errors import TvaeError
from tvae.spaces import Angular, Binary, Categorical, Continuous, FloatArray, Signal, Space

_MOST_COLUMNS = 4096
_SUPPORTED = (
    f"supported are Discrete, MultiDiscrete, MultiBinary and Box of at most {_MOST_COLUMNS:,} numbers, and Dict and "
    "Tuple of them"
)
_PI_TOLERANCE = 1e-6
"""pi in single precision differs from pi by 9e-8."""


class UnsupportedSpaceError(TvaeError):
    """A space that is no vector of numbers; the message says which part, what it holds and what is supported."""


def space_from_gymnasium(space: gymnasium.Space[Any], names: Sequence[str] | None = None) -> Space:
    """The signals of a Gymnasium space.

    Raises `UnsupportedSpaceError` for a space that is no vector of numbers (an image, a text, a graph), or has none.

    >>> import numpy as np
    >>> heading = gym.Box(-np.pi, np.pi, dtype=np.float64)
    >>> action = gym.Dict({"heading": heading, "attack": gym.MultiBinary(1)})
    >>> [s.name for s in space_from_gymnasium(action).signals]
    ['attack', 'heading']
    """
    signals = tuple(_signals(space, ()))
    if not signals:
        raise UnsupportedSpaceError(f"{space} holds no numbers at all: {_SUPPORTED}")
    if names is not None:
        if len(names) != len(signals):
            raise ValueError(
                f"{len(signals)} signals need as many names, got {len(names)}: {', '.join(names)}"
            )
        signals = tuple(replace(signal, name=name) for signal, name in zip(signals, names, strict=True))
    return Space(signals)


def gymnasium_from_space(space: Space) -> gymnasium.Space[Any]:
    """A Gymnasium space of the same signals in the same order.

    Signals of one kind make one Box (numbers and angles, float64), MultiBinary, Discrete or MultiDiscrete; a
    mixture makes a Dict with a part for each signal. `space_from_gymnasium(..., space.names)` reads it back,
    except that categories are then 0 .. K-1 unless they were consecutive integers.

    >>> gymnasium_from_space(Space((Continuous("x"), Continuous("y"))))
    Box(-inf, inf, (2,), float64)
    >>> gymnasium_from_space(Space((Categorical("move", ("left", "right")), Binary("jump"))))
    Dict('move': Discrete(2), 'jump': MultiBinary(1))
    """
    signals = space.signals
    if all(isinstance(signal, Continuous | Angular) for signal in signals):
        bounds = np.full(len(signals), np.inf)
        bounds[space.angular] = np.pi
        return gym.Box(-bounds, bounds, dtype=np.float64)
    if all(isinstance(signal, Binary) for signal in signals):
        return gym.MultiBinary(len(signals))
    if all(isinstance(signal, Categorical) for signal in signals):
        starts = [_start(signal.categories) for signal in signals if isinstance(signal, Categorical)]
        if len(starts) == 1:
            return gym.Discrete(space.num_categories[0], start=starts[0])
        return gym.MultiDiscrete(np.array(space.num_categories), start=np.array(starts))
    return by_name(space)


def by_name(space: Space) -> gym.Dict:
    """A Gymnasium Dict with a part for each signal, under its name and in the same order, whatever their kinds.

    >>> by_name(Space((Continuous("x"), Categorical("move", ("left", "right")))))
    Dict('x': Box(-inf, inf, (1,), float64), 'move': Discrete(2))
    """
    return gym.Dict(OrderedDict((signal.name, gymnasium_from_space(Space((signal,)))) for signal in space.signals))


def _start(categories: tuple[int | str, ...]) -> int:
    """The first of consecutive integers, 0 for anything else."""
    first = categories[0]
    if isinstance(first, int) and categories == tuple(range(first, first + len(categories))):
        return first
    return 0


def _names(path: tuple[str, ...], count: int) -> list[str]:
    """Names of a leaf's numbers: the path alone for a single number inside a Dict or Tuple."""
    if count == 1 and path:
        return [".".join(path)]
    return [".".join((*path, str(index))) for index in range(count)]


def _signals(space: gymnasium.Space[Any], path: tuple[str, ...]) -> Iterator[Signal]:
    match space:
        case gym.Box():
            yield from _box_signals(space, path)
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
            raise UnsupportedSpaceError(f"{_where(path)} is {space}, which is no vector of numbers: {_SUPPORTED}")


def _box_signals(space: gym.Box, path: tuple[str, ...]) -> Iterator[Signal]:
    count = int(np.prod(space.shape))
    if count > _MOST_COLUMNS:
        many = "as images have: images cannot be learned from" if len(space.shape) >= 2 else "which are too many"
        raise UnsupportedSpaceError(
            f"{_where(path)} has the shape {space.shape} and dtype {space.dtype}, {count:,} numbers, {many}; "
            f"{_SUPPORTED}"
        )
    for angular, name in zip(_angular(space), _names(path, count), strict=True):
        yield Angular(name) if angular else Continuous(name)


def _angular(space: gym.Box) -> NDArray[np.bool_]:
    """(C,) which numbers of a Box are angles: those bounded by exactly -pi and pi."""
    low, high = space.low.ravel(), space.high.ravel()
    distance = np.maximum(np.abs(low + np.pi), np.abs(high - np.pi))
    return np.asarray(distance < _PI_TOLERANCE)


def _where(path: tuple[str, ...]) -> str:
    return f"space {'.'.join(path)!r}" if path else "the space"


def flatten(space: gymnasium.Space[Any], value: Any) -> FloatArray:
    """Values of a Gymnasium space as rows, shape (*lead, C).

    `value` may be one value (`lead` empty), a batch as a vector environment gives it, or a whole episode as
    Minari gives it: its arrays have the shape (*lead, *space.shape). A number alone may stand for an array (1,).
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
    if array.ndim == 0 and shape == (1,):
        array = array[None]
    lead = array.shape[: array.ndim - len(shape)]
    if array.shape[len(lead) :] != shape:
        raise ValueError(f"a value of {space} needs the shape {shape}, got {array.shape}")
    if isinstance(space, gym.MultiDiscrete):
        array = array - space.start
    return array.reshape(*lead, -1)


def unflatten(space: gymnasium.Space[Any], rows: FloatArray) -> Any:
    """The inverse of `flatten`: rows (*lead, C) as values that the space contains.

    Numbers of a Box are clipped to its bounds, and rounded where it holds integers; angles beyond +-pi are
    first wrapped to [-pi, pi).

    >>> space = gym.Dict({"go": gym.Discrete(3, start=1), "x": gym.Box(0, 1, (2,))})
    >>> unflatten(space, np.array([2.0, 0.5, 9.0]))
    {'go': np.int64(3), 'x': array([0.5, 1. ], dtype=float32)}
    """
    match space:
        case gym.Dict():
            parts = zip(space.spaces.items(), _split(space.spaces.values(), rows), strict=True)
            return {key: unflatten(part, columns) for (key, part), columns in parts}
        case gym.Tuple():
            parts_ = zip(space.spaces, _split(space.spaces, rows), strict=True)
            return tuple(unflatten(part, columns) for part, columns in parts_)
        case gym.Discrete():
            values = np.asarray(rows[..., 0] + float(space.start)).astype(space.dtype)
            return values[()]  # a single one as a number: environments look things up with it
    shape = (*rows.shape[:-1], *_leaf_shape(space))
    if isinstance(space, gym.Box):
        outside = _angular(space) & (np.abs(rows) > np.pi)
        values = np.where(outside, wrap(rows), rows).reshape(shape)
        values = np.clip(values, space.low, space.high)
        if np.issubdtype(space.dtype, np.integer):
            values = np.rint(values)
    else:
        values = rows.reshape(shape)
        if isinstance(space, gym.MultiDiscrete):
            values = values + space.start
    return np.asarray(values).astype(space.dtype)


def wrap(angle: FloatArray) -> FloatArray:
    """The same directions in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _leaf_shape(space: gymnasium.Space[Any]) -> tuple[int, ...]:
    assert space.shape is not None
    return tuple(space.shape)


def _width(space: gymnasium.Space[Any]) -> int:
    """Number of columns that `flatten` gives a value."""
    match space:
        case gym.Dict():
            return sum(_width(part) for part in space.spaces.values())
        case gym.Tuple():
            return sum(_width(part) for part in space.spaces)
    return math.prod(_leaf_shape(space))


def _split(parts: Any, rows: FloatArray) -> Iterator[FloatArray]:
    start = 0
    for part in parts:
        width = _width(part)
        yield rows[..., start : start + width]
        start += width


def spaces_of(envs: VectorEnv[Any, Any, Any]) -> tuple[Space, Space]:
    """Observation and action space of one copy, named by the environment's `signal_names` if it has any."""
    return named_spaces(
        envs.single_observation_space, envs.single_action_space, envs.metadata.get("signal_names", {})
    )


def named_spaces(
    observation_space: gymnasium.Space[Any], action_space: gymnasium.Space[Any], names: Mapping[str, Sequence[str]]
) -> tuple[Space, Space]:
    """The signals of both, called as `names` has them under `observation` and `action`, else numbered.

    Raises `UnsupportedSpaceError` for what is no vector of numbers, and `TvaeError` for names that are more or
    fewer than the signals, as behind a wrapper that adds some.

    >>> place, move = gym.Box(-1, 1, (2,)), gym.Discrete(3)
    >>> observations, actions = named_spaces(place, move, {"observation": ["x", "y"]})
    >>> observations.names, actions.names
    (('x', 'y'), ('0',))
    """
    found = []
    for what, space in (("observation", observation_space), ("action", action_space)):
        try:
            found.append(space_from_gymnasium(space, names.get(what)))
        except UnsupportedSpaceError as error:
            raise UnsupportedSpaceError(
                f"{what}s of the environment: {error}. A wrapper can give numbers instead, such as the state of the "
                "game; gymnasium.wrappers.FilterObservation leaves parts of a Dict out"
            ) from error
        except ValueError as error:
            raise TvaeError(
                f"the environment's metadata['signal_names'][{what!r}] does not fit its {what} space: {error}. "
                "A wrapper that adds or leaves out signals needs a metadata of its own that names them, or none"
            ) from error
    return found[0], found[1]
