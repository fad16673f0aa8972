"""How much z tells of the world: facts about a world, such as where a zombie started, predicted from z.

A style is how something was played, not where. What can be told of the world *within* a style is what the latent
memorised of it:

    R2 = 1 - sum_i |y_i - f(z_i)|^2 / sum_i |y_i - mean(y)|^2

where f is a regressor of the mean of the 20 nearest neighbours among other episodes (5 folds) and y the facts, each
standardised. 0 says that nothing is told; below 0, that the neighbours are worse than the mean. In nats,

    sum_d max(0, 1/2 log(Var(y_d) / MSE_d)),

what the predictions save a Gaussian code that writes each fact on its own; 1/2 log 10^6 at most of a fact that z tells
without error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sklearn.model_selection import KFold, cross_val_predict
from sklearn.neighbors import KNeighborsRegressor

from tvae.evaluate.encoding import Posteriors
from tvae.spaces import FloatArray, IntArray

NUM_NEIGHBOURS = 20
NUM_FOLDS = 5
FEWEST_EPISODES = 2 * NUM_NEIGHBOURS
"""A style needs as many."""
_EXACT = 1e-6
"""Share of a fact's variance below which an error counts as so much."""


@dataclass(frozen=True, order=True)
class Told:
    """What is told of the world within a style."""

    r2: float
    """Of all facts together."""
    nats: float
    """At least 0."""


@dataclass(frozen=True)
class Leakage:
    """What is told in the style that tells most, by R2."""

    from_sample: Told
    """From z ~ q(z | tau), which is what a bot is given."""
    from_mean: Told
    """From the mean of q(z | tau)."""


def leakage(posteriors: Posteriors, world: FloatArray, styles: IntArray, *, seed: int = 0) -> Leakage:
    """What z tells of `world` (E, D) within each of `styles` (E,), at its worst.

    Raises `ValueError` where no style has 40 episodes.

    >>> rng = np.random.default_rng(1)
    >>> means = rng.standard_normal((400, 2))
    >>> found = leakage(Posteriors(means, np.full((400, 2), 5.0)), means, np.zeros(400, dtype=np.int64))
    >>> found.from_mean.r2 > 0.9, found.from_sample.r2 < 0.1
    (True, True)
    """
    rng = np.random.default_rng(seed)
    sample = posteriors.sample(rng)
    enough = [style for style in np.unique(styles) if (styles == style).sum() >= FEWEST_EPISODES]
    if not enough:
        raise ValueError(f"leakage needs a style of at least {FEWEST_EPISODES} episodes, got {len(styles)} in all")
    worst = [
        max(_told(z[styles == style], world[styles == style], seed) for style in enough)
        for z in (sample, posteriors.means)
    ]
    return Leakage(*worst)


def _told(z: FloatArray, world: FloatArray, seed: int) -> Told:
    mean, spread = world.mean(0), world.std(0)
    varies = spread > 1e-9 * (1 + np.abs(mean))
    if not varies.any():
        return Told(0.0, 0.0)
    facts = ((world - mean) / np.where(varies, spread, 1.0))[:, varies]
    folds = KFold(NUM_FOLDS, shuffle=True, random_state=seed)
    predicted = cross_val_predict(KNeighborsRegressor(NUM_NEIGHBOURS), z, facts, cv=folds)
    squares, errors = (facts**2).sum(0), ((facts - predicted) ** 2).sum(0)
    saved = 0.5 * np.log(squares / np.maximum(errors, _EXACT * squares))
    return Told(float(1 - errors.sum() / squares.sum()), float(saved.clip(0).sum()))
