"""Gradient descent, the same for every method: Adam, its rate falling to nothing along half a cosine, and the best of
the evaluated weights where something is held out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tvae.device import seeded
from tvae.model.inference import inferring

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Descent:
    """How a network is trained.

    >>> line = nn.Linear(1, 1)
    >>> steps = Descent(num_steps=200, learning_rate=0.1)
    >>> x = torch.linspace(-1, 1, 16)[:, None]
    >>> steps.run(line, lambda step: (line(x) - 3 * x).square().mean(), seed=0)
    >>> round(line.weight.item(), 1)
    3.0
    """

    num_steps: int
    learning_rate: float
    clip: float = 1.0
    """Largest gradient norm."""
    evaluate_every: int = 100

    def run(
        self,
        network: nn.Module,
        loss: Callable[[int], Tensor],
        *,
        seed: int,
        judge: Callable[[], float] | None = None,
    ) -> None:
        """Minimise `loss` of each step; keep the weights that `judge` finds lowest, or the last ones.

        Randomness inside depends on `seed` alone. Raises `FloatingPointError` where the loss is not finite.
        """
        optimizer = torch.optim.Adam(network.parameters(), lr=self.learning_rate)
        lowest, best = math.inf, {name: value.clone() for name, value in network.state_dict().items()}
        with seeded(seed, CPU):
            network.train()
            for step in range(self.num_steps):
                for group in optimizer.param_groups:
                    group["lr"] = self.learning_rate * 0.5 * (1 + math.cos(math.pi * step / self.num_steps))
                value = loss(step)
                if not torch.isfinite(value):
                    raise FloatingPointError(f"step {step + 1}: the loss is {value.item()}; lower the learning rate")
                optimizer.zero_grad()
                value.backward()
                nn.utils.clip_grad_norm_(network.parameters(), self.clip)
                optimizer.step()
                if judge is not None and ((step + 1) % self.evaluate_every == 0 or step + 1 == self.num_steps):
                    with inferring(network), seeded(seed, CPU):
                        found = judge()
                    if found < lowest:
                        lowest, best = found, {name: value.clone() for name, value in network.state_dict().items()}
        if judge is not None:
            network.load_state_dict(best)
        network.eval()


def num_parameters(network: nn.Module) -> int:
    """How many numbers are learnt."""
    return sum(parameter.numel() for parameter in network.parameters())
