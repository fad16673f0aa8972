"""Whether ONNX Runtime computes what PyTorch computes, step after step, for several batches and lengths."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tvae.data.normalizer import Normalizer
from tvae.export.ports import BATCH, TIME, Graph, Port
from tvae.export.sheet import ExportError, needed
from tvae.model.tvae import TrajectoryVAE

TOLERANCE = 1e-5
"""The largest difference allowed (`differences` says of what)."""
_SIZES = ((1, 1), (1, 7), (4, 3))
_STEPS = 12

Arrays = dict[str, NDArray[Any]]
Session = Callable[[Mapping[str, NDArray[Any]]], Arrays]


def open_session(path: Path) -> Session:
    """A graph in ONNX Runtime, on one core, as a function from named arrays to named arrays."""
    runtime = needed("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return lambda given: dict(zip(names, session.run(names, dict(given)), strict=True))


def in_torch(graph: Graph) -> Session:
    """The same of a graph in PyTorch, in the precision of its weights; numbers come and go in single precision."""
    precision = next(graph.parameters()).dtype

    def tensor(array: NDArray[Any]) -> torch.Tensor:
        given = torch.from_numpy(array)
        return given.to(precision) if given.is_floating_point() else given

    def run(given: Mapping[str, NDArray[Any]]) -> Arrays:
        with torch.inference_mode():
            found = graph(*(tensor(given[port.name]) for port in graph.inputs))
        return {port.name: values.float().numpy() for port, values in zip(graph.outputs, found, strict=True)}

    return run


def check_parity(model: TrajectoryVAE, graph: Graph, path: Path) -> float:
    """The largest difference between a graph in PyTorch and its file in ONNX Runtime.

    Inputs are drawn around what the model was trained on, for several batches and lengths. Where outputs become inputs
    (memory), each side goes on with its own.

    Raises `ExportError` where a difference is above `TOLERANCE`, and also above ten times what PyTorch in single
    precision differs from itself in double: a direction whose cosine and sine nearly vanish is not that exact anywhere.
    """
    rng = np.random.default_rng(0)
    sessions = open_session(path), in_torch(graph), in_torch(deepcopy(graph).double())
    largest = 0.0
    for batch, time in _SIZES:
        found: list[Arrays] = [{}, {}, {}]
        for step in range(_STEPS):
            drawn = {port.name: draw(model, port, rng, batch, time) for port in graph.inputs}
            if "most_likely" in drawn:
                drawn["most_likely"] += step % 2
            found = [run(drawn | carried(before)) for run, before in zip(sessions, found, strict=True)]
            for port in graph.outputs:
                theirs, ours, exact = (arrays[port.name] for arrays in found)
                away = differences(port, theirs, ours)
                largest = max(largest, float(away.max(initial=0.0)))
                if not (away <= TOLERANCE + 10 * differences(port, ours, exact)).all():
                    raise ExportError(
                        f"{port.name} of {graph.name} differs between ONNX Runtime and PyTorch by {away.max():.1e}, "
                        f"and at most {TOLERANCE} is allowed; nothing was written"
                    )
    return largest


def carried(found: Arrays) -> Arrays:
    """The outputs of a step that are inputs of the next one, under their names there."""
    return {name.removesuffix("_out"): array for name, array in found.items() if name.endswith("_out")}


def differences(port: Port, left: NDArray[Any], right: NDArray[Any]) -> NDArray[np.float64]:
    """How far an output's numbers are apart; directions by the angle between them.

    Large numbers, and those of signals that vary a lot, as a share of what is larger, the number or the spread.

    >>> heading = Port("heading", (1,), "", angles=(0,))
    >>> bool(differences(heading, np.array([3.14]), np.array([3.14 - 2 * np.pi])) < 1e-9)
    True
    """
    if left.shape != right.shape:
        raise ExportError(f"{port.name} has the shape {left.shape} in ONNX Runtime and {right.shape} in PyTorch")
    apart = left.astype(np.float64) - right
    spread = np.array(port.spread) if port.spread else np.ones(())
    away = np.abs(apart) / np.maximum(np.maximum(1.0, spread), np.abs(right))
    if port.angles:
        turned = apart[..., list(port.angles)]
        away[..., list(port.angles)] = np.abs(turned - 2 * math.pi * np.round(turned / (2 * math.pi)))
    return away


def draw(model: TrajectoryVAE, port: Port, rng: np.random.Generator, batch: int, time: int) -> NDArray[Any]:
    """Numbers that an input may hold, for a batch of sequences of a length."""
    free = {BATCH: batch, TIME: time}
    shape = tuple(size if isinstance(size, int) else free[size] for size in port.shape)
    match port.name:
        case "observation" | "observations":
            return _rows(model.observation_normalizer, shape, rng)
        case "actions":
            return _rows(model.action_normalizer, shape, rng)
        case "lengths":
            return rng.integers(1, time + 1, shape)
        case "z":
            return rng.normal(size=shape).astype(np.float32)
        case "noise":
            return rng.random(shape, dtype=np.float32)
        case _:
            return np.zeros(shape, dtype=np.float32)


def _rows(normalizer: Normalizer, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    space = normalizer.space
    rows = normalizer.mean.numpy() + 1.5 * normalizer.std.numpy() * rng.normal(size=shape)
    rows[..., space.angular] = rng.uniform(-math.pi, math.pi, (*shape[:-1], len(space.angular)))
    rows[..., space.binary] = rng.integers(0, 2, (*shape[:-1], len(space.binary)))
    for column, count in zip(space.categorical, space.num_categories, strict=True):
        rows[..., column] = rng.integers(0, count, shape[:-1])
    return rows.astype(np.float32)
