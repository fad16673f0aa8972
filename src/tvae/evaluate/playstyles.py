"""Discovery of playstyles: how many clusters the latents of the demonstrations form, and who belongs to which.

1. Latent features whose posterior means differ between episodes are kept; if together they hold next to nothing,
   no style can be told.
2. Gaussian mixtures propose pieces of the cloud of posterior means (`tvae.evaluate.mixtures`).
3. Pieces between which there is no clear valley are one cluster (`tvae.evaluate.valleys`).
4. Clusters that a *sample* z ~ q(z | tau) does not tell apart are one style: what a bot gets is a sample.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.mixtures import Components, joined, plausible_mixtures
from tvae.evaluate.styles import Playstyles, Style, assign
from tvae.evaluate.valleys import clusters
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray

_COLLAPSED_NATS = 0.05
_ACTIVE = 0.01
"""A latent feature is active where the means' variance is at least this share of the aggregated posterior's."""
_MOST_FITTED = 2_000
_MOST_TESTED = 4_000
_FLOOR = 0.01
"""Smallest variance of a component, in squared posterior scales."""
_SMALLEST_SHARE, _FEWEST_EPISODES = 0.02, 5
_MOST_WRONG = 0.25
"""Share of wrongly told samples above which styles are not told apart."""
_MOST_MEMBERS, _MOST_PROTOTYPES = 500, 5


def discover(model: TrajectoryVAE, demonstrations: Demonstrations, *, seed: int = 0) -> Playstyles:
    """The playstyles of `demonstrations` in the latent space of `model`; their number is found, not given.

    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Continuous, Space
    >>> x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> walks = [Trajectory(np.zeros((t + 1, 1)), np.ones((t, 1))) for t in (5, 3, 4)]
    >>> discover(TrajectoryVAE(x, dx), Demonstrations.from_trajectories(walks, x, dx)).verdict
    'not distinguishable: 3 episodes are too few, at least 10 are needed.'
    """
    return find_playstyles(encode(model, demonstrations), seed=seed)


def find_playstyles(posteriors: Posteriors, *, seed: int = 0) -> Playstyles:
    """The playstyles among episodes with these posteriors.

    >>> rng = np.random.default_rng(0)
    >>> means = np.repeat([[-1.0, 0.0], [1.0, 0.0]], 100, axis=0) + 0.1 * rng.standard_normal((200, 2))
    >>> find_playstyles(Posteriors(means, np.full((200, 2), 0.3))).verdict
    '2 styles (50%, 50% of the episodes). A sample of z tells its style in 100% of the cases.'
    """
    rng = np.random.default_rng(seed)
    units = np.sqrt((posteriors.scales**2).mean(0))
    signal = posteriors.means.var(0) / units**2
    nats = float(0.5 * np.log1p(signal).sum())
    active = np.flatnonzero(signal / (1 + signal) >= _ACTIVE)
    points = posteriors.means[:, active] / units[active]
    if len(points) < 2 * _FEWEST_EPISODES:
        verdict = (
            f"not distinguishable: {len(points)} episodes are too few, at least {2 * _FEWEST_EPISODES} are needed."
        )
        styles, confusion = _single(points)
    elif nats < _COLLAPSED_NATS or len(active) == 0:
        verdict = (
            f"not distinguishable: the latent holds {nats:.2f} nats of an episode, "
            "so that every episode has nearly the same posterior."
        )
        styles, confusion = _single(points)
    else:
        proposed = _propose(points, rng, seed)
        some = posteriors.select(_some(len(posteriors), _MOST_TESTED, rng))
        samples = some.sample(rng)[:, active] / units[active]
        styles, confusion, wrong = _told_apart(proposed, some.means[:, active] / units[active], samples)
        verdict = _verdict(styles, proposed, confusion, wrong, nats, points)
    return _playstyles(posteriors, [style.scaled(units[active]) for style in styles], verdict, active, confusion, rng)


def _some(count: int, most: int, rng: np.random.Generator) -> IntArray:
    """Positions of all of `count`, or of `most` random ones."""
    return np.arange(count) if count <= most else np.sort(rng.choice(count, most, replace=False))


def _single(points: FloatArray) -> tuple[list[Components], FloatArray]:
    """One style that holds everything."""
    width = points.shape[1]
    covariance = np.cov(points.T, ddof=0).reshape(width, width) + _FLOOR * np.eye(width)
    return [Components(np.ones(1), points.mean(0)[None], covariance[None])], np.ones((1, 1))


def _propose(points: FloatArray, rng: np.random.Generator, seed: int) -> list[Components]:
    """The clusters of `points` (N, D) as groups of components, in units in which posteriors have variance 1.

    A split has to show in every plausible mixture: the one with the fewest clusters decides.
    """
    fitted, tested = (points[_some(len(points), most, rng)] for most in (_MOST_FITTED, _MOST_TESTED))
    proposals = [
        _without_small([mixture.select(group) for group in clusters(tested, mixture)], points)
        for mixture in plausible_mixtures(fitted, floor=_FLOOR, seed=seed)
    ]
    return min(proposals, key=len)


def _without_small(styles: list[Components], points: FloatArray) -> list[Components]:
    """Without the clusters of less than 2 % of the points or fewer than 5; their points fall to the others."""
    while True:
        counts = np.bincount(assign(styles, points)[0], minlength=len(styles))
        smallest = int(counts.argmin())
        if len(styles) == 1 or counts[smallest] >= max(_FEWEST_EPISODES, _SMALLEST_SHARE * len(points)):
            return styles
        styles = styles[:smallest] + styles[smallest + 1 :]


def _told_apart(
    styles: list[Components], points: FloatArray, samples: FloatArray
) -> tuple[list[Components], FloatArray, float]:
    """`styles` with those joined that a sample does not tell apart, their confusion, and the worst one joined.

    `samples` (N, D) are draws from the posteriors with means `points` (N, D), whose variances are about 1. A style
    is told from a sample as if all were equally frequent. The most confused two are joined while, of their samples
    or of all styles' samples, more than a quarter are told wrongly.
    """
    worst = 0.0
    while True:
        confusion = _confusion(styles, points, samples)
        told = np.diag(confusion)
        between = confusion + confusion.T
        pairs = np.triu(between / np.maximum(between + told + told[:, None], 1e-12), 1)
        wrong = max(float(pairs.max()), float(1 - told.mean()))
        if wrong <= _MOST_WRONG:
            return styles, confusion, worst
        worst = max(worst, wrong)
        i, j = (int(index) for index in np.unravel_index(pairs.argmax(), pairs.shape))
        rest = [style for index, style in enumerate(styles) if index not in {i, j}]
        styles = [*rest, joined(styles[i], styles[j])]


def _confusion(styles: list[Components], points: FloatArray, samples: FloatArray) -> FloatArray:
    """(K, K) row: of the samples of a style's points, the share told as each style."""
    noise = np.ones(points.shape[1])
    told, _ = assign([style.normalised().blurred(noise) for style in styles], samples)
    counts = np.zeros((len(styles), len(styles)))
    np.add.at(counts, (assign(styles, points)[0], told), 1.0)
    return counts / np.maximum(counts.sum(1, keepdims=True), 1)


