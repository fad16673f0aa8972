"""GAIL and InfoGAIL: act so that a discriminator cannot tell one's own moments from the demonstrated ones.

Sources: Ho and Ermon, "Generative adversarial imitation learning" (NeurIPS 2016, arXiv 1606.03476); Li, Song, Ermon,
"InfoGAIL: Interpretable imitation learning from visual demonstrations" (NeurIPS 2017, arXiv 1703.08840). With f the
logit of D, the probability that a moment was demonstrated, and c the code of an episode, one of K, equally likely,

    D:       min_f  E_own[softplus(f(x, a))] + E_demonstrated[softplus(-f(x, a))] + penalty E[abs(grad f)^2]
    Q:       min_Q  - E_own[log Q(c | x, a)]
    reward:  f(x, a) + information log(K Q(c | x, a))

GAIL has no code. At will, InfoGAIL draws one for each episode; it is asked for a style by the codes of the
demonstrations that carry its label, for each the one that is most likely by Q over all of its steps. Deviations: PPO
instead of TRPO; f itself as the reward, which favours neither long nor short episodes (Fu et al. 2018); the gradient
penalty, between own and demonstrated moments (after Gulrajani et al. 2017, but towards 0); all demonstrations count
alike, however long; log K Q is at least -3; and InfoGAIL's policy starts at the middle of the demonstrated
actions, where the source's is cloned first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.baselines.contract import AnyOf, Bots, Lesson, NoCode, by_label
from tvae.baselines.descending import CPU, num_parameters
from tvae.baselines.judging import Discriminator, Judging, network
from tvae.baselines.moments import Moments, Sight
from tvae.baselines.practice import Practice, PracticedPolicy
from tvae.device import seeded
from tvae.spaces import FloatArray

_LEAST = -3.0
"""Smallest log K Q that is rewarded."""


class Informed:
    """f + information log K Q, a `LearntReward`."""

    def __init__(self, discriminator: Discriminator, num_codes: int, information: float) -> None:
        self.discriminator, self.information = discriminator, information
        self.num_codes = num_codes
        judging = discriminator.judging
        self.posterior = network(discriminator.sight, judging.hidden_features, num_codes)
        self._optimizer = torch.optim.Adam(self.posterior.parameters(), lr=judging.learning_rate)

    def log_posterior(self, moments: Moments) -> Float[Tensor, "N K"]:
        """log Q(. | x, a) of each moment."""
        return self.posterior(moments.pairs).log_softmax(-1)

    @torch.no_grad()
    def of(self, moments: Moments) -> Float[Tensor, " N"]:
        """The reward of each moment."""
        told = (self.log_posterior(moments) * moments.codes).sum(-1) + math.log(self.num_codes)
        return self.discriminator.of(moments) + self.information * told.clamp_min(_LEAST)

    def improve(self, own: Moments, num_steps: int) -> None:
        """Descend on the losses of D and Q, half of the steps each."""
        self.discriminator.improve(own, num_steps - num_steps // 2)
        for _ in range(num_steps // 2):
            mine = own.drawn(self.discriminator.judging.batch_size)
            loss = -(self.log_posterior(mine) * mine.codes).sum(-1).mean()
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()

    @torch.no_grad()
    def codes(self) -> FloatArray:
        """(E, K) the most likely code of each demonstration."""
        sight = self.discriminator.sight
        told = torch.zeros(int(sight.episodes[-1]) + 1, self.num_codes)
        told.index_add_(0, sight.episodes, self.log_posterior(sight.demonstrated))
        return np.eye(self.num_codes)[told.argmax(-1).numpy()]


@dataclass(frozen=True)
class GAIL:
    """Adversarial imitation without codes."""

    practice: Practice = field(default_factory=Practice)
    judging: Judging = field(default_factory=Judging)

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        sight, practice = Sight(lesson.demonstrations), self.practice.within(lesson)
        with seeded(lesson.seed, CPU):
            discriminator = Discriminator(sight, self.judging)
        policy = practice.learn(lesson, sight, NoCode(), discriminator)
        facts = {
            "gradient_steps": practice.gradient_steps,
            "num_parameters": num_parameters(policy) + num_parameters(discriminator.logit),
        }
        return Bots(PracticedPolicy(policy, sight, NoCode()), facts=facts)


@dataclass(frozen=True)
class InfoGAIL:
    """Adversarial imitation whose moments tell the code of the episode."""

    num_codes: int = 3
    """K; its source sets it to the number of styles."""
    information: float = 0.3
    practice: Practice = field(default_factory=lambda: Practice(reward_steps=64))
    judging: Judging = field(default_factory=Judging)

    def learn(self, lesson: Lesson) -> Bots:
        """Bots with the codes of demonstrations; at will, with any code."""
        sight, practice = Sight(lesson.demonstrations), self.practice.within(lesson)
        with seeded(lesson.seed, CPU):
            reward = Informed(Discriminator(sight, self.judging), self.num_codes, self.information)
        any_code = AnyOf(np.eye(self.num_codes))
        policy = practice.learn(lesson, sight, any_code, reward)
        codes = reward.codes()
        judges = (reward.discriminator.logit, reward.posterior)
        facts = {
            "gradient_steps": practice.gradient_steps,
            "num_parameters": sum(num_parameters(network) for network in (policy, *judges)),
            "codes_found": len(np.unique(codes.argmax(1))),
        }
        return Bots(
            PracticedPolicy(policy, sight, any_code),
            {label: PracticedPolicy(policy, sight, code) for label, code in by_label(codes, lesson).items()},
            facts,
        )
