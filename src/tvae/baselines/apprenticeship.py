"""Apprenticeship learning: a reward linear in features, and a policy whose features come to be the demonstrators'.

Sources: Abbeel and Ng, "Apprenticeship learning via inverse reinforcement learning" (ICML 2004); Ziebart et al.,
"Maximum entropy inverse reinforcement learning" (AAAI 2008), whose gradient this is; Ho, Gupta, Ermon, "Model-free
imitation learning with policy optimization" (ICML 2016, arXiv 1605.08478). In each round

    w <- (1 - decay) w + E_demonstrated[phi(x, a)] - E_own[phi(x, a)],    reward: w phi(x, a)

and PPO improves the policy by it. phi are random Fourier features (Rahimi and Recht 2007) of a Gaussian kernel, as wide
as demonstrated moments are apart in the median, so that features agree where the laws of moments do, and hardly
elsewhere. Deviations: the last policy is kept instead of a mixture of all; demonstrations count alike, however long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from tvae.baselines.contract import Bots, Lesson, NoCode
from tvae.baselines.descending import CPU, num_parameters
from tvae.baselines.moments import Moments, Sight
from tvae.baselines.practice import Practice, PracticedPolicy
from tvae.device import seeded

_COMPARED = 1000
"""Moments whose distances are measured."""


class FeatureMatching:
    """w phi(x, a), a `LearntReward`."""

    def __init__(self, sight: Sight, num_features: int, decay: float) -> None:
        self.decay = decay
        some, others = sight.drawn(_COMPARED).pairs, sight.drawn(_COMPARED).pairs
        width = (some - others).norm(dim=-1).median()
        self._frequencies = torch.randn(some.shape[1], num_features) / width
        self._phases = 2 * math.pi * torch.rand(num_features)
        self._demonstrated = sight.weights @ self._features(sight.demonstrated) / sight.weights.sum()
        self.weights = torch.zeros(num_features)

    def _features(self, moments: Moments) -> Float[Tensor, "N F"]:
        scale = math.sqrt(2 / len(self._phases))
        return scale * (moments.pairs @ self._frequencies + self._phases).cos()

    def of(self, moments: Moments) -> Float[Tensor, " N"]:
        """The reward of each moment."""
        return self._features(moments) @ self.weights

    def improve(self, own: Moments, num_steps: int) -> None:
        """So many steps up the gradient, all from the same moments."""
        towards = self._demonstrated - self._features(own).mean(0)
        for _ in range(num_steps):
            self.weights = (1 - self.decay) * self.weights + towards


@dataclass(frozen=True)
class ApprenticeshipLearning:
    """Feature matching by PPO."""

    num_features: int = 512
    decay: float = 0.1
    practice: Practice = field(default_factory=lambda: Practice(reward_steps=1))

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        sight, practice = Sight(lesson.demonstrations), self.practice.within(lesson)
        with seeded(lesson.seed, CPU):
            reward = FeatureMatching(sight, self.num_features, self.decay)
        policy = practice.learn(lesson, sight, NoCode(), reward)
        facts = {
            "gradient_steps": practice.gradient_steps,
            "num_parameters": num_parameters(policy) + self.num_features,
        }
        return Bots(PracticedPolicy(policy, sight, NoCode()), facts=facts)