def _verdict(
    styles: list[Components],
    proposed: list[Components],
    confusion: FloatArray,
    wrong: float,
    nats: float,
    points: FloatArray,
) -> str:
    if len(styles) > 1:
        counts = np.sort(np.bincount(assign(styles, points)[0]))[::-1]
        shares = ", ".join(f"{count / len(points):.0%}" for count in counts)
        text = f"{len(styles)} styles ({shares} of the episodes). "
        text += f"A sample of z tells its style in {np.diag(confusion).mean():.0%} of the cases."
        if wrong:
            text += f" The posterior means form {len(proposed)} clusters, but a sample does not tell all of them apart."
        return text
    if wrong:
        return (
            f"not distinguishable: the posterior means form {len(proposed)} clusters, but a sample of z is told as "
            f"the wrong one in {wrong:.0%} of the cases."
        )
    return f"one style: the latent holds about {nats:.1f} nats of an episode, but its values form a single cluster."


def _playstyles(
    posteriors: Posteriors,
    styles: list[Components],
    verdict: str,
    active: IntArray,
    confusion: FloatArray,
    rng: np.random.Generator,
) -> Playstyles:
    """The record of these styles, the most frequent first."""
    points = posteriors.means[:, active]
    counts = np.bincount(assign(styles, points)[0], minlength=len(styles))
    order = np.argsort(-counts, kind="stable")
    ordered = [styles[index] for index in order]
    assignment, probability = assign(ordered, points)
    found = tuple(
        _style(index, components, posteriors, np.flatnonzero(assignment == index), rng)
        for index, components in enumerate(ordered)
    )
    features = tuple(int(feature) for feature in active)
    return Playstyles(found, assignment, probability, verdict, features, confusion[np.ix_(order, order)])


def _style(
    index: int, components: Components, posteriors: Posteriors, episodes: IntArray, rng: np.random.Generator
) -> Style:
    own = posteriors.select(episodes)
    middle = own.means.mean(0)
    away = own.means - middle
    covariance = away.T @ away / len(own) + np.diag((own.scales**2).mean(0))
    distance = (away * np.linalg.solve(covariance, away.T).T).sum(1)
    nearest = np.argsort(distance, kind="stable")[:_MOST_PROTOTYPES]
    return Style(
        index=index,
        weight=len(own) / len(posteriors),
        mean=middle,
        covariance=covariance,
        prototypes=tuple(int(episode) for episode in episodes[nearest]),
        members=own.select(_some(len(own), _MOST_MEMBERS, rng)),
        components=components,
    )


def label_agreement(assignment: IntArray, labels: NDArray[Any]) -> float:
    """Adjusted Rand index of the found styles and known labels, (N,) each: 1 the same partition, 0 chance.

    Hubert and Arabie, "Comparing partitions" (1985).

    >>> label_agreement(np.array([0, 0, 1, 1]), np.array(["b", "b", "a", "a"]))
    1.0
    """
    return float(adjusted_rand_score(labels, assignment))


def match(assignment: IntArray, labels: NDArray[Any]) -> dict[int, Any]:
    """The most frequent label among the episodes of each style; of equally frequent ones the first in order.

    >>> match(np.array([0, 0, 0, 1]), np.array(["attack", "attack", "avoid", "avoid"]))
    {0: 'attack', 1: 'avoid'}
    """
    found: dict[int, Any] = {}
    for style in np.unique(assignment):
        names, counts = np.unique(labels[assignment == style], return_counts=True)
        found[int(style)] = names[counts.argmax()].item()
    return found
