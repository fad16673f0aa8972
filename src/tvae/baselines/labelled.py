"""Behavioural cloning that is told the true label: cloning as it could be if the styles were found without fault.

Source: goal- and label-conditioned imitation, as in Codevilla et al., "End-to-end driving via conditional imitation
learning" (ICRA 2018, arXiv 1710.02410). pi(a_t | s_1:t, c), c the label as one of K. Not a rival: labels teach no
other method but DAgger. Not a bound either: ours has events, windows, and a training of another length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import PolicyNetwork, clone, coded_bots
from tvae.baselines.senses import Senses
from tvae.data.batches import TrajectoryBatch
from tvae.device import seeded
from tvae.model.trunks import ReactiveTrunk
from tvae.spaces import IntArray


@dataclass(frozen=True)
class LabelledCloning:
    """pi(a_t | s_1:t, label)."""

    hidden_features: int = 64
    num_components: int = 2
    num_steps: int = 2_000
    learning_rate: float = 5e-3

    def learn(self, lesson: Lesson) -> Bots:
        """A bot for each label; at will, labels as often as in the demonstrations."""
        senses, codes = Senses.fit(lesson.demonstrations), np.eye(len(lesson.labels))[lesson.label_index]
        with seeded(lesson.seed, CPU):
            trunk = ReactiveTrunk(senses.num_features, len(lesson.labels), self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
        told = torch.from_numpy(codes).float()

        def code_of(episodes: IntArray, batch: TrajectoryBatch) -> Tensor:
            return told[episodes]

        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        clone(network, lesson.demonstrations, code_of, descent, seed=lesson.seed)
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network)}
        return coded_bots(network, codes, lesson, facts)
