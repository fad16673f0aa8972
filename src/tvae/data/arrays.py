"""Arrays in memory as demonstrations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium
import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor

from tvae.data.columns import KindError, encode, signal_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Attribute, DataError, Trajectory
from tvae.gymnasium_spaces import flatten, space_from_gymnasium
from tvae.spaces import FloatArray, Space


def from_arrays(
    observations: Sequence[Any] | NDArray[Any] | Tensor,
    actions: Sequence[Any] | NDArray[Any] | Tensor,
    *,
    observation_space: Space | gymnasium.Space[Any] | None = None,
    action_space: Space | gymnasium.Space[Any] | None = None,
    labels: Sequence[Attribute] | None = None,
    groups: Sequence[Attribute] | None = None,
) -> Demonstrations:
    """Demonstrations from one array an episode: observations (T, O) or (T + 1, O), actions (T, A).

    Arrays are NumPy's, PyTorch's or nested lists; episodes of one length may stand in a single array (E, T, O).

    With a `Space`, arrays hold raw values, one column per signal. With a Gymnasium space they hold its values
    with the time as first axis (a dict of such arrays for a Dict). Without any, the kind of a column follows
    from its type: floating point = continuous, boolean = binary, text or integers with at most 20 different
    values = categorical. An array (T,) is a single column.

    `labels` and `groups` have one value an episode; they and the position of an episode become the attributes
    `label`, `group` and `episode`.

    Raises `DataError` with episode, step and column for what is not usable.

    >>> walks = from_arrays([np.zeros((4, 2))], [np.array([0, 1, 1])], labels=["east"])
    >>> walks.action_space.signals
    (Categorical(name='0', categories=(0, 1)),)
    >>> walks[0].attributes
    {'episode': 0, 'label': 'east'}
    """
    attributes: dict[str, Sequence[Attribute]] = {"episode": range(len(actions))}
    attributes |= {name: given for name, given in (("label", labels), ("group", groups)) if given is not None}
    for name, values in (("observations", observations), *attributes.items()):
        if len(values) != len(actions):
            raise DataError(f"{len(actions)} episodes of actions need as many {name}, got {len(values)}")
    if len(actions) == 0:
        raise DataError("demonstrations need at least one episode, got none")
    observation_space, observation_rows = _rows("observation", observations, observation_space)
    action_space, action_rows = _rows("action", actions, action_space)

    def episodes() -> Iterator[Trajectory]:
        for index, (seen, done) in enumerate(zip(observation_rows, action_rows, strict=True)):
            facts = {name: values[index] for name, values in attributes.items()}
            try:
                yield Trajectory(seen, done, attributes=facts)
            except DataError as error:
                raise DataError(f"episode {index}: {error}") from None

    return Demonstrations.from_trajectories(episodes(), observation_space, action_space)


def _rows(
    what: str, values: Sequence[Any] | NDArray[Any] | Tensor, space: Space | gymnasium.Space[Any] | None
) -> tuple[Space, list[FloatArray]]:
    """The space and, for each episode, raw values (steps, signals)."""
    if isinstance(space, gymnasium.Space):
        try:
            return space_from_gymnasium(space), [flatten(space, value) for value in values]
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(f"{what}s do not fit {space}: {error}") from error
    arrays = [_two_axes(what, index, _array(value)) for index, value in enumerate(values)]
    if space is None:
        return _inferred(what, arrays)
    if any(array.dtype.kind == "U" for array in arrays):
        raise DataError(f"{what}s need raw numbers where a space is given, got text")
    return space, [array.astype(np.float64) for array in arrays]


def _array(value: Any) -> NDArray[Any]:
    """A NumPy array; of a tensor its values, wherever it is."""
    if isinstance(value, Tensor):
        value = value.detach().cpu()
        value = (value.float() if value.dtype == torch.bfloat16 else value).numpy()
    return np.asarray(value)


def _two_axes(what: str, episode: int, array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim not in {1, 2} or array.dtype.kind not in "biufU":
        raise DataError(
            f"episode {episode}: {what}s need an array of numbers, booleans or text of the shape "
            f"(steps, signals), got {array.dtype} of the shape {array.shape}"
            + (": images cannot be learned from" if array.ndim > 2 else "")
        )
    return array[:, None] if array.ndim == 1 else array


def _inferred(what: str, arrays: list[NDArray[Any]]) -> tuple[Space, list[FloatArray]]:
    widths, texts = {array.shape[1] for array in arrays}, {array.dtype.kind == "U" for array in arrays}
    if len(widths) > 1 or len(texts) > 1:
        found = ", ".join(sorted({f"{array.dtype} of width {array.shape[1]}" for array in arrays}))
        raise DataError(f"{what}s of all episodes need the same columns, got {found}")
    together = np.concatenate(arrays)
    signals, columns = [], []
    for index, column in enumerate(together.T):
        values = pa.chunked_array([np.ascontiguousarray(column)])
        try:
            signals.append(signal_of(str(index), values))
        except KindError as error:
            raise DataError(f"column {what}.{index}: {error}: pass {what}_space") from None
        columns.append(encode(signals[-1], values))
    ends = np.cumsum([len(array) for array in arrays])
    return Space(tuple(signals)), np.split(np.stack(columns, axis=1), ends[:-1])
