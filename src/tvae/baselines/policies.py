"""pi(a_t | s_1:t, c): a trunk and a head, trained on the log-likelihood of actions, and acting step by step.

c is whatever a method conditions on: nothing, a label, a latent. The loss is the mean over all steps of the batch,

    L = - sum_i sum_t log pi(a_it | s_i,1:t, c_i) / sum_i T_i.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.baselines.contract import AnyOf, Bots, Codes, Lesson, by_label
from tvae.baselines.descending import CPU, Descent
from tvae.baselines.senses import Senses
from tvae.data.batches import BucketedSampler, TrajectoryBatch, batch_of, ordered_batches, suitable_batch_size
from tvae.data.demonstrations import Demonstrations
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.model.trunks import LARGEST, Memory, Places, Trunk
from tvae.spaces import FloatArray, IntArray

ACTION_FLOOR = 0.02
"""Smallest standard deviation of an action, as in our own policy decoder."""

CodeOf: TypeAlias = Callable[[IntArray, TrajectoryBatch], Tensor]
"""(B, Z) codes of the episodes at these positions."""


class MemorylessTrunk(Trunk):
    """An MLP over [s_t; z]: what came before is not seen.

    >>> features, _ = MemorylessTrunk(3, 2, 8)(torch.zeros(5, 7, 3), torch.zeros(5, 2))
    >>> features.shape[-1]
    8
    """

    def __init__(self, in_features: int, latent_features: int, hidden_features: int) -> None:
        super().__init__(in_features, hidden_features)
        self.layers = nn.Sequential(
            nn.Linear(in_features + latent_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
        )

    def forward(
        self,
        inputs: Float[Tensor, "B T S"],
        z: Float[Tensor, "B Z"],
        memory: Memory | None = None,
        at: Places | None = None,
    ) -> tuple[Float[Tensor, "*batch F"], Memory]:
        joined = torch.cat([inputs, z[:, None].expand(-1, inputs.shape[1], -1)], dim=-1)
        return self.layers(joined if at is None else joined[at]), _only(inputs[:, -1:])


class MovingTrunk(Trunk):
    """An MLP over [s_t; d_t; z], d_t the last change of s as in `ReactiveTrunk`: what came before it is not seen.

    >>> features, _ = MovingTrunk(3, 2, 8)(torch.zeros(5, 7, 3), torch.zeros(5, 2))
    >>> features.shape[-1]
    8
    """

    def __init__(self, in_features: int, latent_features: int, hidden_features: int) -> None:
        super().__init__(in_features, hidden_features)
        self.momentary = MemorylessTrunk(2 * in_features, latent_features, hidden_features)

    def forward(
        self,
        inputs: Float[Tensor, "B T S"],
        z: Float[Tensor, "B Z"],
        memory: Memory | None = None,
        at: Places | None = None,
    ) -> tuple[Float[Tensor, "*batch F"], Memory]:
        last = inputs[:, :1] if memory is None else memory.last
        changes = ((inputs - torch.cat([last, inputs[:, :-1]], dim=1)) / self.unit).clamp(-LARGEST, LARGEST)
        features, _ = self.momentary(torch.cat([inputs, changes], dim=-1), z, at=at)
        return features, _only(inputs[:, -1:])


def _only(last: Tensor) -> Memory:
    """Nothing but the last input."""
    nothing = last.new_zeros(1, len(last), 0)
    return Memory(nothing, nothing, last)


class PolicyNetwork(nn.Module):
    """pi(a_t | s_1:t, c) over raw observations; the law is one of action values (`tvae.data.normalizer`)."""

    def __init__(self, senses: Senses, trunk: Trunk, *, num_components: int) -> None:
        super().__init__()
        self.senses = senses
        self.trunk = trunk
        self.head = Head(senses.actions.space, trunk.num_features, floor=ACTION_FLOOR, num_components=num_components)
        trunk.unit.copy_(senses.unit)

    def forward(
        self, observations: Float[Tensor, "B T O"], code: Float[Tensor, "B Z"], memory: Memory | None = None
    ) -> tuple[RowDistribution, Memory]:
        """The law of each step's action, and the memory behind the last step."""
        features, memory = self.trunk(self.senses(observations), code, memory)
        origin = features.new_zeros(*features.shape[:-1], self.senses.actions.space.num_columns)
        return self.head(features, origin), memory

    def loss(self, batch: TrajectoryBatch, code: Float[Tensor, "B Z"]) -> Float[Tensor, ""]:
        """L, in nats per step."""
        law, _ = self(batch.observations, code)
        return -(law.log_prob(self.senses.actions.values(batch.actions)) * batch.mask).sum() / batch.mask.sum()


