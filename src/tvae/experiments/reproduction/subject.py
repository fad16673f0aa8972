"""A trained model with all that its measurements need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.playstyles import label_agreement
from tvae.evaluate.styles import Playstyles
from tvae.experiments.arenas import Arena
from tvae.experiments.bots import bot_episodes, vector_env
from tvae.experiments.findings import Findings
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import Choice, LatentSource, sampled
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import policy_windows
from tvae.rollouts import rollout
from tvae.spaces import FloatArray, IntArray
from tvae.train.loop import evaluate

WORLDS = 10_000
"""Bots of training seed k play worlds of seed WORLDS + k."""
TEST = 1_000_000
"""Seed of the test demonstrations, the same for all models, so that their styles can be compared."""


@dataclass(frozen=True)
class Labelled:
    """z of another episode with this label: what a bot gets where no found style bears the label."""

    posteriors: Posteriors

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z): an episode at random, then z ~ q(z | tau_i)."""
        return self.posteriors.select(rng.integers(len(self.posteriors), size=count)).sample(rng)


@dataclass(frozen=True, eq=False)
class Subject:
    """A model, the demonstrations it learnt from, its styles, and the test demonstrations."""

    model: TrajectoryVAE
    demonstrations: Demonstrations
    findings: Findings
    test: Demonstrations
    seed: int
    episodes: int
    """How many fresh episodes each bot plays."""

    @cached_property
    def posteriors(self) -> Posteriors:
        """Of the test demonstrations."""
        return encode(self.model, self.test)

    @cached_property
    def assignment(self) -> IntArray:
        """(E,) the found style of each test demonstration."""
        return self.playstyles.assign(self.posteriors)[0]

    @property
    def playstyles(self) -> Playstyles:
        """The styles that were found."""
        return self.findings.playstyles

    def is_found(self, label: str) -> bool:
        """Whether one of the found styles bears this label."""
        return label in self.findings.labels.values()

    def latents(self, label: str) -> LatentSource:
        """The found style of this label; where there is none, training episodes that carry it."""
        return self.findings.style(label) if self.is_found(label) else self._labelled[label]

    @cached_property
    def _labelled(self) -> dict[str, Labelled]:
        labels = self.demonstrations.attribute("label")
        return {
            label: Labelled(encode(self.model, self.demonstrations.select(np.flatnonzero(labels == label))))
            for label in np.unique(labels).tolist()
        }

    def play(
        self, latents: LatentSource, arena: Arena, *, choice: Choice = sampled, window: int | None = None
    ) -> Demonstrations:
        """Fresh episodes of a bot."""
        bot = partial(LatentPolicy, self.model, latents, choice=choice, window=window)
        return bot_episodes(self.model, bot, arena, seed=WORLDS + self.seed, on_step=lambda finished: None)

    def common(self) -> dict[str, Any]:
        """What every task reports: styles on the test demonstrations, and what z holds."""
        labels = self.test.attribute("label")
        terms = evaluate(self.model, self.test, policy_windows)
        return {
            "playstyles": {
                "num_found": len(self.playstyles),
                "named": len(self.findings.labels),
                "ari": label_agreement(self.assignment, labels),
            },
            "kl_nats": terms.kl,
            "nats_per_trajectory": {"policy": terms.policy, "state": terms.state, "stop": terms.stop},
            "test_assignment": self.assignment.tolist(),
        }


def acted(
    model: TrajectoryVAE, env: str, z: FloatArray, *, choice: Choice, seed: int
) -> Demonstrations:
    """An episode of the policy decoder in the environment for each row of `z` (E, Z)."""
    envs = vector_env(Arena(env, episodes=len(z)))
    try:
        return rollout(envs, LatentPolicy(model, _InTurn(z), choice=choice), len(z), seed=seed)
    finally:
        envs.close()


class _InTurn:
    """Rows of z one after another, over as many rounds of episodes as it takes."""

    def __init__(self, z: FloatArray) -> None:
        self.z = z

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z) the next rows."""
        rows = self.z[np.arange(count) % len(self.z)]
        self.z = np.roll(self.z, -count, axis=0)
        return rows


def first_observations(demonstrations: Demonstrations) -> FloatArray:
    """(E, O)"""
    return demonstrations.observations[demonstrations.observation_starts]


def paths(demonstrations: Demonstrations) -> list[FloatArray]:
    """The places (T + 1, 2) of each episode, which the first two observations are."""
    return [episode.observations[:, :2] for episode in demonstrations]
