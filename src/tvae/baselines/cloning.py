"""Behavioural cloning: the log-likelihood of actions given what was seen, maximised; no latent, no style.

Source: Pomerleau, "ALVINN: An autonomous land vehicle in a neural network" (NeurIPS 1988); mixtures as heads after
Bishop, "Mixture density networks" (1994). Two policies: an MLP that sees the present observation, and an LSTM that
sees all of the past, each with a mixture of K laws of the whole action.
"""

from __future__ import annotations

from dataclasses import dataclass

from tvae.baselines.contract import Bots, Lesson, NoCode
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import MemorylessTrunk, NetworkPolicy, PolicyNetwork, clone, no_code
from tvae.baselines.senses import Senses
from tvae.device import seeded
from tvae.model.trunks import ReactiveTrunk, Trunk


@dataclass(frozen=True)
class CloningMLP:
    """pi(a_t | s_t)."""

    hidden_features: int = 128
    num_components: int = 3
    num_steps: int = 3_000
    learning_rate: float = 3e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        senses = Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            trunk = MemorylessTrunk(senses.num_features, 0, self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
        return _cloned(network, lesson, Descent(lesson.limited(self.num_steps), self.learning_rate))


@dataclass(frozen=True)
class CloningLSTM:
    """pi(a_t | s_1:t), with the trunk of our own policy decoder, which reads no z here."""

    hidden_features: int = 64
    num_components: int = 3
    num_steps: int = 2_000
    learning_rate: float = 5e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        senses = Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            trunk: Trunk = ReactiveTrunk(senses.num_features, 0, self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
        return _cloned(network, lesson, Descent(lesson.limited(self.num_steps), self.learning_rate))


def _cloned(network: PolicyNetwork, lesson: Lesson, descent: Descent) -> Bots:
    clone(network, lesson.demonstrations, no_code, descent, seed=lesson.seed)
    facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network)}
    return Bots(NetworkPolicy(network, NoCode()), facts=facts)
