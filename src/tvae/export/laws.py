"""The law of a row as named tensors in raw units, and the row that uniform numbers choose from it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from jaxtyping import Float
from torch import Tensor
from torch.distributions import Bernoulli, Categorical, Normal
from torch.nn.functional import one_hot

from tvae.data.normalizer import Normalizer
from tvae.distributions import Joint, Mixture, RowDistribution, VonMises
from tvae.export.draws import category, normal, von_mises
from tvae.export.ports import Port
from tvae.spaces import IntArray, Space


def wrapped(angle: Tensor) -> Tensor:
    """The same direction in [-pi, pi]."""
    return angle - 2 * math.pi * torch.round(angle / (2 * math.pi))


def noise_names(space: Space, num_components: int) -> tuple[str, ...]:
    """What each uniform number decides: the component of a mixture, then each signal by kind; two for a number.

    >>> from tvae.spaces import Angular, Continuous
    >>> noise_names(Space((Angular("heading"), Continuous("force"))), num_components=2)
    ('component', 'force.radius', 'force.angle', 'heading')
    """
    names = space.names
    found = ["component"] if num_components > 1 else []
    found += [f"{names[column]}.radius" for column in space.continuous]
    found += [f"{names[column]}.angle" for column in space.continuous]
    found += [names[column] for columns in (space.angular, space.binary, space.categorical) for column in columns]
    return tuple(found)


def law_ports(normalizer: Normalizer, num_components: int, leading: tuple[int | str, ...]) -> tuple[Port, ...]:
    """The tensors that say the law of a raw row; all have an axis for the K components, K = 1 without."""
    space = normalizer.space
    spread = tuple(normalizer.std[torch.from_numpy(space.continuous)].tolist())
    heads = (*leading, num_components)

    def named(columns: IntArray) -> str:
        return ", ".join(space.names[column] for column in columns)

    ports = [Port("weights", heads, "probability of each component")] if num_components > 1 else []
    if len(space.continuous):
        size, names = len(space.continuous), named(space.continuous)
        ports.append(Port("mean", (*heads, size), f"mean of the Gaussian of {names}, in their units", spread=spread))
        meaning = f"its standard deviation, of {names}, in their units"
        ports.append(Port("deviation", (*heads, size), meaning, spread=spread))
    if len(space.angular):
        size, names = len(space.angular), named(space.angular)
        every = tuple(range(size))
        ports.append(Port("angle", (*heads, size), f"centre of the von Mises law of {names}, radians", angles=every))
        ports.append(Port("angle_deviation", (*heads, size), f"s in its concentration 1 / s^2, of {names}, radians"))
    if len(space.binary):
        ports.append(Port("probability", (*heads, len(space.binary)), f"of yes: {named(space.binary)}"))
    if len(space.categorical):
        shape = (*heads, *space.category_mask.shape)
        meaning = f"of each category of {named(space.categorical)}; 0 behind the last one a signal has"
        ports.append(Port("probabilities", shape, meaning))
    return tuple(ports)


def law_tensors(law: RowDistribution, normalizer: Normalizer) -> dict[str, Tensor]:
    """The tensors that `law_ports` names, of a law of values."""
    space = normalizer.space
    match law:
        case Mixture():
            joint, found = law.components, {"weights": law.weights.probs}
        case Joint():
            joint, found = law, {}
        case _:
            raise TypeError(f"needs a joint law or a mixture of them, got {type(law).__name__}")
    lone = not found
    for part in joint.parts:
        match part.law:
            case Normal():
                columns = torch.from_numpy(space.continuous)
                mean, std = normalizer.mean[columns], normalizer.std[columns]
                tensors = {"mean": part.law.loc * std + mean, "deviation": part.law.scale * std}
            case VonMises():
                tensors = {
                    "angle": wrapped(part.law.loc),
                    "angle_deviation": part.law.concentration.rsqrt(),
                }
            case Bernoulli():
                tensors = {"probability": part.law.probs}
            case Categorical():
                tensors = {"probabilities": part.law.probs}
            case _:
                raise TypeError(f"no law of columns is known that is a {type(part.law).__name__}")
        axis = -3 if isinstance(part.law, Categorical) else -2
        found |= {name: tensor.unsqueeze(axis) if lone else tensor for name, tensor in tensors.items()}
    return found


def choose(
    law: dict[str, Tensor],
    space: Space,
    noise: Float[Tensor, "*batch U"],
    most_likely: Float[Tensor, " 1"],
) -> Float[Tensor, "*batch C"]:
    """The raw row that uniform numbers, in the order of `noise_names`, choose from the law that `law_tensors` gave.

    Where `most_likely` is 1 rather than 0, the mode instead; of a mixture, that of its heaviest component.
    """
    numbers, certain = iter(noise.unbind(-1)), most_likely > 0.5
    if "weights" in law:
        weights = law["weights"]
        index = torch.where(certain, weights.argmax(-1), category(next(numbers), weights))
        component = one_hot(index, weights.shape[-1]).to(weights.dtype)
        law = {name: _of(tensor, component) for name, tensor in law.items() if name != "weights"}
    else:
        law = {name: tensor.squeeze(-3 if name == "probabilities" else -2) for name, tensor in law.items()}
    columns: dict[int, Tensor] = {}
    if len(space.continuous):
        size = len(space.continuous)
        away = law["deviation"] * normal(_next(numbers, size), _next(numbers, size))
        _put(columns, space.continuous, law["mean"] + torch.where(certain, torch.zeros_like(away), away))
    if len(space.angular):
        away = von_mises(_next(numbers, len(space.angular)), law["angle_deviation"].square().reciprocal())
        away = torch.where(certain, torch.zeros_like(away), away)
        _put(columns, space.angular, wrapped(law["angle"] + away))
    if len(space.binary):
        threshold = torch.where(certain, 0.5, _next(numbers, len(space.binary)))
        _put(columns, space.binary, (law["probability"] > threshold).to(noise.dtype))
    if len(space.categorical):
        probabilities = law["probabilities"]
        drawn = category(_next(numbers, len(space.categorical)), probabilities)
        _put(columns, space.categorical, torch.where(certain, probabilities.argmax(-1), drawn).to(noise.dtype))
    return torch.stack([columns[column] for column in range(space.num_columns)], dim=-1)


def _next(numbers: Iterator[Tensor], count: int) -> Tensor:
    return torch.stack([next(numbers) for _ in range(count)], dim=-1)


def _put(columns: dict[int, Tensor], where: IntArray, values: Tensor) -> None:
    for column, value in zip(where.tolist(), values.unbind(-1), strict=True):
        columns[column] = value


def _of(tensor: Tensor, component: Tensor) -> Tensor:
    """The part of the component that a one-hot row (..., K) names, of a tensor (..., K, ...)."""
    axis = component.ndim - 1
    missing = tensor.ndim - component.ndim
    return (tensor * component.reshape(*component.shape, *[1] * missing)).sum(axis)
