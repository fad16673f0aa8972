"""Discovery of playstyles: how many clusters the latents of the episodes form, and who belongs to which.

1. Latent features whose posterior means differ between episodes are kept; if together they hold next to nothing,
   no style can be told.
2. Gaussian mixtures propose pieces of the cloud of posterior means (`tvae.evaluate.mixtures`).
3. Pieces between which there is no clear valley are one cluster (`tvae.evaluate.valleys`).
4. Clusters that a *sample* z ~ q(z | tau) does not tell apart are one style, since a sample is what a bot gets
   (`tvae.evaluate.separation`).

Clusters are sought among the means and judged by the samples, because samples of two clusters show no valley until
their middles are two posterior scales apart, although they tell which is which in 84 % of the cases by then.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.mixtures import Components, assign, joined
from tvae.evaluate.separation import FEWEST_POINTS, Separation, everything, separate
from tvae.evaluate.styles import Playstyles, Style
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray

NOT_DISTINGUISHABLE = "not distinguishable"
"""How a verdict begins where no styles can be told."""
_COLLAPSED_NATS = 0.05
_ACTIVE = 0.01
"""A latent feature is active where the means have at least this share of the aggregated posterior's variance."""
_MOST_SEARCHED = 4_000
_MOST_MEMBERS = 500
_MOST_PROTOTYPES = 5


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
    """The playstyles among N episodes with these posteriors.

    Distances are in posterior scales, u_d = (mean_i sigma_id^2)^(1/2). What the latent holds of an episode is
    measured as 1/2 sum_d ln(1 + var(mu_d) / u_d^2) nats; below 0.05 it has collapsed. Of more than 4,000
    episodes, the styles are sought in a random 4,000, then all are assigned. A style has at least 2 % of the
    episodes, and 5 of them.

    >>> rng = np.random.default_rng(0)
    >>> means = np.repeat([[-1.0, 0.0], [1.0, 0.0]], 100, axis=0) + 0.1 * rng.standard_normal((200, 2))
    >>> find_playstyles(Posteriors(means, np.full((200, 2), 0.2))).verdict
    '2 styles (50 %, 50 % of the episodes). A sample of z tells its style in 100 % of the cases.'
    """
    rng = np.random.default_rng(seed)
    units = np.sqrt((posteriors.scales**2).mean(0))
    signal = posteriors.means.var(0) / units**2
    nats = float(0.5 * np.log1p(signal).sum())
    active = np.flatnonzero(signal / (1 + signal) >= _ACTIVE)
    some = posteriors.select(_some(len(posteriors), _MOST_SEARCHED, rng))
    points, samples = (z[:, active] / units[active] for z in (some.means, some.sample(rng)))
    if len(points) < 2 * FEWEST_POINTS:
        separation = everything(points)
        reason = f"{len(points)} episodes are too few, at least {2 * FEWEST_POINTS} are needed."
    elif nats < _COLLAPSED_NATS or len(active) == 0:
        separation = everything(points)
        reason = (
            f"the latent has collapsed: it holds {nats:.2f} nats of an episode, so that every episode has nearly "
            "the same posterior."
        )
    else:
        separation = separate(points, samples, seed=seed)
        reason = _reason(separation)
    clusters = [cluster.scaled(units[active]) for cluster in separation.clusters]
    styles, assignment, probability, order = _styles(clusters, posteriors, active, rng)
    confusion = separation.confusion[np.ix_(order, order)]
    verdict = _verdict(styles, confusion, reason, nats)
    parts = tuple((style.index,) for style in styles)
    return Playstyles(styles, assignment, probability, verdict, tuple(active.tolist()), confusion, parts)


