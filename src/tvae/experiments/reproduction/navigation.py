"""Navigation: figures 2 and 3, distance to each trajectory's own goal, and errors by horizon."""

from __future__ import annotations

from typing import Any

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.envs.navigation import GOAL_BEARINGS, GOAL_DISTANCE, GOAL_JITTER, NUM_STEPS, navigation_demonstrations
from tvae.envs.plane import direction
from tvae.evaluate.paths import apart, ends, to_nearest
from tvae.experiments.arenas import Arena
from tvae.experiments.reproduction.numbers import Picture, path_table, point_table, stacked
from tvae.experiments.reproduction.subject import TEST, WORLDS, Subject, acted, first_observations, paths
from tvae.figures.interpolation import interpolation
from tvae.figures.panels import Landmark
from tvae.figures.reconstructions import reconstructions
from tvae.generate.open_loop import imagine
from tvae.model.decoding import most_likely, sampled
from tvae.spaces import FloatArray, IntArray

ENV = "tvae/Navigation-v0"
LABELS = tuple(GOAL_BEARINGS)
GOALS: FloatArray = GOAL_DISTANCE * direction(np.array(list(GOAL_BEARINGS.values())))
"""(3, 2) where the goals lie before they are jittered."""
REACHED = 13.0
"""Distance from a goal within which 95 % of the demonstrators end."""
_LANDMARKS = [Landmark("goals (one standard deviation)", x, y, GOAL_JITTER) for x, y in GOALS.tolist()]
_SHOWN = 60
_SIDE = 5


def demonstrations(seed: int) -> Demonstrations:
    """1,500 trajectories."""
    return navigation_demonstrations(1500, seed)


def test_demonstrations() -> Demonstrations:
    """300 trajectories that no model learnt from."""
    return navigation_demonstrations(300, TEST)


def measure(subject: Subject) -> dict[str, Any]:
    """Distances in steps of length 1.

    `end_distance`: from where the bot ends to the goal of the very test trajectory from which its z was drawn,
    with sampled actions. `decoder_consistency`: mean distance of the state decoder's path and the policy decoder's,
    both most likely, at the same z, over all 100 steps. `horizon`: mean distance, step by step, from bots of all
    styles to the test trajectory that each is nearest to on average; `horizon_end` its last.
    """
    model, test, far = subject.model, subject.test, horizon(subject)
    goals = np.stack([test.attribute("goal_x"), test.attribute("goal_y")], axis=1)
    drawn = subject.posteriors.sample(np.random.default_rng(subject.seed))
    starts, seed = first_observations(test), WORLDS + subject.seed

    def end_distance(places: list[FloatArray]) -> float:
        return float(np.linalg.norm(ends(places) - goals, axis=1).mean())

    noise_free = paths(acted(model, ENV, drawn, choice=most_likely, seed=seed))
    thought = paths(imagine(model, starts, drawn, num_steps=NUM_STEPS, choice=most_likely, seed=subject.seed))
    return {
        **subject.common(),
        "end_distance": end_distance(paths(acted(model, ENV, drawn, choice=sampled, seed=seed))),
        "end_distance_from_mean": end_distance(
            paths(acted(model, ENV, subject.posteriors.means, choice=sampled, seed=seed))
        ),
        "end_distance_most_likely": end_distance(noise_free),
        "end_distance_demonstrations": end_distance(paths(test)),
        "decoder_consistency": float(apart(thought, noise_free).mean()),
        "goals_reached_on_grid": _goals_on_grid(subject),
        "horizon": far,
        "horizon_end": far[-1],
    }


def measure_cloning(subject: Subject) -> dict[str, Any]:
    """`horizon` and `horizon_end` alone, for a bot without styles."""
    far = horizon(subject)
    return {"horizon": far, "horizon_end": far[-1]}


