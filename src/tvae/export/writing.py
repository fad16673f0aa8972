"""From a graph to an ONNX file."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tvae.errors import TvaeError
from tvae.export.engines import IR_VERSION, OPSET, check_operators
from tvae.export.ports import BATCH, TIME, Graph, Port
from tvae.files import appearing

_PACKAGES = ("onnx", "onnxscript", "onnxruntime")
_OUTPUT = "output of the graph: "
_EXAMPLE = {BATCH: 3, TIME: 5}


class ExportError(TvaeError):
    """A model that cannot be exported; the message says why and what to do."""


def needed(name: str) -> Any:
    """A package of the extra `export`; `ExportError` if it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise ExportError(
            f"export needs the packages {', '.join(_PACKAGES)}, and {name} is not installed: pip install 'tvae[export]'"
        ) from None


def example(port: Port) -> Tensor:
    """A tensor of a port's shape."""
    shape = [size if isinstance(size, int) else _EXAMPLE[size] for size in port.shape]
    return torch.full(shape, _EXAMPLE[TIME]) if port.dtype == "int64" else torch.full(shape, 0.5)


def write_onnx(graph: Graph, path: Path) -> tuple[str, ...]:
    """Write a graph, whole or not at all, and return the names of the operators that it uses.

    Raises `ExportError` where a package is missing, and `ValueError` for an operator that not every engine knows.
    """
    for package in _PACKAGES[:2]:
        needed(package)
    free = {BATCH: torch.export.Dim(BATCH), TIME: torch.export.Dim(TIME)}
    shapes = tuple(
        {axis: free[size] for axis, size in enumerate(port.shape) if isinstance(size, str)} for port in graph.inputs
    )
    with _quiet(), _recurrent_weights_kept(graph):
        program = torch.onnx.export(
            graph,
            tuple(example(port) for port in graph.inputs),
            input_names=[port.name for port in graph.inputs],
            output_names=[_OUTPUT + port.name for port in graph.outputs],
            dynamic_shapes=(shapes,),
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    proto = program.model_proto
    proto.ir_version = IR_VERSION
    _strip(proto)
    _rename(proto)
    operators = tuple(sorted({node.op_type for node in proto.graph.node}))
    check_operators(operators, graph.name)
    needed("onnx").checker.check_model(proto, full_check=True)
    with appearing(path, overwrite=True) as partial:
        partial.write_bytes(proto.SerializeToString(deterministic=True))
    return operators


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what torch says about its own insides while it exports."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), torch.no_grad():
            warnings.filterwarnings("ignore", category=FutureWarning)
            warnings.filterwarnings("ignore", category=DeprecationWarning)
            warnings.filterwarnings("ignore", message=r"# The axis name: .* will not be used")
            warnings.filterwarnings("ignore", message=r"The tensor attributes? .*_flat_weights")
            yield
    finally:
        logger.setLevel(level)


@contextmanager
def _recurrent_weights_kept(graph: Graph) -> Iterator[None]:
    """Exporting puts stand-ins into the recurrent nets' lists of weights; afterwards they hold their own again."""
    nets = [module for module in graph.modules() if isinstance(module, nn.LSTM)]
    lists = [list(net._flat_weights) for net in nets]
    try:
        yield
    finally:
        for net, weights in zip(nets, lists, strict=True):
            net._flat_weights = weights


def _strip(proto: Any) -> None:
    """Take away what says where and how the graph was made, and what older engines do not read."""
    proto.producer_name, proto.producer_version = "tvae", ""
    del proto.metadata_props[:]
    del proto.functions[:]
    del proto.graph.metadata_props[:]
    del proto.graph.value_info[:]
    for part in (*proto.graph.node, *proto.graph.initializer, *proto.graph.input, *proto.graph.output):
        del part.metadata_props[:]
        part.doc_string = ""
    for number, node in enumerate(proto.graph.node):
        node.name = f"{node.op_type}_{number}"


def _rename(proto: Any) -> None:
    """Number the values within a graph, and give its outputs their names, which are some of torch's for values."""
    names = {port.name: port.name for port in proto.graph.input}
    for number, part in enumerate(proto.graph.initializer):
        names[part.name] = part.name = f"constant_{number}"
    for number, output in enumerate(output for node in proto.graph.node for output in node.output if output):
        names[output] = output.removeprefix(_OUTPUT) if output.startswith(_OUTPUT) else f"value_{number}"
    for node in proto.graph.node:
        node.input[:] = [names[name] if name else name for name in node.input]
        node.output[:] = [names[name] if name else name for name in node.output]
    for port in proto.graph.output:
        port.name = names[port.name]
