"""A playstyle, and all playstyles of a set of episodes: what discovery returns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tvae.errors import ModelError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.mixtures import Components, assign
from tvae.pretrained import pretrained_directory
from tvae.spaces import FloatArray, IntArray

SCHEMA_VERSION = 1


@dataclass(frozen=True, eq=False)
class Style:
    """One cluster of latents: a way to play. A `LatentSource`, so that a bot can be made of it.

    The middle and the covariance describe the aggregated posterior of the style's episodes,
    q_k(z) = 1/N_k sum_i q(z | tau_i): mean = mean of mu_i, covariance = cov of mu_i + mean of diag sigma_i^2.
    """

    index: int
    weight: float
    """Share of the episodes."""
    mean: FloatArray
    """(Z,)"""
    covariance: FloatArray
    """(Z, Z)"""
    prototypes: tuple[int, ...]
    """Positions of the episodes nearest to the middle, nearest first, at most 5."""
    members: Posteriors
    """Posteriors of the style's episodes, at most 500 of them; what `sample` draws from."""
    components: Components
    """The pieces of the style among the posterior means, in the active latent features."""

    def __repr__(self) -> str:
        middle = ", ".join(f"{value:.3g}" for value in self.mean)
        return f"<Style {self.index}: {100 * self.weight:.0f} % of the episodes, z around ({middle})>"

    @property
    def name(self) -> str:
        """As reports say it: `style 0`."""
        return f"style {self.index}"

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z) draws from q_k(z): an episode at random, then z ~ q(z | tau_i)."""
        return self.members.select(rng.integers(len(self.members), size=count)).sample(rng)


@dataclass(frozen=True, eq=False)
class AnyStyle:
    """z of one of these styles, drawn by their weights for each episode. A `LatentSource` of several styles.

    >>> from tvae.evaluate.playstyles import find_playstyles
    >>> means = np.repeat([[-9.0], [0.0], [9.0]], [60, 40, 100], axis=0) + np.linspace(-1, 1, 200)[:, None]
    >>> styles = find_playstyles(Posteriors(means, np.full((200, 1), 0.5))).styles
    >>> z = AnyStyle(styles[1:]).sample(1000, np.random.default_rng(0))  # of the two less frequent ones
    >>> round(float((z < -5).mean()), 1), bool((z < 5).all())
    (0.6, True)
    """

    styles: Sequence[Style]

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        weights = np.array([style.weight for style in self.styles])
        which = rng.choice(len(self.styles), count, p=weights / weights.sum())
        drawn = np.stack([style.sample(count, rng) for style in self.styles])
        z: FloatArray = drawn[which, np.arange(count)]
        return z


def one_of(styles: Sequence[Style]) -> Style | AnyStyle:
    """The only one of these styles, or any of several."""
    return styles[0] if len(styles) == 1 else AnyStyle(styles)


@dataclass(frozen=True, eq=False)
class Playstyles:
    """The playstyles found in N episodes, the most frequent one first."""

    styles: tuple[Style, ...]
    """At least one; a single one that holds everything where none could be told apart."""
    assignment: IntArray
    """(N,) the style of each episode."""
    probability: FloatArray
    """(N,) posterior probability of that style given the episode's posterior mean."""
    verdict: str
    """What was found, in words: begins with `K styles`, `one style` or `not distinguishable`."""
    active: tuple[int, ...]
    """Latent features that tell episodes apart."""
    confusion: FloatArray
    """(K, K) row: of the samples z ~ q(z | tau) of a style's episodes, the share told as each style."""
    parts: tuple[tuple[int, ...], ...]
    """Numbers of the found styles that each style is: its own, or several where it was joined from them."""

    def __repr__(self) -> str:
        return f"<Playstyles: {self.verdict}>"

    def __len__(self) -> int:
        return len(self.styles)

    def assign(self, posteriors: Posteriors) -> tuple[IntArray, FloatArray]:
        """The style (N,) of other episodes by their posterior means, and its posterior probability (N,).

        p(k | mu) is proportional to sum_c w_c N(mu; m_c, S_c) over the components c of style k.
        """
        points = posteriors.means[:, self.active]
        return assign([style.components for style in self.styles], points)

    def to_json(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        return {
            "format": "tvae-playstyles",
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict,
            "active": list(self.active),
            "confusion": self.confusion.tolist(),
            "parts": [list(found) for found in self.parts],
            "assignment": self.assignment.tolist(),
            "probability": self.probability.tolist(),
            "styles": [_style_to_json(style) for style in self.styles],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Playstyles:
        """The playstyles that `to_json` wrote; `ValueError` for anything else."""
        if data.get("format") != "tvae-playstyles" or data.get("schema_version") != SCHEMA_VERSION:
            raise ValueError(
                f"needs format tvae-playstyles, schema version {SCHEMA_VERSION}, "
                f"got {data.get('format')!r}, version {data.get('schema_version')!r}"
            )
        active = tuple(int(feature) for feature in data["active"])
        alone = [[index] for index in range(len(data["styles"]))]
        return cls(
            tuple(_style_from_json(style, len(active)) for style in data["styles"]),
            np.array(data["assignment"], dtype=np.int64),
            np.array(data["probability"], dtype=np.float64),
            str(data["verdict"]),
            active,
            np.array(data["confusion"], dtype=np.float64),
            tuple(tuple(int(part) for part in parts) for parts in data.get("parts", alone)),
        )

    @classmethod
    def load(cls, directory: str | Path) -> Playstyles:
        """The playstyles in `playstyles.json` of a run's directory or of a shipped model's.

        Raises `ModelError` for a directory that has none, or a file that holds something else.
        """
        path = Path(directory) / "playstyles.json"
        if not path.is_file():
            raise ModelError(f"{directory} holds no playstyles: it has no playstyles.json")
        try:
            return cls.from_json(json.loads(path.read_text(encoding="utf-8"))["playstyles"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ModelError(f"{path} does not hold playstyles: {error}") from error

    @classmethod
    def from_pretrained(cls, name: str | Path, *, revision: str | None = None) -> Playstyles:
        """The styles of a model that comes with the package, lies in a directory, or in a repository of the Hub.

        Names are those of `tvae.TrajectoryVAE.from_pretrained`. Episodes (`assignment`, prototypes) are those of the
        demonstrations that the model was trained on. Raises `ModelError` for a name of nothing; the message says which
        names there are.

        >>> Playstyles.from_pretrained("chess")  # doctest: +ELLIPSIS
        Traceback (most recent call last):
        tvae.errors.ModelError: there is no model 'chess': ...
        """
        return cls.load(pretrained_directory(name, revision))


def _style_to_json(style: Style) -> dict[str, Any]:
    return {
        "name": style.name,
        "index": style.index,
        "weight": style.weight,
        "mean": style.mean.tolist(),
        "covariance": style.covariance.tolist(),
        "prototypes": list(style.prototypes),
        "members": {"means": style.members.means.tolist(), "scales": style.members.scales.tolist()},
        "components": {
            "weights": style.components.weights.tolist(),
            "means": style.components.means.tolist(),
            "covariances": style.components.covariances.tolist(),
        },
    }


def _style_from_json(data: Mapping[str, Any], num_active: int) -> Style:
    mean = np.array(data["mean"], dtype=np.float64)
    count, width = len(data["components"]["weights"]), len(mean)

    def array(values: Any, *shape: int) -> FloatArray:
        return np.array(values, dtype=np.float64).reshape(shape)

    return Style(
        index=int(data["index"]),
        weight=float(data["weight"]),
        mean=mean,
        covariance=array(data["covariance"], width, width),
        prototypes=tuple(int(episode) for episode in data["prototypes"]),
        members=Posteriors(
            array(data["members"]["means"], -1, width) if width else np.zeros((len(data["members"]["means"]), 0)),
            array(data["members"]["scales"], -1, width) if width else np.zeros((len(data["members"]["means"]), 0)),
        ),
        components=Components(
            array(data["components"]["weights"], count),
            array(data["components"]["means"], count, num_active),
            array(data["components"]["covariances"], count, num_active, num_active),
        ),
    )