def horizon(subject: Subject) -> list[float]:
    """(T + 1,) mean distance at each step from the bots of all styles to the test trajectory nearest to each."""
    references = np.stack(paths(subject.test))
    weights = [style.weight for style in subject.playstyles.styles]
    errors = [
        to_nearest(np.stack(paths(subject.play(style, Arena(ENV, episodes=subject.episodes)))), references).mean(0)
        for style in subject.playstyles.styles
    ]
    return np.average(errors, axis=0, weights=weights).round(5).tolist()


def draw(subject: Subject) -> list[Picture]:
    """Figures 2 and 3."""
    model, test = subject.model, subject.test.select(list(range(_SHOWN)))
    drawn = subject.posteriors.means[:_SHOWN]
    truth = paths(test)
    starts = first_observations(test)
    thought = paths(imagine(model, starts, drawn, num_steps=NUM_STEPS, choice=sampled, seed=subject.seed))
    done = paths(acted(model, ENV, drawn, choice=sampled, seed=WORLDS + subject.seed))
    panels = {"ground truth": truth, "state decoder": thought, "policy decoder": done}
    labels = test.attribute("label").tolist()
    every = subject.test.attribute("label").tolist()
    second = reconstructions(
        truth,
        thought,
        done,
        np.array([LABELS.index(label) for label in labels]),
        subject.posteriors.means[:_SHOWN],
        LABELS,
        landmarks=_LANDMARKS,
    )
    return [
        Picture(
            "figure-2",
            second,
            stacked([path_table(panels, labels), point_table(subject.posteriors.means, every, "latent space")]),
        ),
        _third(subject),
    ]


def _third(subject: Subject) -> Picture:
    grid = _grid(subject)
    flat = grid.reshape(-1, 2)
    starts = np.zeros((len(flat), 2))
    thought = paths(imagine(subject.model, starts, flat, num_steps=NUM_STEPS, choice=most_likely, seed=subject.seed))
    done = paths(acted(subject.model, ENV, flat, choice=most_likely, seed=WORLDS + subject.seed))
    nearest = goal_reached(done).reshape(grid.shape[:2])
    side = grid.shape[1]

    def cells(block: list[FloatArray]) -> list[list[list[FloatArray]]]:
        return [[[path] for path in block[row * side : (row + 1) * side]] for row in range(len(grid))]

    names = [LABELS[goal] if goal >= 0 else "between" for goal in nearest.ravel().tolist()]
    return Picture(
        "figure-3",
        interpolation(grid, cells(thought), cells(done), nearest, LABELS, landmarks=_LANDMARKS),
        path_table({"state decoder": thought, "policy decoder": done}, names),
        {"grid": grid.round(4).tolist(), "goal": nearest.tolist()},
    )


def _goals_on_grid(subject: Subject) -> int:
    flat = _grid(subject).reshape(-1, 2)
    done = paths(acted(subject.model, ENV, flat, choice=most_likely, seed=WORLDS + subject.seed))
    return len(set(goal_reached(done).tolist()) - {-1})


def latent_grid(ends: FloatArray) -> FloatArray:
    """(5, 5, 2) latents, evenly from the least to the largest of `ends` (K, 2) in each dimension.

    Five a side, so that the middle one of three styles in a row lies on the grid, and what is between them too.
    """
    across, up = np.linspace(ends.min(0), ends.max(0), _SIDE).T
    return np.stack(np.meshgrid(across, up[::-1]), axis=2)


def _grid(subject: Subject) -> FloatArray:
    styles = subject.playstyles.styles
    return latent_grid(np.stack([style.mean for style in styles]) if len(styles) > 1 else subject.posteriors.means)


def goal_reached(places: list[FloatArray]) -> IntArray:
    """(E,) which goal each path ends within 13 of; -1 for none."""
    distances = np.linalg.norm(ends(places)[:, None] - GOALS, axis=2)
    return np.where(distances.min(1) <= REACHED, distances.argmin(1), -1)
