"""Where decoders begin without memory: trajectories cut into windows, whole, or seen through a rolling window."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from tvae.data.batches import TrajectoryBatch
from tvae.model.trunks import Places
from tvae.model.tvae import TrajectoryVAE


@dataclass(frozen=True, eq=False)
class Windows:
    """Rows of consecutive steps of trajectories; decoders go through a whole row, and those that are `valid` count."""

    trajectory: Int[Tensor, " R"]
    steps: Int[Tensor, "R W"]
    valid: Bool[Tensor, "R W"]

    @cached_property
    def places(self) -> Places:
        """Row and column of each of the N steps that are valid, in their order."""
        row, column = self.valid.nonzero(as_tuple=True)
        return row, column

    @cached_property
    def counted(self) -> tuple[Int[Tensor, " N"], Int[Tensor, " N"]]:
        """Trajectory and step of each of them.

        >>> [found.tolist() for found in cut(torch.tensor([2, 1]), window=2, offset=1).counted]
        [[0, 0, 1], [0, 1, 0]]
        """
        row, column = self.places
        return self.trajectory[row], self.steps[row, column]


def cut(lengths: Int[Tensor, " B"], window: int, offset: int) -> Windows:
    """Windows of `window` steps that together hold every step once; the first one ends after `offset` steps.

    >>> windows = cut(torch.tensor([5, 2]), window=3, offset=1)
    >>> [steps[valid].tolist() for steps, valid in zip(windows.steps, windows.valid)]
    [[0], [1, 2, 3], [4], [0], [1]]
    """
    longest = int(lengths.max())
    starts = torch.tensor([0, *range(offset or window, longest, window)], device=lengths.device)
    ends = torch.cat([starts[1:], starts.new_tensor([longest])])
    steps = starts[:, None] + torch.arange(min(window, longest), device=lengths.device)
    valid = (steps < ends[:, None]) & (steps < lengths[:, None, None])
    trajectory, piece = torch.nonzero(valid[..., 0], as_tuple=True)
    return Windows(trajectory, steps[piece].clamp_max(longest - 1), valid[trajectory, piece])


def whole(batch: TrajectoryBatch) -> Windows:
    """Every trajectory as one window."""
    steps = torch.arange(batch.actions.shape[1], device=batch.lengths.device)
    everyone = torch.arange(len(batch), device=batch.lengths.device)
    return Windows(everyone, steps.expand(len(batch), -1), batch.mask)


def cut_anywhere(batch: TrajectoryBatch, window: int | None) -> Windows:
    """Windows of `window` steps, cut at a random offset; whole trajectories for None."""
    return whole(batch) if window is None else cut(batch.lengths, window, int(torch.randint(window, ())))


def drawn(batch: TrajectoryBatch, window: int | None, moments: int) -> Windows:
    """What a bot with the rolling window W sees at some random `moments` of each trajectory, which alone count.

    None, a window without end, gives whole trajectories, all steps of which count.
    """
    if window is None:
        return whole(batch)
    window = min(window, int(batch.lengths.max()))
    everyone = torch.arange(len(batch), device=batch.lengths.device).repeat_interleave(moments)
    lengths = batch.lengths[everyone]
    share = torch.rand(len(lengths), dtype=torch.float64)  # on the CPU: not every accelerator knows this precision
    moment = (share * lengths.cpu()).long().to(lengths.device)
    start = (moment - window + 1).clamp_min(0)
    steps = start[:, None] + torch.arange(window, device=batch.lengths.device)
    return Windows(everyone, steps.clamp_max(batch.actions.shape[1] - 1), steps == moment[:, None])


def rolling(lengths: Int[Tensor, " B"], window: int) -> Windows:
    """What a bot with the rolling window W sees: each step at the end of a window of its own.

    The first row of a trajectory is its first W steps, all of which count: before step W nothing is forgotten yet.

    >>> windows = rolling(torch.tensor([3, 1]), window=2)
    >>> windows.steps.tolist(), windows.valid.tolist()
    ([[0, 1], [1, 2], [0, 1]], [[True, True], [False, True], [True, False]])
    """
    longest = int(lengths.max())
    window = min(window, longest)
    steps = torch.arange(longest - window + 1, device=lengths.device)[:, None] + torch.arange(
        window, device=lengths.device
    )
    valid = steps < lengths[:, None, None]
    valid[:, 1:, :-1] = False
    trajectory, piece = torch.nonzero(valid.any(-1), as_tuple=True)
    return Windows(trajectory, steps[piece], valid[trajectory, piece])


def policy_windows(model: TrajectoryVAE, batch: TrajectoryBatch) -> Windows:
    """What the policy decoder sees as a bot: rolling windows of `model.bot_window`, or whole trajectories."""
    return whole(batch) if model.bot_window is None else rolling(batch.lengths, model.bot_window)


def state_windows(model: TrajectoryVAE, batch: TrajectoryBatch) -> Windows:
    """What the state decoder sees: windows as in training, cut from the first step on, or whole trajectories."""
    return whole(batch) if model.window is None else cut(batch.lengths, model.window, 0)
