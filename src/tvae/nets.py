"""Recurrent nets that know where a sequence ends."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn


def reverse_within(
    sequence: Float[Tensor, "B T F"], lengths: Int[Tensor, " B"]
) -> Float[Tensor, "B T F"]:
    """Each sequence backwards within its own length; padding stays behind.

    >>> reverse_within(torch.tensor([[[1.0], [2.0], [0.0]]]), torch.tensor([2])).flatten().tolist()
    [2.0, 1.0, 0.0]
    """
    step = torch.arange(sequence.shape[1], device=sequence.device)
    index = torch.where(step < lengths[:, None], lengths[:, None] - 1 - step, step)
    return sequence.gather(1, index[..., None].expand_as(sequence))


def masked_mean(sequence: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B F"]:
    """Mean over the steps where `mask` is true."""
    weights = mask.to(sequence.dtype)
    return torch.einsum("btf,bt->bf", sequence, weights) / weights.sum(1, keepdim=True)


class BidirectionalLSTM(nn.Module):
    """Two one-way LSTMs, one over the reversed sequence; padding reaches neither's outputs within the length."""

    def __init__(self, in_features: int, hidden_features: int) -> None:
        super().__init__()
        self.forwards = nn.LSTM(in_features, hidden_features, batch_first=True)
        self.backwards = nn.LSTM(in_features, hidden_features, batch_first=True)

    def forward(
        self, sequence: Float[Tensor, "B T F"], lengths: Int[Tensor, " B"]
    ) -> Float[Tensor, "B T H2"]:
        """Both directions' outputs side by side, (B, T, 2 hidden_features)."""
        there, _ = self.forwards(sequence)
        back, _ = self.backwards(reverse_within(sequence, lengths))
        return torch.cat([there, reverse_within(back, lengths)], dim=-1)
