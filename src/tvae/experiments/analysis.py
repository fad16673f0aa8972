"""After training: styles, labels, words, and the table with one row per episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from rich.console import Console

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.errors import TvaeError
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.leakage import FEWEST_EPISODES, leakage
from tvae.evaluate.likelihood import importance_weighted_bound
from tvae.evaluate.playstyles import find_playstyles, join, label_agreement, match
from tvae.evaluate.styles import Playstyles
from tvae.evaluate.words import describe
from tvae.experiments.findings import Findings, read_findings
from tvae.experiments.fitting import update_metrics
from tvae.experiments.run_directory import RunDirectory, write_json
from tvae.experiments.targets import write_table
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray

SAMPLES_FOR_TABLE = 4
MOST_LIKELIHOODS = 100_000
"""Sessions whose likelihood stands in the table; of more, evenly spaced ones."""
_MOST_TOLD = 20_000
"""Sessions that are asked what z tells of their first observation; of more, evenly spaced ones."""


def analyse(
    run: RunDirectory,
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    config: RunConfig,
    *,
    joined: Sequence[Sequence[int]] | None = None,
    console: Console,
) -> Findings:
    """Find and describe the styles of all demonstrations; writes `playstyles.json`, `styles.parquet`, metrics.

    Found styles that a group of `joined` names are made one; None for those that the run has joined already. Training
    never sees the attribute `label`; where it is there, it names the styles and judges them. Raises `TvaeError` where
    styles are to be joined that are not found again, as on another machine may be.
    """
    posteriors = encode(model, demonstrations)
    found = find_playstyles(posteriors, seed=config.seed)
    before = _before(run, found, posteriors)
    if joined and before is None:
        again = f"tvae fit --resume --out {run.path}"
        raise TvaeError(f"{run.path} holds other styles than are found here; find them anew: {again}")
    groups = _joined(before) if joined is None else joined
    playstyles = join(found, posteriors, groups, seed=config.seed) if groups else found
    labels = names_of(playstyles, demonstrations)
    words = describe(demonstrations, playstyles.assignment)
    findings = Findings(playstyles, labels, words, _names_kept(before, playstyles))
    likelihood = likelihood_per_step(model, demonstrations, seed=config.seed, console=console)
    table = styles_table(
        demonstrations, posteriors, playstyles.assignment, playstyles.probability, likelihood=likelihood
    )
    write_table(table, run.styles, overwrite=True)
    write_json(run.playstyles, findings.to_json())
    held = _latent(model, posteriors, playstyles, demonstrations, config.seed)
    update_metrics(run, {"playstyles": _metrics(findings, demonstrations), **held}, dropping=["leakage"])
    return findings


def _before(run: RunDirectory, found: Playstyles, posteriors: Posteriors) -> Findings | None:
    """What an earlier analysis of the run left, where it found the same styles."""
    if not run.playstyles.exists():
        return None
    before = read_findings(run.playstyles)
    groups = _joined(before)
    if max((part for group in groups for part in group), default=0) >= len(found):
        return None
    again = join(found, posteriors, groups) if groups else found
    return before if np.array_equal(before.playstyles.assignment, again.assignment) else None


def _joined(findings: Findings | None) -> list[tuple[int, ...]]:
    """The groups of found styles that are one."""
    return [] if findings is None else [parts for parts in findings.playstyles.parts if len(parts) > 1]


def _names_kept(before: Findings | None, playstyles: Playstyles) -> Mapping[int, str]:
    """The user's names of the styles that are of the same parts as before."""
    if before is None:
        return {}
    names = {before.playstyles.parts[index]: name for index, name in before.names.items()}
    return {index: names[parts] for index, parts in enumerate(playstyles.parts) if parts in names}


