"""Policies that decide on the next k actions at once: what they learn from, and how they act.

At step t such a policy sees the present state and its last change, x_t = [s_t; d_t], and gives a_t .. a_{t+k-1}, of
which the first few are taken before it is asked again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from tvae.baselines.contract import Lesson
from tvae.baselines.descending import CPU, Descent
from tvae.baselines.policies import held_apart
from tvae.baselines.senses import Senses
from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.device import seeded
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Chunk:
    """B moments of demonstrations."""

    inputs: Float[Tensor, "B X"]
    """x_t"""
    actions: Float[Tensor, "B K A"]
    """The next k actions, as values; behind the end of an episode the last one again."""
    valid: Bool[Tensor, "B K"]
    """Which of them there are: an episode may end before."""


class ChunkData:
    """All moments of some demonstrations.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(2)
    >>> data = ChunkData(demonstrations, Senses.fit(demonstrations), num_actions=4)
    >>> chunk = data.at(np.array([0, len(data) - 1]))
    >>> chunk.actions.shape, chunk.valid.sum(1).tolist()
    (torch.Size([2, 4, 2]), [4, 1])
    """

    def __init__(self, demonstrations: Demonstrations, senses: Senses, *, num_actions: int) -> None:
        lengths = demonstrations.lengths
        steps = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        rows = demonstrations.observations[ranges(demonstrations.observation_starts, lengths)]
        features = senses(torch.from_numpy(rows).float())
        before = features[np.arange(len(rows)) - (steps > 0)]
        self._inputs = torch.cat([features, senses.changes(features, before)], dim=-1)
        actions = demonstrations.actions[ranges(demonstrations.action_starts, lengths)]
        self._actions = senses.actions.values(torch.from_numpy(actions).float())
        self._left = np.repeat(lengths, lengths) - steps
        self._num_actions = num_actions

    def __len__(self) -> int:
        return len(self._inputs)

    def at(self, moments: IntArray) -> Chunk:
        """The moments at these positions."""
        ahead, left = np.arange(self._num_actions), self._left[moments][:, None]
        index = moments[:, None] + np.minimum(ahead, left - 1)
        return Chunk(self._inputs[moments], self._actions[index], torch.from_numpy(ahead < left))

    def drawn(self, count: int) -> Chunk:
        """Moments at random, by torch's generator."""
        return self.at(torch.randint(len(self), (count,)).numpy())


class Proposer(nn.Module, ABC):
    """A network that gives the next k actions."""

    senses: Senses

    @abstractmethod
    def propose(self, inputs: Float[Tensor, "N X"]) -> Float[Tensor, "N K A"]:
        """Values of the next k actions of N episodes."""


N = TypeVar("N", bound=nn.Module)


def learn_chunks(
    network: N,
    senses: Senses,
    lesson: Lesson,
    descent: Descent,
    loss: Callable[[N, Chunk], Tensor],
    *,
    num_actions: int,
    batch_size: int,
) -> None:
    """Train a network on `batch_size` random moments a step; the weights that are best on a held-out tenth are kept."""
    training, judged = (
        ChunkData(lesson.demonstrations.select(part), senses, num_actions=num_actions)
        for part in held_apart(lesson.demonstrations, 0.1, lesson.seed)
    )
    everything = judged.at(np.arange(len(judged)))
    descent.run(
        network,
        lambda step: loss(network, training.drawn(batch_size)),
        seed=lesson.seed,
        judge=lambda: float(loss(network, everything)),
    )


class ChunkPolicy:
    """A `Policy`: takes the first `num_taken` actions of each proposal, then asks for the next."""

    def __init__(self, network: Proposer, num_taken: int) -> None:
        self.network = network
        self.num_taken = num_taken

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self._random = np.random.default_rng(seed)
        self._last: Tensor | None = None
        self._planned: list[Tensor] = []

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) actions."""
        senses = self.network.senses
        features = senses(torch.from_numpy(observations).float())
        if not self._planned:
            last = features if self._last is None else self._last
            inputs = torch.cat([features, senses.changes(features, last)], dim=-1)
            with seeded(int(self._random.integers(2**62)), CPU):
                proposed = self.network.propose(inputs)
            self._planned = list(proposed[:, : self.num_taken].unbind(1))
        self._last = features
        return senses.actions.raw(self._planned.pop(0)).double().numpy()
