"""DAgger: the learner acts, the demonstrator says what it would have done, and the learner clones all of it.

Source: Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning" (AISTATS 2011, arXiv 1011.0686), with beta_1 = 1 (the demonstrations) and beta_i = 0 after. In round i the
learner acts in `num_episodes` episodes of each label, the demonstrator of the label is asked in every state, and the
policy is trained on all that has been gathered. It sees labels, the environment and the demonstrators: more than any
other method. pi(a_t | s_1:t, label) is the network of `tvae.baselines.labelled`. Once a learner is off, asking about
what it does needs a demonstrator that knows the world as it is: the attacker that is asked reads off two observations
whether the zombie is dead (`TwoStepAttacker`), instead of remembering its own attack.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tvae.baselines.contract import AnyOf, Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import NetworkPolicy, PolicyNetwork, clone
from tvae.baselines.senses import Senses
from tvae.data.batches import TrajectoryBatch
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.device import seeded
from tvae.model.trunks import ReactiveTrunk
from tvae.rollouts import Policy, rollout
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True)
class DAgger:
    """pi(a_t | s_1:t, label), corrected by the demonstrators in states of its own."""

    num_rounds: int = 3
    num_episodes: int = 100
    """Of each label in each round."""
    hidden_features: int = 64
    num_components: int = 2
    num_steps: int = 2_400
    """Of all rounds and the first training together."""
    learning_rate: float = 5e-3

    def learn(self, lesson: Lesson) -> Bots:
        """A bot for each label; at will, labels as often as in the demonstrations."""
        labels, senses = lesson.labels, Senses.fit(lesson.demonstrations)
        with seeded(lesson.seed, CPU):
            trunk = ReactiveTrunk(senses.num_features, len(labels), self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
        asked = {label: np.eye(len(labels))[[index]] for index, label in enumerate(labels)}
        gathered = list(_plain(lesson.demonstrations))
        allowed = lesson.limited(self.num_steps)
        turns = min(self.num_rounds + 1, allowed)
        steps = allowed // turns
        seeds = np.random.default_rng((lesson.seed, 1)).integers(2**31, size=(turns, len(labels) + 1))
        for turn in range(turns):
            if turn:
                for label, seed in zip(labels, seeds[turn, 1:].tolist(), strict=True):
                    learner = NetworkPolicy(network, AnyOf(asked[label]))
                    gathered += corrected(lesson, label, learner, self.num_episodes, seed)
            everything = Demonstrations.from_trajectories(
                gathered, lesson.demonstrations.observation_space, lesson.demonstrations.action_space
            )
            _clone(network, everything, asked, Descent(steps, self.learning_rate), int(seeds[turn, 0]))
        return Bots(
            NetworkPolicy(network, AnyOf(np.eye(len(labels))[lesson.label_index])),
            {label: NetworkPolicy(network, AnyOf(code)) for label, code in asked.items()},
            {"gradient_steps": steps * turns, "num_parameters": num_parameters(network)},
        )


def _clone(
    network: PolicyNetwork, everything: Demonstrations, asked: dict[str, FloatArray], descent: Descent, seed: int
) -> None:
    told = torch.from_numpy(np.concatenate([asked[label] for label in everything.attribute("label").tolist()])).float()

    def code_of(episodes: IntArray, batch: TrajectoryBatch) -> Tensor:
        return told[episodes]

    clone(network, everything, code_of, descent, seed=seed)


def _plain(demonstrations: Demonstrations) -> Iterator[Trajectory]:
    """Observations, actions and labels alone."""
    for episode in demonstrations:
        yield Trajectory(episode.observations, episode.actions, attributes={"label": episode.attributes["label"]})


def corrected(lesson: Lesson, label: str, learner: Policy, num_episodes: int, seed: int) -> list[Trajectory]:
    """Episodes of the learner, with what the label's demonstrator would have done as actions; counts steps."""
    envs, demonstrator = lesson.world.lessons(label, num_episodes, seed)
    both = _Both(learner, demonstrator)
    episodes = rollout(lesson.steps.of(envs), both, num_episodes, seed=seed)
    said = np.stack(both.said, axis=1)
    return [
        Trajectory(episode.observations, said[index, : len(episode)], attributes={"label": label})
        for index, episode in enumerate(episodes)
    ]


class _Both:
    """Acts as the learner does, and keeps what the demonstrator says."""

    def __init__(self, learner: Policy, demonstrator: Policy) -> None:
        self.learner = learner
        self.demonstrator = demonstrator

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self.learner.reset(num_episodes, seed)
        self.demonstrator.reset(num_episodes, seed + 1)
        self.said: list[FloatArray] = []

    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) the learner's actions."""
        self.said.append(self.demonstrator.act(observations))
        return self.learner.act(observations)
