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
from torch.distributions import Normal

from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import MovingTrunk, PolicyNetwork, coded_bots
from tvae.baselines.posteriors import learn_trajectories, posterior_means
from tvae.baselines.senses import Senses
from tvae.data.batches import TrajectoryBatch
from tvae.data.demonstrations import Demonstrations
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.model.calibration import typical_changes
from tvae.model.encoder import Encoder
from tvae.model.latent import StandardNormal

_STATE_FLOOR = 0.1
"""Smallest standard deviation of a foretold state, in typical changes, as in our own state decoder."""


class SelfConsistentVAE(nn.Module):
    """q(z | s_1:T), p(s_2:T+1 | s_1, z) and pi(a_t | s_t, z)."""

    def __init__(self, senses: Senses, *, latent_features: int, hidden_features: int, num_components: int) -> None:
        super().__init__()
        self.encoder = Encoder(senses.num_features, latent_features, hidden_features)
        trunk = MovingTrunk(senses.num_features, latent_features, hidden_features)
        self.policy = PolicyNetwork(senses, trunk, num_components=num_components)
        self.recurrent = nn.LSTM(senses.num_features + latent_features, hidden_features, batch_first=True)
        self.state = Head(senses.observations.space, hidden_features, floor=_STATE_FLOOR)
        self.prior = StandardNormal(latent_features)

    def calibrate(self, demonstrations: Demonstrations) -> None:
        """Measure the typical change of each signal in one step."""
        of_values, _ = typical_changes(self.policy.senses.observations, demonstrations)
        self.state.unit.copy_(of_values)

    def posterior(self, batch: TrajectoryBatch) -> Normal:
        """q(z | s_1:T), batch shape (B, Z)."""
        return self.encoder(self.policy.senses(batch.observations), batch.lengths)

    def foretold(self, first: Float[Tensor, "B O"], z: Float[Tensor, "B Z"], num_steps: int) -> RowDistribution:
        """p(s_2:T+1 | s_1, z) of raw first observations, batch shape (B, T)."""
        senses = self.policy.senses
        known = torch.cat([senses(first), z], dim=-1)
        features, _ = self.recurrent(known[:, None].expand(-1, num_steps, -1))
        start = senses.observations.values(first)[:, None]
        changes = self.state(features, torch.zeros_like(start).expand(-1, num_steps, -1)).mode()
        return self.state(features, start + changes.cumsum(1) - changes)

    def loss(self, batch: TrajectoryBatch, kl_weight: float) -> Float[Tensor, ""]:
        """L, in nats per step, with this weight of the KL term."""
        senses, posterior = self.policy.senses, self.posterior(batch)
        z = posterior.rsample()
        actions, _ = self.policy(batch.observations, z)
        states = self.foretold(batch.observations[:, 0], z, batch.actions.shape[1])
        done = (actions.log_prob(senses.actions.values(batch.actions)) * batch.mask).sum()
        came = (states.log_prob(senses.observations.values(batch.next_observations)) * batch.next_known).sum()
        return (kl_weight * self.prior.kl(posterior, z).sum() - done - came) / batch.mask.sum()


@dataclass(frozen=True)
class SelfConsistentTrajectories:
    """SeCTAR without the hierarchy."""

    latent_features: int = 8
    hidden_features: int = 64
    num_components: int = 3
    num_steps: int = 3_000
    learning_rate: float = 5e-3
    warm_up: float = 0.5
    """Share of the steps over which the weight of the KL term rises from 0 to 1."""

    def learn(self, lesson: Lesson) -> Bots:
        """Bots with the posterior means of training trajectories."""
        with seeded(lesson.seed, CPU):
            model = SelfConsistentVAE(
                Senses.fit(lesson.demonstrations),
                latent_features=self.latent_features,
                hidden_features=self.hidden_features,
                num_components=self.num_components,
            )
        model.calibrate(lesson.demonstrations)
        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        learn_trajectories(model, model.loss, lesson, descent, warm_up=self.warm_up)
        codes = posterior_means(model.posterior, lesson.demonstrations)
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(model)}
        return coded_bots(model.policy, codes, lesson, facts)
