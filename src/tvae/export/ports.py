"""What goes into a graph and what comes out of it: names, shapes, meanings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from torch import Tensor, nn

from tvae.export.sheet import Value

BATCH = "batch"
TIME = "time"


@dataclass(frozen=True)
class Port:
    """One tensor of a graph. A word in its shape stands for a size that is free."""

    name: str
    shape: tuple[int | str, ...]
    meaning: str
    dtype: str = "float32"
    angles: tuple[int, ...] = ()
    """Positions on the last axis at which values that differ by 2 pi are the same."""
    spread: tuple[float, ...] = ()
    """Standard deviation of what each position on the last axis stands for; 1 if left out."""

    def to_json(self) -> dict[str, Any]:
        """Plain data for the manifest."""
        return {"name": self.name, "dtype": self.dtype, "shape": list(self.shape), "meaning": self.meaning}


class Graph(nn.Module, ABC):
    """A computation on tensors with names, to be written as one file."""

    name: str
    """Its file is `NAME.onnx`."""
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    @abstractmethod
    def compute(self, given: dict[str, Tensor]) -> dict[str, Tensor]:
        """The outputs by name, of the inputs by name, in PyTorch."""

    @abstractmethod
    def write(self, given: dict[str, Value]) -> dict[str, Value]:
        """The same, written down as ONNX."""

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        """The outputs, of the inputs, both in the order of the ports."""
        names = [port.name for port in self.inputs]
        if len(names) != len(tensors):
            raise ValueError(f"{self.name} needs {len(names)} tensors ({', '.join(names)}), got {len(tensors)}")
        found = self.compute(dict(zip(names, tensors, strict=True)))
        return tuple(found[port.name] for port in self.outputs)
