"""A trajectory VAE whose encoder reads states alone, with a policy and a dynamics model that remember one state.

Source: Wang et al., "Robust imitation of diverse behaviors" (NeurIPS 2017, arXiv 1707.02747), its first stage,
without the adversarial one: q(z | s_1:T) by a bidirectional LSTM, pi(a_t | s_t, z) by an MLP, p(s_t+1 | s_t, z), and

    L = - E_q[ sum_t log pi(a_t | s_t, z) + log p(s_t+1 | s_t, z) ] + KL(q(z | s_1:T) || N(0, I)).

At will, z is the posterior's mean of a training trajectory drawn for each episode; a style is asked for by the
trajectories that carry its label. The source's states hold speeds; so s_t is [s_t; d_t] here, d_t the last change.
Deviations: a mixture as the next state's law instead of a WaveNet over its columns; the weight of the KL term rises in
the first half of the training.
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from tvae.baselines.policies import MovingTrunk
from tvae.baselines.senses import Senses
from tvae.baselines.state_only import STATE_FLOOR, StateOnly, StateOnlyVAE
from tvae.data.batches import TrajectoryBatch
from tvae.distributions import RowDistribution
from tvae.heads import Head


class StateVAE(StateOnlyVAE):
    """q(z | s_1:T), pi(a_t | s_t, z) and p(s_t+1 | s_t, z)."""

    def __init__(self, senses: Senses, *, latent_features: int, hidden_features: int, num_components: int) -> None:
        super().__init__(
            senses,
            latent_features=latent_features,
            hidden_features=hidden_features,
            num_components=num_components,
        )
        self.dynamics = MovingTrunk(senses.num_features, latent_features, hidden_features)
        self.next_state = Head(
            senses.observations.space, hidden_features, floor=STATE_FLOOR, num_components=num_components
        )
        self.dynamics.unit.copy_(senses.unit)

    def states(self, batch: TrajectoryBatch, z: Float[Tensor, "B Z"]) -> RowDistribution:
        """p(s_t+1 | s_t, z), batch shape (B, T)."""
        senses = self.policy.senses
        features, _ = self.dynamics(senses(batch.observations), z)
        return self.next_state(features, senses.observations.values(batch.observations))


@dataclass(frozen=True)
class StateTrajectoryVAE(StateOnly):
    """The state-only trajectory VAE of Wang et al."""

    def network(self, senses: Senses) -> StateVAE:
        """Its first weights."""
        return StateVAE(
            senses,
            latent_features=self.latent_features,
            hidden_features=self.hidden_features,
            num_components=self.num_components,
        )
