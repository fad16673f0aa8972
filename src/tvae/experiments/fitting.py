"""A fit in a run directory: configuration, training that can be killed and resumed, weights, history."""

from __future__ import annotations

import time
import warnings
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

import tvae
from tvae.config import RunConfig, TrainingConfig
from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations
from tvae.data.identity import identity
from tvae.experiments.arenas import Arena
from tvae.experiments.progress import together, watching
from tvae.experiments.run_directory import RunDirectory, RunDirectoryError, read_json, write_json
from tvae.experiments.source import Source
from tvae.experiments.tracking import Tracker
from tvae.fitting.amounts import Amounts
from tvae.fitting.fit import new_model
from tvae.fitting.refine import refine_policy
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import policy_windows
from tvae.train.checkpoint import Record
from tvae.train.diagnosis import TrainingWarning
from tvae.train.loop import MOST_JUDGED_STEPS, evaluate, train
from tvae.train.observer import Observer
from tvae.train.penalties import Penalty, StartIndependence, SwappedStart
from tvae.train.schedules import Budget, KLSchedule, Piecewise
from tvae.train.terms import Terms


@dataclass(frozen=True)
class About:
    """What a run is: enough to repeat it."""

    config: RunConfig
    source: Source
    arena: Arena | None
    title: str
    command: tuple[str, ...]


def begin(run: RunDirectory, demonstrations: Demonstrations, about: About) -> None:
    """Write `config.json`: what the run needs to be repeated, with the numbers that its demonstrations suggest."""
    about = replace(about, config=_decided(about.config, demonstrations))
    model = new_model(demonstrations, seed=about.config.seed, device="cpu", **asdict(about.config.model))
    facts = {
        "tvae": tvae.__version__,
        "torch": torch.__version__,
        "demonstrations": {
            "episodes": len(demonstrations),
            "steps": demonstrations.num_steps,
            "identity": identity(demonstrations),
        },
    }
    write_json(run.config, {**model.description(), "run": {**asdict(about), **facts}})