def join(found: Playstyles, posteriors: Posteriors, groups: Sequence[Sequence[int]], *, seed: int = 0) -> Playstyles:
    """The same with some styles made one: those of each group, by their numbers; a style in no group stays.

    `found` are playstyles in which none was joined yet, and `posteriors` those of its episodes. A joined style has the
    components of all its parts, so that p(style | mu) is the sum of theirs; `Playstyles.parts` says which they are.

    Raises `ValueError` for a style that is not there, or that is named twice.

    >>> rng = np.random.default_rng(0)
    >>> means = np.repeat([[-4.0], [0.0], [4.0]], (100, 60, 40), axis=0) + 0.2 * rng.standard_normal((200, 1))
    >>> posteriors = Posteriors(means, np.full((200, 1), 0.2))
    >>> join(find_playstyles(posteriors), posteriors, [[0, 2]]).verdict
    '2 styles (70 %, 30 % of the episodes), joined from 3. A sample of z tells its style in 100 % of the cases.'
    """
    named = [style for group in groups for style in group]
    if len(set(named)) < len(named) or not set(named) <= set(range(len(found))):
        raise ValueError(f"groups must name styles 0 to {len(found) - 1}, each once at most, got {list(groups)}")
    parts = [sorted(group) for group in groups] + [[style] for style in range(len(found)) if style not in named]
    clusters = [reduce(joined, (found.styles[part].components for part in group)) for group in parts]
    active = np.array(found.active, dtype=np.int64)
    styles, assignment, probability, order = _styles(clusters, posteriors, active, np.random.default_rng(seed))
    parts = [parts[group] for group in order]
    shares = np.array([style.weight for style in found.styles])
    of_group = np.array([np.isin(range(len(found)), group) for group in parts])
    told = (of_group * shares) @ found.confusion @ of_group.T / (of_group @ shares)[:, None]
    verdict = _joined_verdict(styles, told, len(found))
    return Playstyles(
        styles, assignment, probability, verdict, found.active, told, tuple(tuple(group) for group in parts)
    )


def _styles(
    clusters: Sequence[Components], posteriors: Posteriors, active: IntArray, rng: np.random.Generator
) -> tuple[tuple[Style, ...], IntArray, FloatArray, IntArray]:
    """Styles of these clusters, the most frequent one first; (N,) the style of each episode and its posterior
    probability; and (K,) the cluster of each style."""
    assignment, probability = assign(clusters, posteriors.means[:, active])
    order = np.argsort(-np.bincount(assignment, minlength=len(clusters)), kind="stable")
    assignment = np.argsort(order)[assignment]
    styles = tuple(
        _style(index, clusters[cluster], posteriors, np.flatnonzero(assignment == index), rng)
        for index, cluster in enumerate(order)
    )
    return styles, assignment, probability, order


def _reason(separation: Separation) -> str:
    """In words, why fewer styles than clusters were found; empty where that is not so."""
    if separation.num_proposed == len(separation.clusters):
        return ""
    return (
        f"the posterior means form {separation.num_proposed} clusters, but a sample of z is told as a wrong one "
        f"in {_percent(separation.worst)} of the cases."
    )


def _verdict(styles: tuple[Style, ...], confusion: FloatArray, reason: str, nats: float) -> str:
    if len(styles) > 1:
        found = f"{_counted(styles)}. {_told(confusion)}"
        return f"{found} Some were joined: {reason}" if reason else found
    if reason:
        return f"{NOT_DISTINGUISHABLE}: {reason}"
    return f"one style: the latent holds about {nats:.1f} nats of an episode, but its values form a single cluster."


def _joined_verdict(styles: tuple[Style, ...], confusion: FloatArray, num_found: int) -> str:
    if len(styles) == 1:
        return f"one style, joined from {num_found}."
    return f"{_counted(styles)}, joined from {num_found}. {_told(confusion)}"


def _counted(styles: tuple[Style, ...]) -> str:
    return f"{len(styles)} styles ({', '.join(_percent(style.weight) for style in styles)} of the episodes)"


def _told(confusion: FloatArray) -> str:
    return f"A sample of z tells its style in {_percent(float(np.diag(confusion).mean()))} of the cases."


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _some(count: int, most: int, rng: np.random.Generator) -> IntArray:
    """Positions of all of `count`, or of `most` random ones."""
    return np.arange(count) if count <= most else np.sort(rng.choice(count, most, replace=False))


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
        prototypes=tuple(episodes[nearest].tolist()),
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
