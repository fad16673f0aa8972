"""Action chunks by flow matching: noise is carried to actions along a learnt field, given the present state.

Source: Lipman et al., "Flow matching for generative modeling" (ICLR 2023, arXiv 2210.02747), in the place of
denoising in the receding-horizon scheme of Chi et al., "Diffusion policy" (RSS 2023, arXiv 2303.04137). For a chunk a
and noise e, y_u = (1 - u) e + u a, 0 <= u <= 1, and v is fitted to its direction:

    L = E || v(y_u, u, x_t) - (a - e) ||^2;     acting: y_0 ~ N(0, I), y <- y + v(y, u, x_t) / n, n times.

Actions are carried as numbers stretched to -1 .. 1 (`tvae.baselines.stretching`), as in the source: a turn of a few
degrees is not lost in the noise. The mode is drawn anew with each chunk: no style can be asked for, none persists.
Deviation: an MLP instead of a U-net or a transformer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.baselines.chunks import Chunk, ChunkPolicy, Proposer, learn_chunks
from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.senses import Senses
from tvae.baselines.stretching import Stretched
from tvae.device import seeded

_FREQUENCIES = 8


class FlowNetwork(Proposer):
    """v(y, u, x_t), and the actions that it leads to."""

    def __init__(
        self, senses: Senses, stretched: Stretched, *, num_actions: int, hidden_features: int, num_euler_steps: int
    ) -> None:
        super().__init__()
        self.senses = senses
        self.stretched = stretched
        self.num_actions = num_actions
        self.num_euler_steps = num_euler_steps
        self.width = num_actions * senses.actions.num_features
        self.field = nn.Sequential(
            nn.Linear(self.width + 2 * _FREQUENCIES + 2 * senses.num_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, self.width),
        )

    def forward(
        self, y: Float[Tensor, "N W"], u: Float[Tensor, "N 1"], inputs: Float[Tensor, "N X"]
    ) -> Float[Tensor, "N W"]:
        """v(y, u, x_t)."""
        angles = u * math.pi * torch.arange(1, _FREQUENCIES + 1, device=u.device)
        return self.field(torch.cat([y, angles.cos(), angles.sin(), inputs], dim=-1))

    def loss(self, chunk: Chunk) -> Float[Tensor, ""]:
        """L; behind the end of an episode its last action goes on, as in the source."""
        target = self.stretched(chunk.actions).flatten(1)
        noise, u = torch.randn_like(target), torch.rand(len(target), 1)
        found = self((1 - u) * noise + u * target, u, chunk.inputs)
        return (found - (target - noise)).square().mean()

    def propose(self, inputs: Float[Tensor, "N X"]) -> Float[Tensor, "N K A"]:
        """Noise, carried to actions by Euler's method."""
        y = torch.randn(len(inputs), self.width)
        for step in range(self.num_euler_steps):
            u = torch.full((len(inputs), 1), step / self.num_euler_steps)
            y = y + self(y, u, inputs) / self.num_euler_steps
        return self.stretched.values(y.unflatten(-1, (self.num_actions, -1)))


@dataclass(frozen=True)
class FlowMatching:
    """Cloning of chunks by flow matching."""

    num_actions: int = 8
    num_taken: int = 4
    num_euler_steps: int = 10
    hidden_features: int = 256
    batch_size: int = 256
    num_steps: int = 6_000
    learning_rate: float = 1e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        senses = Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            network = FlowNetwork(
                senses,
                Stretched.fit(lesson.demonstrations, senses),
                num_actions=self.num_actions,
                hidden_features=self.hidden_features,
                num_euler_steps=self.num_euler_steps,
            )
        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        learn_chunks(
            network,
            senses,
            lesson,
            descent,
            FlowNetwork.loss,
            num_actions=self.num_actions,
            batch_size=self.batch_size,
        )
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network)}
        return Bots(ChunkPolicy(network, self.num_taken), facts=facts)