def about_run(run: RunDirectory) -> About:
    """What `begin` wrote; `RunDirectoryError` for a directory that no run made."""
    about = read_json(run.config).get("run")
    if not isinstance(about, dict):
        raise RunDirectoryError(f"{run.config} does not describe a run: a model was saved there, not fitted")
    try:
        source, arena = about["source"], about["arena"]
        return About(
            config=RunConfig.from_json(about["config"]),
            source=Source.from_json(source),
            arena=None if arena is None else Arena(**arena),
            title=about["title"],
            command=tuple(about["command"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise RunDirectoryError(f"{run.config} does not describe a run of this version: {error}") from error


def demonstrations_of(run: RunDirectory) -> Demonstrations:
    """The demonstrations that a run was fitted to, read again.

    Raises `RunDirectoryError` where they are no longer the same: its styles, its test episodes and what it held out are
    of those that it knew.
    """
    source, known = about_run(run).source, read_json(run.config)["run"].get("demonstrations", {})
    demonstrations = source.load()
    there = identity(demonstrations)
    if known.get("identity", there) != there:
        raise RunDirectoryError(
            f"{source.path} has changed since {run.path} was fitted to it: it had {known['identity']}, "
            f"and has {there}. Put back what was there, or fit anew"
        )
    return demonstrations


def split(demonstrations: Demonstrations, config: RunConfig) -> tuple[Demonstrations, Demonstrations]:
    """Training and held-out demonstrations of a run; the same each time."""
    return demonstrations.split(config.training.held_out, seed=config.seed, group=config.group)


def _decided(config: RunConfig, demonstrations: Demonstrations) -> RunConfig:
    amounts = amounts_of(config, split(demonstrations, config)[0])
    training = replace(config.training, num_steps=amounts.num_steps, batch_size=amounts.batch_size)
    return replace(config, training=training, policy=replace(config.policy, num_steps=amounts.policy_steps))


def amounts_of(config: RunConfig, training: Demonstrations) -> Amounts:
    """Batch size and both numbers of steps, as a configuration asks or as these training demonstrations suggest."""
    return Amounts.of(
        training.lengths,
        batch_size=config.training.batch_size,
        num_steps=config.training.num_steps,
        policy_steps=config.policy.num_steps,
    )


def fit_run(
    run: RunDirectory,
    demonstrations: Demonstrations,
    about: About,
    *,
    device: str,
    console: Console,
    trackers: Sequence[Tracker] = (),
) -> TrajectoryVAE:
    """Train in `run`, from its checkpoint if there is one, and leave weights, history and training metrics.

    `trackers` are told of all evaluations, those before a kill too.
    """
    config = about.config
    parts = split(demonstrations, config)
    amounts = amounts_of(config, parts[0])
    began = time.perf_counter()
    with (
        warnings.catch_warnings(record=True, category=TrainingWarning) as warned,
        ExitStack() as stack,
    ):
        tracked = [stack.enter_context(tracker.watching(about.title, config.to_json())) for tracker in trackers]
        shown = stack.enter_context(watching(amounts, run.tensorboard, console))
        warnings.simplefilter("always", TrainingWarning)
        model, records = trained(
            demonstrations,
            config,
            checkpoint=run.checkpoint,
            device=device,
            observer=together([shown, *tracked]),
        )
    words = [str(warning.message) for warning in warned]
    for sentence in words:
        console.print(f"Warning: {sentence}", style="yellow", markup=False)
    seconds = time.perf_counter() - began
    write_json(run.history, [asdict(record) for record in records])
    terms = {
        name: asdict(_terms(model, part, batch_size=amounts.batch_size, seed=config.seed))
        for name, part in zip(("training", "held_out"), parts, strict=True)
    }
    update_metrics(
        run,
        {
            "train_seconds": seconds,
            "train_steps": records[-1].step,
            "warnings": words,
            "nats_per_trajectory": terms,
        },
    )
    model.save_weights(run.model)
    return model


def _terms(model: TrajectoryVAE, demonstrations: Demonstrations, *, batch_size: int, seed: int) -> Terms:
    some = evenly(demonstrations, MOST_JUDGED_STEPS)
    return evaluate(model, some, policy_windows, batch_size=batch_size, seed=seed)


def trained(
    demonstrations: Demonstrations, config: RunConfig, *, checkpoint: Path, device: str, observer: Observer
) -> tuple[TrajectoryVAE, tuple[Record, ...]]:
    """The model of a configuration, trained on all but its held-out demonstrations, and its evaluations.

    The steps of the policy alone follow, if the configuration has any (`tvae.fitting.refine`); the evaluations
    are those before.
    """
    training, held_out = split(demonstrations, config)
    model = new_model(demonstrations, seed=config.seed, device=device, **asdict(config.model))
    settings, amounts = config.training, amounts_of(config, training)
    records = train(
        model,
        training,
        held_out,
        schedule=schedule_of(settings),
        num_steps=amounts.num_steps,
        batch_size=amounts.batch_size,
        learning_rate=settings.learning_rate,
        clip=settings.clip,
        state_weight=settings.state_weight,
        shortest_window=settings.shortest_window,
        penalties=penalties_of(settings),
        evaluate_every=settings.evaluate_every,
        patience=settings.patience,
        seed=config.seed,
        checkpoint=checkpoint,
        observer=observer,
    )
    if amounts.policy_steps:
        refine_policy(
            model,
            training,
            held_out,
            num_steps=amounts.policy_steps,
            batch_size=config.policy.batch_size,
            learning_rate=config.policy.learning_rate,
            seed=config.seed,
            observer=observer,
        )
    return model, records


def schedule_of(settings: TrainingConfig) -> KLSchedule:
    """The weight of the KL term; `ValueError` for a budget that is no positive number of nats, or points out of order.

    >>> schedule_of(TrainingConfig(kl_budget=0.8))
    Budget(nats=0.8, begin=0.3, rate=0.01, lowest=0.1, highest=100.0)
    """
    return Piecewise(settings.kl_points) if settings.kl_budget is None else Budget(settings.kl_budget)


def penalties_of(settings: TrainingConfig) -> tuple[Penalty, ...]:
    """Those whose weight is not 0; `ValueError` for a weight that is no number of at least 0.

    >>> penalties_of(TrainingConfig(swapped_start=0.5))
    (SwappedStart(weight=0.5),)
    """
    independence = (StartIndependence(settings.start_independence),) if settings.start_independence else ()
    swapped = (SwappedStart(settings.swapped_start),) if settings.swapped_start else ()
    return (*independence, *swapped)


def history(run: RunDirectory) -> tuple[Record, ...]:
    """The evaluations during a run's training; `RunDirectoryError` where they are missing or damaged."""
    try:
        return tuple(
            Record(r["step"], r["beta"], Terms(**r["training"]), Terms(**r["held_out"])) for r in read_json(run.history)
        )
    except (KeyError, TypeError) as error:
        raise RunDirectoryError(f"{run.history} is not whole: {error!r}") from error


def known_metrics(run: RunDirectory) -> dict[str, Any]:
    """What `metrics.json` holds so far; `RunDirectoryError` where it is damaged."""
    found = read_json(run.metrics) if run.metrics.exists() else {}
    if not isinstance(found, dict):
        raise RunDirectoryError(f"{run.metrics} is not whole: it needs names with numbers, got {type(found).__name__}")
    return found


def update_metrics(run: RunDirectory, new: Mapping[str, Any], *, dropping: Collection[str] = ()) -> dict[str, Any]:
    """Add to `metrics.json`, replacing what has the same name, without what is dropped; returns all of it."""
    before = known_metrics(run)
    metrics = {**{name: value for name, value in before.items() if name not in dropping}, **new}
    write_json(run.metrics, metrics)
    return metrics
