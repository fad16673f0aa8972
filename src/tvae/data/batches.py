"""Padded batches of trajectories of different lengths, bucketed so that little of them is padding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy.typing import NDArray
from torch import Tensor

from tvae.data.demonstrations import Demonstrations
from tvae.spaces import IntArray

_BUCKETS_PER_POOL = 16
_STEPS_PER_BATCH = 3_200
_FEWEST, _MOST = 32, 64
_MOST_PADDED_STEPS = 1 << 16
"""In a batch of several trajectories."""


@dataclass(frozen=True, eq=False)
class TrajectoryBatch:
    """B trajectories, padded with zeros behind their ends to the longest, T steps. All rows are raw."""

    observations: Float[Tensor, "B T O"]
    next_observations: Float[Tensor, "B T O"]
    """The observation after each action."""
    actions: Float[Tensor, "B T A"]
    lengths: Int[Tensor, " B"]
    next_known: Bool[Tensor, "B T"]
    """Where `next_observations` was recorded: everywhere within the length, but perhaps not at the last step."""

    @property
    def mask(self) -> Bool[Tensor, "B T"]:
        """Where there is a step."""
        steps = torch.arange(self.actions.shape[1], device=self.lengths.device)
        return steps < self.lengths[:, None]

    def __len__(self) -> int:
        return len(self.lengths)


def batch_of(demonstrations: Demonstrations, episodes: IntArray, device: torch.device | None = None) -> TrajectoryBatch:
    """The episodes at these positions as one padded batch of float32."""
    lengths = demonstrations.lengths[episodes]
    step = np.arange(int(lengths.max()))
    within = step < lengths[:, None]
    observed = lengths + demonstrations.final_observed[episodes]
    known = step + 1 < observed[:, None]

    def gather(rows: NDArray[Any], starts: IntArray, where: NDArray[np.bool_], shift: int) -> Tensor:
        index = np.where(where, starts[:, None] + step + shift, starts[:, None])
        values = np.asarray(rows[index], dtype=np.float32)
        values[~where] = 0
        return torch.from_numpy(values).to(device)

    first = demonstrations.observation_starts[episodes]
    return TrajectoryBatch(
        observations=gather(demonstrations.observations, first, within, 0),
        next_observations=gather(demonstrations.observations, first, known, 1),
        actions=gather(demonstrations.actions, demonstrations.action_starts[episodes], within, 0),
        lengths=torch.from_numpy(np.asarray(lengths)).to(device),
        next_known=torch.from_numpy(known).to(device),
    )


def evenly(demonstrations: Demonstrations, most_steps: int) -> Demonstrations:
    """All episodes; of more than about `most_steps` steps, evenly spaced episodes that have about as many together.

    >>> from tvae.data.arrays import from_arrays
    >>> walks = from_arrays([np.zeros(4)] * 6, [np.ones(4)] * 6)
    >>> len(evenly(walks, 100)), evenly(walks, 12).attributes["episode"].tolist()
    (6, [0, 2, 4])
    """
    every = max(1, round(demonstrations.num_steps / most_steps))
    return demonstrations if every == 1 else demonstrations.select(np.arange(0, len(demonstrations), every))


def suitable_batch_size(lengths: IntArray) -> int:
    """How many trajectories of these lengths (E,) have 3,200 steps together; at least 32 and at most 64.

    Of trajectories so long that 32 have more than 65,536 steps it is as many as have those, so that memory suffices.

    >>> [suitable_batch_size(np.full(9, length)) for length in (10, 80, 500, 20_000)]
    [64, 40, 32, 3]
    """
    fewest = np.clip(_MOST_PADDED_STEPS // lengths.mean(), 1, _FEWEST)
    return int(np.clip(round(_STEPS_PER_BATCH / lengths.mean()), fewest, _MOST))


def ordered_batches(demonstrations: Demonstrations, size: int) -> Iterator[IntArray]:
    """Every episode once, shortest first, in groups of at most `size`; for evaluation.

    A group of several has at most 65,536 steps, padding included, so that long episodes need no more memory.

    >>> from tvae.data.arrays import from_arrays
    >>> lengths = (3, 30_000, 2, 40_000, 30_000)
    >>> walks = from_arrays([np.zeros(length) for length in lengths], [np.zeros(length) for length in lengths])
    >>> [group.tolist() for group in ordered_batches(walks, 64)]
    [[2, 0], [1, 4], [3]]
    """
    yield from _parts(demonstrations.lengths, size)


def within_memory(demonstrations: Demonstrations, episodes: IntArray) -> list[IntArray]:
    """These episodes, shortest first, in parts as of `ordered_batches`: a few very long ones among many that are short,
    padded to one length, would need as much memory as if all were long.

    >>> from tvae.data.arrays import from_arrays
    >>> lengths = (30_000, 3, 2, 30_000)
    >>> walks = from_arrays([np.zeros(length) for length in lengths], [np.zeros(length) for length in lengths])
    >>> [part.tolist() for part in within_memory(walks, np.array([0, 1, 2]))]
    [[2, 1], [0]]
    """
    return [episodes[part] for part in _parts(demonstrations.lengths[episodes], len(episodes))]


def _parts(lengths: IntArray, size: int) -> Iterator[IntArray]:
    """Positions of lengths (E,), smallest first, in groups whose padded steps fit in memory."""
    order = np.argsort(lengths, kind="stable")
    lengths, start = lengths[order], 0
    while start < len(order):
        padded = lengths[start : start + size] * np.arange(1, len(lengths[start : start + size]) + 1)
        end = start + max(1, int(np.count_nonzero(padded <= _MOST_PADDED_STEPS)))
        yield order[start:end]
        start = end


@dataclass(frozen=True, eq=False)
class BucketedSampler:
    """Random groups of episodes of similar lengths; which ones depends only on the seed and the step.

    Each epoch visits every episode once: a shuffle is cut into pools of 16 groups, each pool sorted by length
    and cut into groups, and the groups shuffled. What is left over at an epoch's end (less than one group) waits
    for the next epoch, unless there is no whole group at all.

    >>> import numpy as np
    >>> sampler = BucketedSampler(lengths=np.array([5, 1, 4, 2]), size=2, seed=0)
    >>> sorted(int(i) for step in (0, 1) for i in sampler.episodes(step))
    [0, 1, 2, 3]
    """

    lengths: IntArray
    size: int
    seed: int
    _latest: dict[int, list[IntArray]] = field(default_factory=dict, init=False, repr=False)
    """The groups of the epoch that was last asked for."""

    @property
    def steps_per_epoch(self) -> int:
        """Number of groups in an epoch."""
        return max(1, len(self.lengths) // self.size)

    def episodes(self, step: int) -> IntArray:
        """Positions of the episodes of global step `step`."""
        epoch, group = divmod(step, self.steps_per_epoch)
        if epoch not in self._latest:
            self._latest.clear()
            self._latest[epoch] = self._epoch(epoch)
        return self._latest[epoch][group]

    def _epoch(self, epoch: int) -> list[IntArray]:
        rng = np.random.default_rng((self.seed, epoch))
        order = rng.permutation(len(self.lengths))[: self.steps_per_epoch * self.size]
        groups: list[IntArray] = []
        pool = self.size * _BUCKETS_PER_POOL
        for start in range(0, len(order), pool):
            part = order[start : start + pool]
            part = part[np.argsort(self.lengths[part], kind="stable")]
            groups.extend(part[first : first + self.size] for first in range(0, len(part), self.size))
        return [groups[index] for index in rng.permutation(len(groups))]
