"""A trajectory VAE whose states are foretold from z alone, and a policy that is told z: SeCTAR, one level of it.

Source: Co-Reyes et al., "Self-consistent trajectory autoencoder: Hierarchical reinforcement learning with trajectory
embeddings" (ICML 2018, arXiv 1806.02813), without the hierarchy: q(z | s_1:T) by a recurrent encoder, a recurrent state
decoder p(s_2:T+1 | s_1, z) that is never shown a recorded state behind the first, and pi(a_t | s_t, z) by an MLP, which
clones the actions. One objective:

    L = - E_q[ sum_t log p(s_t+1 | s_1, z) + log pi(a_t | s_t, z) ] + KL(q(z | s_1:T) || N(0, I)).

The decoder adds up changes: s_t+1 has the mode m_t+1 = m_t + change_t, m_1 = s_1, where change_t and the spread come of
an LSTM that reads s_1 and z again and again, so that its memory alone tells it how far it is.

At will, z is the posterior's mean of a training trajectory drawn for each episode; a style is asked for by the
trajectories that carry its label. Deviations: there are actions to clone, so that the policy needs no practice to do
what the state decoder foretells, and there is neither exploration nor planning over z. What is fed back is the LSTM's
memory rather than the foretold state. The source's states hold speeds; so s_t of the policy is [s_t; d_t] here, d_t the
last change. The law of an action is a mixture, as with other baselines, and the weight of the KL term rises in the
first half of the training.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.baselines.senses import Senses
from tvae.baselines.state_only import STATE_FLOOR, StateOnly, StateOnlyVAE
from tvae.data.batches import TrajectoryBatch
from tvae.distributions import RowDistribution
from tvae.heads import Head


class SelfConsistentVAE(StateOnlyVAE):
    """q(z | s_1:T), p(s_2:T+1 | s_1, z) and pi(a_t | s_t, z)."""

    def __init__(self, senses: Senses, *, latent_features: int, hidden_features: int, num_components: int) -> None:
        super().__init__(
            senses,
            latent_features=latent_features,
            hidden_features=hidden_features,
            num_components=num_components,
        )
        self.recurrent = nn.LSTM(senses.num_features + latent_features, hidden_features, batch_first=True)
        self.next_state = Head(senses.observations.space, hidden_features, floor=STATE_FLOOR)

    def foretold(self, first: Float[Tensor, "B O"], z: Float[Tensor, "B Z"], num_steps: int) -> RowDistribution:
        """p(s_2:T+1 | s_1, z) of raw first observations, batch shape (B, T)."""
        senses = self.policy.senses
        known = torch.cat([senses(first), z], dim=-1)
        features, _ = self.recurrent(known[:, None].expand(-1, num_steps, -1))
        start = senses.observations.values(first)[:, None]
        changes = self.next_state(features, torch.zeros_like(start).expand(-1, num_steps, -1)).mode()
        return self.next_state(features, start + changes.cumsum(1) - changes)

    def states(self, batch: TrajectoryBatch, z: Float[Tensor, "B Z"]) -> RowDistribution:
        """p(s_2:T+1 | s_1, z), batch shape (B, T)."""
        return self.foretold(batch.observations[:, 0], z, batch.actions.shape[1])


@dataclass(frozen=True)
class SelfConsistentTrajectories(StateOnly):
    """SeCTAR without the hierarchy."""

    def network(self, senses: Senses) -> SelfConsistentVAE:
        """Its first weights."""
        return SelfConsistentVAE(
            senses,
            latent_features=self.latent_features,
            hidden_features=self.hidden_features,
            num_components=self.num_components,
        )
