"""Arithmetic that is written down as ONNX instead of being done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tvae.errors import TvaeError

PACKAGES = ("onnx", "onnxruntime")


class ExportError(TvaeError):
    """A model that cannot be exported; the message says why and what to do."""


def needed(name: str) -> Any:
    """A package of the extra `export`; `ExportError` if it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise ExportError(
            f"export needs the packages {' and '.join(PACKAGES)}, and {name} is not installed: "
            "pip install 'tvae[export]'"
        ) from None


class Sheet:
    """The nodes and constants of a graph, in the order in which they are written.

    Every method that takes values takes numbers and arrays too, which become constants.
    """

    def __init__(self) -> None:
        self._helper = needed("onnx").helper
        self._numpy = needed("onnx").numpy_helper
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._known: dict[tuple[str, tuple[int, ...], bytes], str] = {}
        self._named: dict[str, str] = {}

    def value(self, name: str) -> Value:
        """The value of this name."""
        return Value(self, name)

    def constant(self, content: Content) -> Value:
        """A constant; equal ones are written once. Floats are single precision."""
        if isinstance(content, Tensor):
            content = content.detach().cpu().numpy()
        array = np.asarray(content)
        if array.dtype.kind == "f":
            array = array.astype(np.float32)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._known:
            self._known[key] = f"constant_{len(self.constants)}"
            self.constants.append(self._numpy.from_array(np.ascontiguousarray(array), self._known[key]))
        return Value(self, self._known[key])

    def nodes_of(self, operator: str, inputs: Sequence[Input], outputs: int = 1, **attributes: Any) -> list[Value]:
        """The values that an operator gives; an input that is left out is None."""
        names = ["" if given is None else self.of(given).name for given in inputs]
        found = [f"value_{len(self.nodes)}_{index}" for index in range(outputs)]
        self.nodes.append(self._helper.make_node(operator, names, found, f"{operator}_{len(self.nodes)}", **attributes))
        return [Value(self, name) for name in found]

    def node(self, operator: str, *inputs: Input, **attributes: Any) -> Value:
        """The one value that an operator gives."""
        return self.nodes_of(operator, inputs, **attributes)[0]

    def of(self, given: Value | Content) -> Value:
        """A value as it is, or a constant."""
        return given if isinstance(given, Value) else self.constant(given)

    def name(self, value: Value, name: str) -> None:
        """Let a value be an output of the graph under `name`; one that no operator gave, or that has a name, again."""
        if value.name in self._named or all(value.name not in node.output for node in self.nodes):
            source = self._named.get(value.name, value.name)
            self.nodes.append(self._helper.make_node("Identity", [source], [name], f"output_{name}"))
            return
        for node in self.nodes:
            for names in (node.input, node.output):
                names[:] = [name if found == value.name else found for found in names]
        self._named[value.name] = name

    def join(self, values: Sequence[Value], axis: int = -1) -> Value:
        """Values side by side."""
        return values[0] if len(values) == 1 else self.node("Concat", *values, axis=axis)

    def split(self, value: Value, sizes: Sequence[int], axis: int = -1) -> list[Value | None]:
        """A value cut into pieces; None for a piece without any size."""
        there = [size for size in sizes if size]
        if len(there) == 1:
            pieces = iter([value])
        else:
            pieces = iter(self.nodes_of("Split", [value, np.array(there)], len(there), axis=axis))
        return [next(pieces) if size else None for size in sizes]

    def where(self, condition: Value, yes: Input, no: Input) -> Value:
        """`yes` where the condition holds, else `no`."""
        return self.node("Where", condition, yes, no)


@dataclass(frozen=True, eq=False)
class Value:
    """A tensor of the graph, which exists when the graph runs."""

    sheet: Sheet
    name: str

    def __add__(self, other: Value | Content) -> Value:
        return self.sheet.node("Add", self, other)

    def __sub__(self, other: Value | Content) -> Value:
        return self.sheet.node("Sub", self, other)

    def __rsub__(self, other: Content) -> Value:
        return self.sheet.node("Sub", other, self)

    def __mul__(self, other: Value | Content) -> Value:
        return self.sheet.node("Mul", self, other)

    def __truediv__(self, other: Value | Content) -> Value:
        return self.sheet.node("Div", self, other)

    def above(self, other: Value | Content) -> Value:
        """Whether it is greater."""
        return self.sheet.node("Greater", self, other)

    def below(self, other: Value | Content) -> Value:
        """Whether it is less."""
        return self.sheet.node("Less", self, other)

    def apply(self, operator: str) -> Value:
        """An operator of one input."""
        return self.sheet.node(operator, self)

    def columns(self, indices: Any, axis: int = -1) -> Value:
        """Some of the columns, in an order of their own."""
        return self.sheet.node("Gather", self, np.asarray(indices, dtype=np.int64), axis=axis)

    def unsqueeze(self, axis: int) -> Value:
        """With a further axis of size 1."""
        return self.sheet.node("Unsqueeze", self, np.array([axis]))

    def squeeze(self, axis: int) -> Value:
        """Without an axis of size 1."""
        return self.sheet.node("Squeeze", self, np.array([axis]))

    def sum(self, axis: int) -> Value:
        """The sum over an axis, which goes."""
        return self.sheet.node("ReduceSum", self, np.array([axis]), keepdims=0)

    def reshape(self, *shape: int) -> Value:
        """The same numbers in another shape: 0 keeps a size, -1 is what is left."""
        return self.sheet.node("Reshape", self, np.array(shape))

    def number(self) -> Value:
        """Yes and no, or whole numbers, as single-precision numbers."""
        return self.sheet.node("Cast", self, to=1)


Content: TypeAlias = float | NDArray[Any] | Tensor
Input: TypeAlias = Value | Content | None


def as_rows(tensor: Tensor) -> NDArray[Any]:
    """A parameter as an array."""
    rows: NDArray[Any] = tensor.detach().to(torch.float32).cpu().numpy()
    return rows