def likelihood_per_step(
    model: TrajectoryVAE, demonstrations: Demonstrations, *, seed: int, console: Console
) -> FloatArray:
    """(E,) in nats, NaN where it was not computed: of very many episodes, it is for evenly spaced ones only."""
    some = _evenly(len(demonstrations), MOST_LIKELIHOODS)
    if len(some) < len(demonstrations):
        console.print(
            f"log_likelihood_per_step is computed for {len(some):,} of {len(demonstrations):,} sessions, evenly "
            "spaced; `tvae score` computes it for any.",
            highlight=False,
        )
    chosen = demonstrations.select(some)
    bound = importance_weighted_bound(model, chosen, num_samples=SAMPLES_FOR_TABLE, seed=seed)
    likelihood = np.full(len(demonstrations), np.nan)
    likelihood[some] = bound.total / chosen.lengths
    return likelihood


def _evenly(count: int, most: int) -> IntArray:
    """Positions of all of `count`, or of about `most` evenly spaced ones."""
    return np.arange(0, count, -(-count // most))


def names_of(playstyles: Playstyles, demonstrations: Demonstrations) -> dict[int, str]:
    """The label that more than half of a style's episodes carry; where two styles share one, they get none."""
    if "label" not in demonstrations.attributes:
        return {}
    labels = demonstrations.attributes["label"].astype(str)
    most = match(playstyles.assignment, labels)
    return {
        style: label
        for style, label in most.items()
        if list(most.values()).count(label) == 1 and (labels[playstyles.assignment == style] == label).mean() > 0.5
    }


def _metrics(findings: Findings, demonstrations: Demonstrations) -> dict[str, object]:
    playstyles = findings.playstyles
    metrics: dict[str, object] = {
        "num_found": len(playstyles),
        "verdict": playstyles.verdict,
        "shares": {findings.key(style): style.weight for style in playstyles.styles},
    }
    if "label" in demonstrations.attributes:
        labels = demonstrations.attributes["label"]
        metrics["ari"] = label_agreement(playstyles.assignment, labels)
    return metrics


def _latent(
    model: TrajectoryVAE, posteriors: Posteriors, playstyles: Playstyles, demonstrations: Demonstrations, seed: int
) -> dict[str, object]:
    """What z holds beside the style: `leakage` tells of the first observation within a style.

    Left out for a model without z, and where no style has episodes enough to tell.
    """
    held: dict[str, object] = {"active_units": len(playstyles.active)}
    some = _evenly(len(demonstrations), _MOST_TOLD)
    posteriors, demonstrations = posteriors.select(some), demonstrations.select(some)
    styles = playstyles.assignment[some]
    largest = np.bincount(styles).max()
    if model.latent_features == 0 or largest < FEWEST_EPISODES:
        return held
    starts = torch.as_tensor(demonstrations.observations[demonstrations.observation_starts], dtype=torch.float32)
    normalizer = model.observation_normalizer
    facts = normalizer.features(normalizer.values(starts.to(model.device))).cpu().double().numpy()
    told = leakage(posteriors, facts, styles, seed=seed)
    names = {"start_r2": told.from_sample.r2, "start_r2_from_mean": told.from_mean.r2}
    nats = {"start_nats": told.from_sample.nats, "start_nats_from_mean": told.from_mean.nats}
    return {**held, "leakage": {**names, **nats}}


def episode_names(demonstrations: Demonstrations) -> NDArray[Any]:
    """(E,) the attribute `episode`; where there is none, positions."""
    return demonstrations.attributes.get("episode", np.arange(len(demonstrations)))


def styles_table(
    demonstrations: Demonstrations,
    posteriors: Posteriors,
    assignment: IntArray,
    probability: FloatArray,
    *,
    likelihood: FloatArray,
) -> pa.Table:
    """One row per episode: `episode`, `style`, `probability`, `z_0` ..., `log_likelihood_per_step`.

    The last is `likelihood` in nats, empty where NaN.
    """
    latents = {f"z_{index}": values for index, values in enumerate(posteriors.means.T)}
    return pa.table(
        {
            "episode": episode_names(demonstrations),
            "style": assignment,
            "probability": probability,
            **latents,
            "log_likelihood_per_step": pa.array(likelihood, from_pandas=True),
        }
    )