class NetworkPolicy:
    """A `Policy`: the network with actions drawn from its law, and a code of its own in each episode."""

    def __init__(self, network: PolicyNetwork, codes: Codes) -> None:
        self.network = network
        self.codes = codes

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self._random = np.random.default_rng(seed)
        self._code = torch.from_numpy(self.codes.sample(num_episodes, self._random)).float()
        self._memory: Memory | None = None

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) actions."""
        rows = torch.from_numpy(observations).float()[:, None]
        law, self._memory = self.network(rows, self._code, self._memory)
        with seeded(int(self._random.integers(2**62)), CPU):
            values = law.sample()[:, 0]
        return self.network.senses.actions.raw(values).double().numpy()


def coded_bots(network: PolicyNetwork, codes: FloatArray, lesson: Lesson, facts: Mapping[str, Any]) -> Bots:
    """Bots of a network with the codes (E, Z) of the demonstrations: at will any, for a label those that carry it."""
    return Bots(
        NetworkPolicy(network, AnyOf(codes)),
        {label: NetworkPolicy(network, code) for label, code in by_label(codes, lesson).items()},
        facts,
    )


def no_code(episodes: IntArray, batch: TrajectoryBatch) -> Tensor:
    """(B, 0)"""
    return torch.zeros(len(episodes), 0)


def clone(
    network: PolicyNetwork,
    demonstrations: Demonstrations,
    code_of: CodeOf,
    descent: Descent,
    *,
    seed: int,
    held_out: float = 0.1,
) -> None:
    """Train on the log-likelihood of actions; of the evaluated weights those best on a held-out share are kept.

    Where nothing is held out (0), the last weights are kept.
    """
    training, judged = held_apart(demonstrations, held_out, seed)
    sampler = BucketedSampler(demonstrations.lengths[training], suitable_batch_size(demonstrations.lengths), seed)

    def loss(step: int) -> Tensor:
        episodes = training[sampler.episodes(step)]
        batch = batch_of(demonstrations, episodes)
        return network.loss(batch, code_of(episodes, batch))

    def judge() -> float:
        total = 0.0
        for part in ordered_batches(demonstrations.select(judged), 64):
            batch = batch_of(demonstrations, judged[part])
            total += float(network.loss(batch, code_of(judged[part], batch))) * float(batch.lengths.sum())
        return total / float(demonstrations.lengths[judged].sum())

    descent.run(network, loss, seed=seed, judge=judge if len(judged) else None)


def held_apart(demonstrations: Demonstrations, held_out: float, seed: int) -> tuple[IntArray, IntArray]:
    """`positions` of the training and the held-out demonstrations; those of one attribute `group` stay together."""
    if "group" not in demonstrations.attributes:
        return positions(len(demonstrations), held_out, seed)
    names, groups = np.unique(demonstrations.attributes["group"], return_inverse=True)
    _, judged = positions(len(names), held_out, seed)
    is_judged = np.isin(groups, judged)
    return np.flatnonzero(~is_judged), np.flatnonzero(is_judged)


def positions(count: int, held_out: float, seed: int) -> tuple[IntArray, IntArray]:
    """Where the training and the held-out episodes stand: about this share of them, at least one of each.

    A share of 0 holds out none.

    >>> [part.tolist() for part in positions(4, 0.25, seed=0)]
    [[0, 1, 3], [2]]
    """
    order = np.random.default_rng(seed).permutation(count)
    taken = min(max(1, round(held_out * count)), count - 1) if held_out else 0
    return np.sort(order[taken:]), np.sort(order[:taken])
