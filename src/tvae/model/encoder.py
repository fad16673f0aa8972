"""q(z | tau) = N(mu, diag sigma^2), with mu and log sigma^2 from the mean of a bidirectional LSTM over [s_t; a_t].

Where trajectories have a summary of their own, such as the areas of `tvae.model.ranks`, it joins that mean.
"""

from __future__ import annotations

from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.distributions import Normal

from tvae.nets import PooledBidirectionalLSTM

LOG_VARIANCE_RANGE = (-14.0, 4.0)


class Encoder(nn.Module):
    """The posterior of z given a whole trajectory of any length. Padding changes nothing.

    >>> import torch
    >>> encoder = Encoder(in_features=3, latent_features=2, hidden_features=8)
    >>> encoder(torch.zeros(5, 7, 3), torch.full((5,), 7)).mean.shape
    torch.Size([5, 2])
    """

    def __init__(
        self,
        in_features: int,
        latent_features: int,
        hidden_features: int,
        dropout: float = 0.0,
        *,
        summary_features: int = 0,
    ) -> None:
        super().__init__()
        self.recurrent = PooledBidirectionalLSTM(in_features, hidden_features)
        self.dropout = nn.Dropout(dropout)
        self.parameters_of_law = nn.Linear(2 * hidden_features, 2 * latent_features)
        self.of_summary = nn.Linear(summary_features, 2 * latent_features, bias=False) if summary_features else None

    def forward(
        self,
        sequence: Float[Tensor, "B T F"],
        lengths: Int[Tensor, " B"],
        summary: Float[Tensor, "B S"] | None = None,
    ) -> Normal:
        """The posterior, batch shape (B, Z)."""
        pooled = self.recurrent(self.dropout(sequence), lengths)
        parameters = self.parameters_of_law(self.dropout(pooled))
        if self.of_summary is not None:
            assert summary is not None
            parameters = parameters + self.of_summary(summary)
        mean, log_variance = parameters.chunk(2, dim=-1)
        log_variance = log_variance.clamp(*LOG_VARIANCE_RANGE)
        return Normal(mean, (0.5 * log_variance).exp(), validate_args=False)


class NoEncoder(nn.Module):
    """The posterior of an empty z, for a model without a latent."""

    def forward(
        self,
        sequence: Float[Tensor, "B T F"],
        lengths: Int[Tensor, " B"],
        summary: Float[Tensor, "B S"] | None = None,
    ) -> Normal:
        """A law over nothing, batch shape (B, 0)."""
        empty = sequence.new_zeros(len(sequence), 0)
        return Normal(empty, empty, validate_args=False)
