"""Whether ONNX Runtime computes what PyTorch computes, step after step, for several batches and lengths."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
"""The largest difference allowed, of numbers above 1 as a share of them."""
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
    """The same of a graph in PyTorch."""

    def run(given: Mapping[str, NDArray[Any]]) -> Arrays:
        with torch.inference_mode():
            found = graph(*(torch.from_numpy(given[port.name]) for port in graph.inputs))
        return {port.name: tensor.numpy() for port, tensor in zip(graph.outputs, found, strict=True)}

    return run


def check_parity(model: TrajectoryVAE, graph: Graph, path: Path) -> float:
    """The largest difference between a graph in PyTorch and its file in ONNX Runtime.

    Inputs are drawn around what the model was trained on, for several batches and lengths. Where outputs become inputs
    (memory), each side goes on with its own. Raises `ExportError` where the difference is above `TOLERANCE`.
    """
    rng = np.random.default_rng(0)
    exported, original = open_session(path), in_torch(graph)
    worst = 0.0
    for batch, time in _SIZES:
        theirs: Arrays = {}
        ours: Arrays = {}
        for _ in range(_STEPS):
            drawn = {port.name: draw(model, port, rng, batch, time) for port in graph.inputs}
            theirs = exported(drawn | _carried(theirs))
            ours = original(drawn | _carried(ours))
            worst = max(worst, *(difference(port, theirs[port.name], ours[port.name]) for port in graph.outputs))
    if not worst <= TOLERANCE:
        raise ExportError(
            f"{graph.name} in ONNX Runtime differs from PyTorch by {worst:.2e}, and at most {TOLERANCE} is allowed; "
            "nothing was written"
        )
    return worst


def _carried(found: Arrays) -> Arrays:
    return {name.removesuffix("_out"): array for name, array in found.items() if name.endswith("_out")}


def difference(port: Port, left: NDArray[Any], right: NDArray[Any]) -> float:
    """The largest difference of an output's numbers, of those above 1 as a share of them; of directions, the angle.

    >>> difference(Port("heading", (1,), "", angles=(0,)), np.array([3.14]), np.array([3.14 - 2 * np.pi])) < 1e-9
    True
    """
    if left.shape != right.shape:
        raise ExportError(f"{port.name} has the shape {left.shape} in ONNX Runtime and {right.shape} in PyTorch")
    away = np.abs(left.astype(np.float64) - right) / np.maximum(1.0, np.abs(right))
    angles = list(port.angles)
    turned = left[..., angles].astype(np.float64) - right[..., angles] if angles else np.zeros(())
    if angles:
        away[..., angles] = np.abs(turned - 2 * math.pi * np.round(turned / (2 * math.pi)))
    return float(np.max(away, initial=0.0)) if np.isfinite(left).all() else math.inf


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
