"""Trajectory VAEs whose encoder reads states alone: what the state-only VAE of Wang et al. and SeCTAR share.

q(z | s_1:T) by a bidirectional LSTM, which reads ordered categories as numbers and the areas of their paths too, as our
own encoder does (`tvae.model.ranks`), pi(a_t | s_t, z) by an MLP, a law of the states that a subclass gives, and

    L = - E_q[ sum_t log pi(a_t | s_t, z) + log p(s_t+1 | ..., z) ] + KL(q(z | s_1:T) || N(0, I)).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
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
from tvae.model.ranks import Ranks

STATE_FLOOR = 0.1
"""Smallest standard deviation of a state, in typical changes, as in our own state decoder."""


class StateOnlyVAE(nn.Module, ABC):
    """q(z | s_1:T), pi(a_t | s_t, z), and a law of the states."""

    next_state: Head

    def __init__(self, senses: Senses, *, latent_features: int, hidden_features: int, num_components: int) -> None:
        super().__init__()
        self.ranks = Ranks(senses.observations.space)
        self.encoder = Encoder(
            senses.num_features + self.ranks.num_features,
            latent_features,
            hidden_features,
            summary_features=self.ranks.num_areas,
        )
        trunk = MovingTrunk(senses.num_features, latent_features, hidden_features)
        self.policy = PolicyNetwork(senses, trunk, num_components=num_components)
        self.prior = StandardNormal(latent_features)

    @abstractmethod
    def states(self, batch: TrajectoryBatch, z: Float[Tensor, "B Z"]) -> RowDistribution:
        """The law of s_2:T+1 at `z`, batch shape (B, T)."""

    def calibrate(self, demonstrations: Demonstrations) -> None:
        """Measure the typical change of each signal in one step, and ranks."""
        of_values, _ = typical_changes(self.policy.senses.observations, demonstrations)
        self.next_state.unit.copy_(of_values)
        self.ranks.fit(demonstrations)

    def posterior(self, batch: TrajectoryBatch) -> Normal:
        """q(z | s_1:T), batch shape (B, Z)."""
        read = [self.policy.senses(batch.observations)]
        areas = None
        if self.ranks.num_features:
            read.append(self.ranks(batch.observations))
            areas = self.ranks.areas(read[-1], batch.mask)
        return self.encoder(torch.cat(read, dim=-1), batch.lengths, areas)

    def loss(self, batch: TrajectoryBatch, kl_weight: float) -> Float[Tensor, ""]:
        """L, in nats per step, with this weight of the KL term."""
        senses, posterior = self.policy.senses, self.posterior(batch)
        z = posterior.rsample()
        actions, _ = self.policy(batch.observations, z)
        states = self.states(batch, z)
        done = (actions.log_prob(senses.actions.values(batch.actions)) * batch.mask).sum()
        came = (states.log_prob(senses.observations.values(batch.next_observations)) * batch.next_known).sum()
        return (kl_weight * self.prior.kl(posterior, z).sum() - done - came) / batch.mask.sum()


@dataclass(frozen=True)
class StateOnly(ABC):
    """A method that learns a `StateOnlyVAE`, whose bots get the posterior means of training trajectories."""

    latent_features: int = 8
    hidden_features: int = 64
    num_components: int = 3
    num_steps: int = 3_000
    learning_rate: float = 5e-3
    warm_up: float = 0.5
    """Share of the steps over which the weight of the KL term rises from 0 to 1."""

    @abstractmethod
    def network(self, senses: Senses) -> StateOnlyVAE:
        """What is learnt, with its first weights."""

    def fit(self, lesson: Lesson) -> StateOnlyVAE:
        """The trained model."""
        with seeded(lesson.seed, CPU):
            model = self.network(Senses.fit(lesson.demonstrations))
        model.calibrate(lesson.demonstrations)
        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        learn_trajectories(model, model.loss, lesson, descent, warm_up=self.warm_up)
        return model

    def learn(self, lesson: Lesson) -> Bots:
        """Bots with the posterior means of training trajectories."""
        model = self.fit(lesson)
        codes = posterior_means(model.posterior, lesson.demonstrations)
        facts = {"gradient_steps": lesson.limited(self.num_steps), "num_parameters": num_parameters(model)}
        return coded_bots(model.policy, codes, lesson, facts)
