"""Where tensors live, by the name that users type, and where their randomness comes from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import index
from typing import SupportsIndex

import torch

from tvae.errors import TvaeError


class DeviceError(TvaeError):
    """A device that is unknown or not there."""


def resolve_device(device: str | torch.device) -> torch.device:
    """The device called `auto` (the best there is), `cpu`, `cuda` (or `cuda:N`) or `mps`.

    Raises `DeviceError` for an unknown name, or a device that this machine does not have.

    >>> resolve_device("cpu")
    device(type='cpu')
    """
    name = str(device)
    there = {"cpu": True, "cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    if name == "auto":
        return torch.device(next(kind for kind in ("cuda", "mps", "cpu") if there[kind]))
    kind, colon, index = name.partition(":")
    if kind not in there or (colon and not (kind == "cuda" and index.isdecimal())):
        raise DeviceError(f"device must be auto, cpu, cuda, cuda:N or mps, got {name!r}")
    if not there[kind] or (index and int(index) >= torch.cuda.device_count()):
        usable = ", ".join(kind for kind, usable in there.items() if usable)
        raise DeviceError(f"device {name!r} is not there; this machine and this torch have: {usable}")
    return torch.device(name)


def reseed(seed: SupportsIndex, device: torch.device) -> None:
    """Let the randomness of the CPU and of `device` depend on `seed` alone from here on.

    `torch.manual_seed` does so on all devices there may be, which takes far longer.
    """
    seed = index(seed)  # PyTorch takes no whole number of NumPy's
    torch.default_generator.manual_seed(seed)
    if device.type == "cuda":
        with torch.cuda.device(device):
            torch.cuda.manual_seed(seed)
    elif device.type == "mps":
        torch.mps.manual_seed(seed)


@contextmanager
def seeded(seed: SupportsIndex, device: torch.device) -> Iterator[None]:
    """Inside, randomness depends on `seed` alone; behind, it goes on as if nothing had happened.

    >>> def draw() -> float:
    ...     with seeded(3, torch.device("cpu")):
    ...         return torch.rand(()).item()
    >>> draw() == draw()
    True
    """
    with torch.random.fork_rng([] if device.type == "cpu" else [device], device_type=device.type):
        reseed(seed, device)
        yield
