"""A code learnt for each trajectory by its index, and a policy that reads it.

Source: Petitbois, Portelas, Lamprier, Denoyer, "Offline learning of controllable diverse behaviors" (2025, arXiv
2504.18160), its ZBC: pi(a_t | s_1:t, z_i), where z_i is a row of a table, learnt with the policy by behavioural
cloning. There is no encoder: a new recording has no code. At will, the code of a training trajectory is drawn for
each episode; a style is asked for by the codes of the trajectories that carry its label. The weighted variant is left
out. Ours: the policy has the trunk of our own policy decoder, so that only the way to z differs.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import PolicyNetwork, clone, coded_bots
from tvae.baselines.senses import Senses
from tvae.data.batches import TrajectoryBatch
from tvae.device import seeded
from tvae.model.trunks import ReactiveTrunk
from tvae.spaces import IntArray


@dataclass(frozen=True)
class IndexedCloning:
    """pi(a_t | s_1:t, z_i), z_i a learnt row for trajectory i."""

    latent_features: int = 2
    hidden_features: int = 64
    num_components: int = 2
    num_steps: int = 4_000
    learning_rate: float = 5e-3
    table_speed: float = 0.3
    """Rate of the table in that of the policy: a fast one learns each trajectory by heart, and no style."""

    def learn(self, lesson: Lesson) -> Bots:
        """Bots with the codes of training trajectories."""
        senses = Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            trunk = ReactiveTrunk(senses.num_features, self.latent_features, self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
            table = nn.Embedding(len(lesson.demonstrations), self.latent_features)
            nn.init.normal_(table.weight, std=0.1 / self.table_speed)  # near each other: what differs is learnt
        network.add_module("table", table)

        def code_of(episodes: IntArray, batch: TrajectoryBatch) -> Tensor:
            return self.table_speed * table(torch.from_numpy(episodes))

        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        clone(network, lesson.demonstrations, code_of, descent, seed=lesson.seed, held_out=0.0)
        codes = (self.table_speed * table.weight.detach()).double().numpy()
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network)}
        return coded_bots(network, codes, lesson, facts)
