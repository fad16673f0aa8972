"""Behavioural cloning from observation: the demonstrators' actions are not seen but inferred.

Source: Torabi, Warnell, Stone, "Behavioral cloning from observation" (IJCAI 2018, arXiv 1805.01954), BCO(alpha): the
agent acts (at first at random), learns from its own steps which action lies between states, reads the demonstrators'
actions off their states with that, clones them, and acts again. The inverse model sees the change before as well,
p(a_t | s_t, s_t - s_t-1, s_t+1 - s_t), since a turn is relative to where one came from. At random, angles are
uniform, numbers are as spread as the demonstrators' features, and binary actions occur with the rate `binary_rate`,
so that where nothing tells, none is inferred. Demonstrators' actions are used for nothing but their scale.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from tvae.baselines.contract import Bots, Lesson, NoCode
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import ACTION_FLOOR, NetworkPolicy, PolicyNetwork, clone, no_code
from tvae.baselines.senses import Senses
from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.data.trajectory import Trajectory
from tvae.device import seeded
from tvae.distributions import RowDistribution
from tvae.heads import Head
from tvae.model.trunks import ReactiveTrunk
from tvae.rollouts import Policy, rollout
from tvae.spaces import FloatArray, Space


class InverseModel(nn.Module):
    """p(a_t | s_t, s_t - s_t-1, s_t+1 - s_t)."""

    def __init__(self, senses: Senses, hidden_features: int) -> None:
        super().__init__()
        self.senses = senses
        self.layers = nn.Sequential(
            nn.Linear(3 * senses.num_features, hidden_features),
            nn.SiLU(),
            nn.Linear(hidden_features, hidden_features),
            nn.SiLU(),
        )
        self.head = Head(senses.actions.space, hidden_features, floor=ACTION_FLOOR)

    def inputs(self, demonstrations: Demonstrations) -> Float[Tensor, "N X"]:
        """What is seen around each action, all episodes one after another; the first change of an episode is 0."""
        lengths = demonstrations.lengths
        at = ranges(demonstrations.observation_starts, lengths)
        steps = np.arange(len(at)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        before, now, then = (
            self.senses(torch.from_numpy(demonstrations.observations[rows]).float())
            for rows in (at - (steps > 0), at, at + 1)
        )
        changes = self.senses.changes
        return torch.cat([now, changes(now, before), changes(then, now)], dim=-1)

    def forward(self, inputs: Float[Tensor, "N X"]) -> RowDistribution:
        """The law of each action's values."""
        features = self.layers(inputs)
        return self.head(features, features.new_zeros(len(features), self.senses.actions.space.num_columns))


class _Anything:
    """Acts at random, whatever it sees."""

    def __init__(self, senses: Senses, binary_rate: float) -> None:
        self.space: Space = senses.actions.space
        self.mean, self.std = (x.double().numpy() for x in (senses.actions.mean, senses.actions.std))
        self.binary_rate = binary_rate

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self._random = np.random.default_rng(seed)

    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A)"""
        space, count = self.space, len(observations)
        actions = self.mean + self.std * self._random.normal(size=(count, space.num_columns))
        actions[:, space.angular] = self._random.uniform(-np.pi, np.pi, (count, len(space.angular)))
        actions[:, space.binary] = self._random.random((count, len(space.binary))) < self.binary_rate
        for column, number in zip(space.categorical, space.num_categories, strict=True):
            actions[:, column] = self._random.integers(0, number, count)
        return actions


@dataclass(frozen=True)
class CloningFromObservation:
    """BCO(alpha), its policy the LSTM of behavioural cloning."""

    num_rounds: int = 3
    num_episodes: int = 300
    """In each round."""
    binary_rate: float = 0.1
    hidden_features: int = 64
    num_components: int = 3
    inverse_steps: int = 1_500
    """Of the inverse model, in all rounds together."""
    batch_size: int = 256
    num_steps: int = 2_000
    """Of the policy, in all rounds together."""
    learning_rate: float = 5e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        demonstrations = lesson.demonstrations
        if not demonstrations.final_observed.all():
            raise ValueError("actions are inferred from the observations around them; the last ones are missing")
        senses = Senses.fit(demonstrations)
        with seeded(lesson.seed, CPU):
            inverse = InverseModel(senses, 2 * self.hidden_features)
            trunk = ReactiveTrunk(senses.num_features, 0, self.hidden_features)
            network = PolicyNetwork(senses, trunk, num_components=self.num_components)
        actor: Policy = _Anything(senses, self.binary_rate)
        gathered: list[Trajectory] = []
        planned = self.inverse_steps + self.num_steps
        allowed = lesson.limited(planned)
        rounds = max(1, min(self.num_rounds, allowed // 2))
        inverting = max(1, allowed * self.inverse_steps // (planned * rounds))
        cloning = max(1, allowed // rounds - inverting)
        for seed in np.random.default_rng((lesson.seed, 1)).integers(2**31, size=rounds).tolist():
            envs = lesson.steps.of(lesson.world.envs(self.num_episodes))
            gathered += _plain(rollout(envs, actor, self.num_episodes, seed=seed))
            own = Demonstrations.from_trajectories(
                gathered, demonstrations.observation_space, demonstrations.action_space
            )
            self._invert(inverse, own, inverting, seed)
            inferred = _inferred(inverse, demonstrations)
            clone(network, inferred, no_code, Descent(cloning, self.learning_rate), seed=seed)
            actor = NetworkPolicy(network, NoCode())
        facts = {
            "gradient_steps": rounds * (inverting + cloning),
            "num_parameters": num_parameters(network) + num_parameters(inverse),
        }
        return Bots(actor, facts=facts)

    def _invert(self, inverse: InverseModel, own: Demonstrations, num_steps: int, seed: int) -> None:
        with torch.no_grad():
            inputs = inverse.inputs(own)
        rows = own.actions[ranges(own.action_starts, own.lengths)]
        wanted = inverse.senses.actions.values(torch.from_numpy(rows).float())

        def loss(step: int) -> Tensor:
            drawn = torch.randint(len(inputs), (self.batch_size,))
            return -inverse(inputs[drawn]).log_prob(wanted[drawn]).mean()

        Descent(num_steps, self.learning_rate).run(inverse, loss, seed=seed)


def _plain(episodes: Demonstrations) -> Iterator[Trajectory]:
    """Observations and actions alone."""
    return (Trajectory(episode.observations, episode.actions) for episode in episodes)


@torch.no_grad()
def _inferred(inverse: InverseModel, demonstrations: Demonstrations) -> Demonstrations:
    """The demonstrations with the most likely actions in the place of theirs."""
    values = inverse(inverse.inputs(demonstrations)).mode()
    actions = inverse.senses.actions.raw(values).double().numpy()
    starts = np.cumsum(demonstrations.lengths) - demonstrations.lengths
    return replace(demonstrations, actions=actions, action_starts=starts, steps={})
