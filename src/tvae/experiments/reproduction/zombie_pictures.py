"""Zombie attack: figures 5 to 8 and the animations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.animation import FuncAnimation

from tvae.data.trajectory import Trajectory
from tvae.envs.zombie import success
from tvae.envs.zombie_dynamics import NUM_STEPS
from tvae.evaluate.over_seeds import band
from tvae.experiments.arenas import Arena
from tvae.experiments.reproduction.numbers import Picture, Runs, path_table, point_table, stacked
from tvae.experiments.reproduction.subject import Subject, first_observations
from tvae.experiments.reproduction.zombie import (
    ENV,
    FIELDS,
    LABELS,
    NUM_TEST,
    WINDOWS,
    acted_as_test,
    agents,
    at_one_z,
    demonstrated,
    distances_of,
    outcomes_of,
    until_goal,
)
from tvae.figures.animation import animate
from tvae.figures.latent import latent_space
from tvae.figures.outcomes import StyleOutcomes, outcomes
from tvae.figures.panels import Band
from tvae.figures.scene import Scene, in_proportion
from tvae.figures.windows import WindowedBot, windows
from tvae.figures.zombie_reconstructions import zombie_reconstructions
from tvae.generate.open_loop import imagine
from tvae.model.decoding import LatentSource, sampled
from tvae.spaces import FloatArray

_EXAMPLES = 3
_SHOWN = 25


def draw(subject: Subject) -> list[Picture]:
    """Figures 5, 6 and 7."""
    return [_reconstructions(subject), _latent_space(subject), _outcomes(subject)]


def _reconstructions(subject: Subject) -> Picture:
    drawn = subject.posteriors.means
    starts = first_observations(subject.test)
    thought = imagine(subject.model, starts, drawn, num_steps=NUM_STEPS, choice=sampled, seed=subject.seed)
    rows = {
        "ground truth": list(subject.test),
        "state decoder": [until_goal(episode) for episode in thought],
        "policy decoder": acted_as_test(subject, drawn, choice=sampled),
    }

    def examples(episodes: Sequence[Trajectory]) -> list[list[Trajectory]]:
        return [list(episodes[style * NUM_TEST : style * NUM_TEST + _EXAMPLES]) for style in range(len(LABELS))]

    shown = {name: examples(episodes) for name, episodes in rows.items()}
    labels = [label for label in LABELS for _ in range(_EXAMPLES)]
    table = path_table(
        {name: agents([episode for style in styles for episode in style]) for name, styles in shown.items()}, labels
    )
    figure = zombie_reconstructions(
        shown["ground truth"], shown["state decoder"], shown["policy decoder"], LABELS
    )
    return Picture("figure-5", figure, table)


def _latent_space(subject: Subject) -> Picture:
    labels = subject.test.attribute("label").tolist()
    which = np.array([LABELS.index(label) for label in labels])
    means, scales = subject.posteriors.means, subject.posteriors.scales
    figure = latent_space(means, which, LABELS, deviations=scales)
    return Picture("figure-6", figure, point_table(means, labels, "latent space"))


def _outcomes(subject: Subject) -> Picture:
    styles, tables = [], []
    for label in LABELS:
        bots, shown = outcomes_of(at_one_z(subject, label)), outcomes_of(demonstrated(subject, label))
        styles.append(StyleOutcomes(label, bots, shown, distances_of(bots, shown)))
        for who, found in (("bot", bots), ("demonstrations", shown)):
            columns = {name: getattr(found, name).astype(float).round(4).tolist() for name in FIELDS}
            count = len(columns["attacked"])
            tables.append({"style": [label] * count, "who": [who] * count, **columns})
    facts = {"wasserstein": {style.name: dict(style.wasserstein) for style in styles}}
    return Picture("figure-7", outcomes(styles), stacked(tables), facts)


def draw_across(runs: Runs) -> list[Picture]:
    """Figure 8, from all seeds: trained on whole episodes (ours and the paper's reading) and on windows."""
    curves = {
        "ours: windows of 4 steps": "default",
        "ours: whole episodes": "whole_episodes",
        "the paper's reading": "paper",
    }
    found = {name: runs[preset] for name, preset in curves.items() if runs.get(preset)}
    bands: dict[str, dict[str, Band]] = {label: {} for label in LABELS}
    tables = []
    for name, metrics in found.items():
        for label in LABELS:
            rates = np.array([[run["success_by_window"][str(w)][label] for w in WINDOWS] for run in metrics])
            mean, low, high = band(rates)
            bands[label][name] = Band(mean, low.clip(0, 1), high.clip(0, 1))
            tables.append(
                {
                    "trained": [name] * len(WINDOWS),
                    "style": [label] * len(WINDOWS),
                    "window": list(WINDOWS),
                    "success": mean.round(4).tolist(),
                    "low": low.round(4).tolist(),
                    "high": high.round(4).tolist(),
                }
            )
    by_hand = float(np.mean([run["two_step_bot"] for run in runs["default"]]))
    figure = windows(WINDOWS, bands, bots=[WindowedBot("written by hand, W = 2", "attack", 2, by_hand)])
    facts = {"two_step_bot": by_hand, "seeds": {name: len(metrics) for name, metrics in found.items()}}
    return [Picture("figure-8", figure, stacked(tables), facts)]


class _Recorded:
    """Gives what `latents` gives, and keeps it."""

    def __init__(self, latents: LatentSource) -> None:
        self.latents = latents

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        self.z = self.latents.sample(count, rng)
        return self.z


def animations(subject: Subject) -> dict[str, FuncAnimation]:
    """Fresh episodes of each style's bot, successes and failures in their true proportion."""
    which = np.array([LABELS.index(label) for label in subject.test.attribute("label").tolist()])
    found = {}
    for index, label in enumerate(LABELS):
        latents = _Recorded(subject.latents(label))
        episodes = subject.play(latents, Arena(ENV, episodes=min(subject.episodes, 1000)))
        succeeded = success(episodes)[label]
        shown = in_proportion(succeeded, min(_SHOWN, len(episodes)), np.random.default_rng(subject.seed))
        scene = Scene(
            episodes=[episodes[int(episode)] for episode in shown],
            succeeded=succeeded[shown],
            z=latents.z[shown],
            window=subject.model.bot_window,
            name=label,
            style=index,
            background_means=subject.posteriors.means,
            background_assignment=which,
            names=LABELS,
        )
        found[f"animation-{label}"] = animate(scene, float(succeeded.mean()), len(episodes))
    return found
