"""Recurrent nets that know where a sequence ends."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn


def reverse_within(sequence: Float[Tensor, "B T F"], lengths: Int[Tensor, " B"]) -> Float[Tensor, "B T F"]:
    """Each sequence backwards within its own length; padding stays behind.

    >>> reverse_within(torch.tensor([[[1.0], [2.0], [0.0]]]), torch.tensor([2])).flatten().tolist()
    [2.0, 1.0, 0.0]
    """
    step = torch.arange(sequence.shape[1], device=sequence.device)
    index = torch.where(step < lengths[:, None], lengths[:, None] - 1 - step, step)
    return sequence.gather(1, index[..., None].expand_as(sequence))


def masked_mean(sequence: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B F"]:
    """Mean over the steps where `mask` is true."""
    share = mask.to(sequence.dtype) / mask.sum(1, keepdim=True)
    return (sequence * share[..., None]).sum(1)


class PooledBidirectionalLSTM(nn.Module):
    """Two one-way LSTMs, one over the reversed sequence, each averaged over the steps within the length.

    Padding reaches neither's outputs within the length, and a mean does not mind in which order they come.
    """

    def __init__(self, in_features: int, hidden_features: int) -> None:
        super().__init__()
        self.forwards = nn.LSTM(in_features, hidden_features, batch_first=True)
        self.backwards = nn.LSTM(in_features, hidden_features, batch_first=True)

    def forward(self, sequence: Float[Tensor, "B T F"], lengths: Int[Tensor, " B"]) -> Float[Tensor, "B H2"]:
        """The means of both directions side by side, (B, 2 hidden_features)."""
        mask = torch.arange(sequence.shape[1], device=sequence.device) < lengths[:, None]
        there, _ = self.forwards(sequence)
        back, _ = self.backwards(reverse_within(sequence, lengths))
        return torch.cat([masked_mean(there, mask), masked_mean(back, mask)], dim=-1)
