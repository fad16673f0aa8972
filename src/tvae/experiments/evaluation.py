"""Does z earn its place? The same model, trained again without it, on the same held-out demonstrations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rich.console import Console

from tvae.evaluate.likelihood import importance_weighted_bound, paired_difference
from tvae.experiments.fitting import amounts_of, demonstrations_of, known_metrics, split, trained, update_metrics
from tvae.experiments.progress import watching
from tvae.experiments.using import FinishedRun


def compare_without_latent(
    run: FinishedRun, *, num_samples: int, device: str, console: Console
) -> dict[str, Any]:
    """Held-out likelihood with z, by the importance-weighted bound, against the model retrained without z.

    Adds `held_out_likelihood` to `metrics.json`, in nats per trajectory: both means, and the mean of the paired
    difference with its 95 % interval, over groups where the run holds groups out, else over episodes. The bound
    counts the divergence from the prior, so that z must pay for what it tells.
    """
    known_metrics(run.directory)  # what is damaged is refused before the training, not after it
    about = run.about
    demonstrations = demonstrations_of(run.directory)
    training, held_out = split(demonstrations, about.config)
    config = replace(about.config, model=replace(about.config.model, latent_features=0))
    directory = run.directory.path / "without_latent"
    directory.mkdir(exist_ok=True)
    with watching(amounts_of(config, training), directory / "tensorboard", console) as observer:
        plain, _ = trained(
            demonstrations, config, checkpoint=directory / "checkpoint.safetensors", device=device, observer=observer
        )
    seed = about.config.seed
    with_z = importance_weighted_bound(run.model, held_out, num_samples=num_samples, seed=seed)
    without = importance_weighted_bound(plain, held_out, num_samples=1, seed=seed)
    groups = None if about.config.group is None else held_out.attribute(about.config.group)
    total = paired_difference(with_z.total, without.total, groups=groups)
    actions = paired_difference(with_z.actions, without.actions, groups=groups)
    return update_metrics(
        run.directory,
        {
            "held_out_likelihood": {
                "with_latent": float(with_z.total.mean()),
                "without_latent": float(without.total.mean()),
                "difference": {"mean": total.mean, "ci95": list(total.interval)},
                "difference_of_actions": {"mean": actions.mean, "ci95": list(actions.interval)},
                "episodes": len(held_out),
                "samples": num_samples,
            }
        },
    )
