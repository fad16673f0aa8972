"""Networks that learn, and that are asked what they say, in the midst of their training or not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import nn


@contextmanager
def inferring(network: nn.Module) -> Iterator[None]:
    """Inside, no dropout and no gradients; behind, every module is in the mode that it was in, whatever was raised.

    >>> network = nn.Sequential(nn.Dropout(), nn.Linear(1, 1))
    >>> with inferring(network):
    ...     network.training, network(torch.ones(1)).requires_grad
    (False, False)
    >>> network.training, network[0].training, network(torch.ones(1)).requires_grad
    (True, True, True)
    """
    modes = [(module, module.training) for module in network.modules()]
    network.eval()
    try:
        with torch.no_grad():
            yield
    finally:
        for module, training in modes:
            module.training = training


@contextmanager
def learning(network: nn.Module) -> Iterator[None]:
    """Inside, every module is in training mode; behind, none is, whatever was raised.

    >>> network = nn.Sequential(nn.Dropout(), nn.Linear(1, 1))
    >>> with learning(network):
    ...     network[0].training
    True
    >>> network[0].training
    False
    """
    network.train()
    try:
        yield
    finally:
        network.eval()
