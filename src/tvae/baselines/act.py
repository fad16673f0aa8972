"""Action chunks from a conditional VAE, in the manner of ACT: one latent for each chunk, none for the episode.

Source: Zhao et al., "Learning fine-grained bimanual manipulation with low-cost hardware" (RSS 2023, arXiv
2304.13705): q(z | x_t, a_t:t+k), pi(a_t:t+k | x_t, z), KL weight 10 on a loss that is a mean over the chunk, z = 0
when acting, so that no style can be asked for. Deviations: MLPs instead of transformers; x_t holds the last change of
state besides the state; the log-likelihood of heads instead of an L1 distance, which angles and rare events do not
have; actions are drawn from the heads; a new chunk is asked for in each step, as there, but the newest is taken as it
is, without averaging those that overlap.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.distributions import Normal

from tvae.baselines.chunks import Chunk, ChunkPolicy, Proposer, learn_chunks
from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import ACTION_FLOOR
from tvae.baselines.senses import Senses
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.model.latent import StandardNormal


class ChunkVAE(Proposer):
    """q(z | x_t, a_t:t+k) and pi(a_t:t+k | x_t, z)."""

    def __init__(self, senses: Senses, *, num_actions: int, latent_features: int, hidden_features: int) -> None:
        super().__init__()
        self.senses = senses
        self.num_actions = num_actions
        self.latent_features = latent_features
        seen, done = 2 * senses.num_features, num_actions * (senses.actions.num_features + 1)
        self.encoder = nn.Sequential(
            nn.Linear(seen + done, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, 2 * latent_features),
        )
        self.decoder = nn.Sequential(
            nn.Linear(seen + latent_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, num_actions * hidden_features),
            nn.SiLU(),
        )
        self.head = Head(senses.actions.space, hidden_features, floor=ACTION_FLOOR)
        self.prior = StandardNormal(latent_features)

    def posterior(self, chunk: Chunk) -> Normal:
        """q(z | x_t, a_t:t+k), batch shape (B, Z)."""
        there = chunk.valid[..., None].float()
        done = torch.cat([self.senses.actions.features(chunk.actions) * there, there], dim=-1).flatten(1)
        mean, log_variance = self.encoder(torch.cat([chunk.inputs, done], dim=-1)).chunk(2, dim=-1)
        return Normal(mean, (0.5 * log_variance.clamp(-14, 4)).exp(), validate_args=False)

    def law(self, inputs: Float[Tensor, "N X"], z: Float[Tensor, "N Z"]) -> RowDistribution:
        """pi(a_t:t+k | x_t, z), batch shape (N, K)."""
        features = self.decoder(torch.cat([inputs, z], dim=-1)).unflatten(-1, (self.num_actions, -1))
        return self.head(features, features.new_zeros(*features.shape[:-1], self.senses.actions.space.num_columns))

    def loss(self, chunk: Chunk, kl_weight: float) -> Float[Tensor, ""]:
        """Negative log-likelihood per action, plus the weighted divergence per chunk."""
        posterior = self.posterior(chunk)
        z = posterior.rsample()
        likelihood = (self.law(chunk.inputs, z).log_prob(chunk.actions) * chunk.valid).sum() / chunk.valid.sum()
        return -likelihood + kl_weight * self.prior.kl(posterior, z).mean()

    def propose(self, inputs: Float[Tensor, "N X"]) -> Float[Tensor, "N K A"]:
        """A draw from pi(. | x_t, z = 0)."""
        return self.law(inputs, inputs.new_zeros(len(inputs), self.latent_features)).sample()


@dataclass(frozen=True)
class ActionChunks:
    """ACT-like cloning of chunks."""

    num_actions: int = 4
    """k"""
    num_taken: int = 1
    """So many of them are taken before the next k are asked for."""
    latent_features: int = 8
    hidden_features: int = 128
    kl_weight: float = 10.0
    batch_size: int = 256
    num_steps: int = 4_000
    learning_rate: float = 2e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        senses = Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            network = ChunkVAE(
                senses,
                num_actions=self.num_actions,
                latent_features=self.latent_features,
                hidden_features=self.hidden_features,
            )
        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        learn_chunks(
            network,
            senses,
            lesson,
            descent,
            lambda model, chunk: model.loss(chunk, self.kl_weight),
            num_actions=self.num_actions,
            batch_size=self.batch_size,
        )
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network)}
        return Bots(ChunkPolicy(network, self.num_taken), facts=facts)
