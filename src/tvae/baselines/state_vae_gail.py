"""The state-only trajectory VAE, trained on against a discriminator that is told z: both stages of Wang et al.

Source: Wang et al., "Robust imitation of diverse behaviors" (NeurIPS 2017, arXiv 1707.02747). The first stage is
`tvae.baselines.state_vae`, which gives each demonstration a code z, the mean of q(z | s_1:T), and a policy pi_1. Then,
with the code of a random demonstration in each episode, and of its own in each demonstrated moment,

    min_f  E_own[softplus(f(x, a, z))] + E_demonstrated[softplus(-f(x, a, z))] + penalty,   reward: f(x, a, z)

and PPO improves pi(b | x, z) = N(b | b_1(x, z) + mu(x, z), sigma^2), where b_1 is the most likely action of pi_1, which
stays as it is, and mu starts near 0, as in the source. Of an action that chooses (binary, categorical), b_1 is where
noise chooses as often as pi_1 does. At will, z is that of a training trajectory drawn for each episode; a style is
asked for by the trajectories that carry its label. Deviations: PPO instead of TRPO; f itself as the reward and the
gradient penalty (`tvae.baselines.judging`); sigma is the same in all states; the posterior's mean instead of a draw.

The second stage practises for a fraction of the rounds that `gail` does: it starts from a policy that can already act.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.baselines.contract import AnyOf, Bots, Lesson, by_label
from tvae.baselines.descending import CPU, num_parameters
from tvae.baselines.judging import Discriminator, Judging
from tvae.baselines.moments import Moments, Sight
from tvae.baselines.policies import PolicyNetwork
from tvae.baselines.posteriors import posterior_means
from tvae.baselines.practice import Practice, PracticedPolicy
from tvae.baselines.state_vae import StateTrajectoryVAE
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.model.trunks import Memory
from tvae.spaces import FloatArray


class ToldDiscriminator:
    """f(x, a, z), a `LearntReward`."""

    def __init__(self, sight: Sight, codes: FloatArray, judging: Judging) -> None:
        self.discriminator = Discriminator(sight.told(codes), judging)

    def of(self, moments: Moments) -> Float[Tensor, " N"]:
        """f of each moment."""
        return self.discriminator.of(moments.told)

    def improve(self, own: Moments, num_steps: int) -> None:
        """Descend on the loss of f."""
        self.discriminator.improve(own.told, num_steps)


class FromPolicy:
    """b_1(x, z), a `Start`: points of a policy that remembers the last state alone."""

    def __init__(self, policy: PolicyNetwork, sight: Sight) -> None:
        self.policy, self.sight = policy, sight

    @torch.inference_mode()
    def points(self, states: Float[Tensor, "N X"], codes: Float[Tensor, "N Z"]) -> FloatArray:
        """(N, B)"""
        now, changes = states[:, None].chunk(2, dim=-1)
        nothing = states.new_zeros(1, len(states), 0)
        features, _ = self.policy.trunk(now, codes, Memory(nothing, nothing, now - self.sight.senses.unit * changes))
        space = self.policy.senses.actions.space
        law = self.policy.head(features[:, 0], features.new_zeros(len(features), space.num_columns))
        values = law.mode()
        chances = {column: _chances(law, values, column, 2) for column in space.binary.tolist()}
        for column, count in zip(space.categorical.tolist(), space.num_categories, strict=True):
            chances[column] = _chances(law, values, column, count)
        return self.sight.box.leaning(self.policy.senses.actions.raw(values).double().numpy(), chances)


def _chances(law: RowDistribution, values: Float[Tensor, "N A"], column: int, count: int) -> FloatArray:
    """(N, K) the probability of each value of a column that chooses."""
    found = []
    for value in range(count):
        rows = values.clone()
        rows[:, column] = value
        found.append(law.log_prob_by_column(rows)[:, column].exp().double().numpy())
    return np.stack(found, axis=1)


@dataclass(frozen=True)
class StateVAEWithGAIL:
    """Both stages of Wang et al."""

    first: StateTrajectoryVAE = field(default_factory=StateTrajectoryVAE)
    practice: Practice = field(default_factory=lambda: Practice(num_rounds=60, log_std=-2.0))
    judging: Judging = field(default_factory=Judging)

    def learn(self, lesson: Lesson) -> Bots:
        """Bots with the posterior means of training trajectories."""
        half = replace(lesson, most_steps=None if lesson.most_steps is None else lesson.most_steps // 2)
        model = self.first.fit(half)
        codes = posterior_means(model.posterior, lesson.demonstrations)
        sight, practice, anyone = Sight(lesson.demonstrations), self.practice.within(half), AnyOf(codes)
        start = FromPolicy(model.policy, sight)
        with seeded(lesson.seed, CPU):
            reward = ToldDiscriminator(sight, codes, self.judging)
        policy = practice.learn(lesson, sight, anyone, reward, start)
        networks = (model, policy, reward.discriminator.logit)
        facts = {
            "gradient_steps": half.limited(self.first.num_steps) + practice.gradient_steps,
            "num_parameters": sum(num_parameters(network) for network in networks),
        }
        return Bots(
            PracticedPolicy(policy, sight, anyone, start),
            {label: PracticedPolicy(policy, sight, code, start) for label, code in by_label(codes, lesson).items()},
            facts,
        )
