"""Circle: figure 4, how true bots keep to their circle, and errors by horizon."""

from __future__ import annotations

from typing import Any

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.envs.circle import LONGEST, RADII, angles_walked, circle_demonstrations, circle_steps, radius_errors
from tvae.evaluate.paths import apart, cut_to
from tvae.experiments.arenas import Arena
from tvae.experiments.reproduction.numbers import Picture, path_table, point_table, stacked
from tvae.experiments.reproduction.subject import TEST, WORLDS, Subject, acted, first_observations, paths
from tvae.figures.reconstructions import reconstructions
from tvae.generate.open_loop import imagine
from tvae.model.decoding import most_likely, sampled
from tvae.spaces import FloatArray, IntArray

ENV = "tvae/Circle-v0"
LABELS = tuple(RADII)
_SHOWN = 60


def demonstrations(seed: int) -> Demonstrations:
    """1,500 trajectories."""
    return circle_demonstrations(1500, seed)


def test_demonstrations() -> Demonstrations:
    """300 trajectories that no model learnt from."""
    return circle_demonstrations(300, TEST)


def measure(subject: Subject) -> dict[str, Any]:
    """Over the first ceil(2 pi |R|) steps of bots that get z from a style and sample their actions.

    `radial_error_by_circle`: mean |r - R| / |R|; `radial_error` is that of the worst circle. `turn_completed`: mean
    share of the full turn walked, at most 1, on the worst circle. `decoder_consistency`: mean distance of the state
    decoder's path and the policy decoder's, both most likely, at the z of a test trajectory. `horizon`: mean
    distance, step by step, from bots of all styles to the circle that each is nearest to; `horizon_end` its last.
    """
    model, test, far = subject.model, subject.test, horizon(subject)
    errors: dict[str, float] = {}
    likely: dict[str, float] = {}
    turns: dict[str, float] = {}
    for label, radius in RADII.items():
        for found, choice in ((errors, sampled), (likely, most_likely)):
            bots = subject.play(subject.latents(label), Arena(ENV, episodes=subject.episodes), choice=choice)
            radii = np.full(len(bots), radius)
            found[label] = float(radius_errors(bots, radii).mean() / abs(radius))
            if choice is sampled:
                turns[label] = float(np.clip(angles_walked(bots, radii) / (2 * np.pi), 0, 1).mean())
    drawn = subject.posteriors.sample(np.random.default_rng(subject.seed))
    steps = _steps(test)
    starts, seed = first_observations(test), subject.seed
    thought = paths(imagine(model, starts, drawn, num_steps=LONGEST, choice=most_likely, seed=seed))
    done = paths(acted(model, ENV, drawn, choice=most_likely, seed=WORLDS + subject.seed))
    radii = np.array([RADII[label] for label in test.attribute("label").tolist()])
    return {
        **subject.common(),
        "radial_error": max(errors.values()),
        "radial_error_by_circle": errors,
        "radial_error_most_likely": max(likely.values()),
        "radial_error_demonstrations": max(
            float((radius_errors(test, radii) / np.abs(radii))[radii == radius].mean()) for radius in RADII.values()
        ),
        "turn_completed": min(turns.values()),
        "turn_completed_by_circle": turns,
        "decoder_consistency": float(apart(cut_to(thought, steps), cut_to(done, steps)).mean()),
        "horizon": far,
        "horizon_end": far[-1],
    }


def measure_cloning(subject: Subject) -> dict[str, Any]:
    """`horizon` and `horizon_end` alone, for a bot without styles."""
    far = horizon(subject)
    return {"horizon": far, "horizon_end": far[-1]}


def horizon(subject: Subject) -> list[float]:
    """(T + 1,) mean distance at each step from the bots of all styles to the circle that each is nearest to on average.

    All walk for 126 steps; who keeps to a circle of radius 10 walks around it twice.
    """
    weights = [style.weight for style in subject.playstyles.styles]
    errors = [
        off_circle(np.stack(paths(subject.play(style, Arena(ENV, episodes=subject.episodes))))).mean(0)
        for style in subject.playstyles.styles
    ]
    return np.average(errors, axis=0, weights=weights).round(5).tolist()


def off_circle(places: FloatArray) -> FloatArray:
    """(E, T) distance at each step of each path (E, T, 2) to the circle that it is nearest to on average."""
    radii = np.array(list(RADII.values()))
    centres = np.stack([np.zeros(3), radii], axis=1)
    away = np.abs(np.linalg.norm(places[:, None] - centres[:, None], axis=-1) - np.abs(radii)[:, None])
    nearest: FloatArray = np.take_along_axis(away, away.mean(-1).argmin(-1)[:, None, None], axis=1)[:, 0]
    return nearest


def _steps(test: Demonstrations) -> IntArray:
    return np.array([circle_steps(RADII[label]) for label in test.attribute("label").tolist()])


def draw(subject: Subject) -> list[Picture]:
    """Figure 4."""
    model, test = subject.model, subject.test.select(list(range(_SHOWN)))
    drawn, steps = subject.posteriors.means[:_SHOWN], _steps(test)
    starts, seed = first_observations(test), WORLDS + subject.seed
    truth = paths(test)
    thought = cut_to(paths(imagine(model, starts, drawn, num_steps=LONGEST, choice=sampled, seed=subject.seed)), steps)
    done = cut_to(paths(acted(model, ENV, drawn, choice=sampled, seed=seed)), steps)
    panels = {"ground truth": truth, "state decoder": thought, "policy decoder": done}
    labels = test.attribute("label").tolist()
    figure = reconstructions(
        truth,
        thought,
        done,
        np.array([LABELS.index(label) for label in labels]),
        subject.posteriors.means[:_SHOWN],
        [label.replace("_", ", radius ") for label in LABELS],
    )
    every = subject.test.attribute("label").tolist()
    latent = point_table(subject.posteriors.means, every, "latent space")
    return [Picture("figure-4", figure, stacked([path_table(panels, labels), latent]))]
