"""A run on the Hugging Face Hub: its model, its styles, and a card that says what they are."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import tvae
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.experiments.arenas import Arena
from tvae.experiments.run_directory import read_json
from tvae.experiments.shipping import ship
from tvae.experiments.using import FinishedRun
from tvae.hub import Result, check_repository, model_card, upload
from tvae.report.card import CardContent, CardStyle, Measurement, Trial, card_page
from tvae.report.meanings import MEANING_OF_A_MEASURE, MEANINGS, MEANINGS_OF_BOTS
from tvae.spaces import describe


def measurements(metrics: Mapping[str, Any]) -> Iterator[Measurement]:
    """What a card shows of `metrics.json`.

    >>> [(row.metric, row.value) for row in measurements({"active_units": 2, "train_seconds": 7.5})]
    [('active_units', 2)]
    """
    for path, meaning in MEANINGS.items():
        value: Any = metrics
        for part in path.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        if isinstance(value, Mapping):
            low, high = value["ci95"]
            yield Measurement(path, value["mean"], meaning, interval=(low, high))
        elif value is not None:
            yield Measurement(path, value, meaning)
    for metric, intervals in metrics.get("ci95", {}).items():
        for style, (low, high) in intervals.items():
            meaning = MEANINGS_OF_BOTS.get(metric, MEANING_OF_A_MEASURE)
            yield Measurement(metric, metrics[metric][style], meaning, style, (low, high))


def card(run: FinishedRun, repo_id: str, *, license: str | None) -> str:
    """The model card of a run that is published as `repo_id`; without a license it says that none is stated.

    Raises `HubError` for a name that is not `owner/name`, or without the extra `hub`.
    """
    check_repository(repo_id)
    about, model, findings = run.about, run.model, run.findings
    metrics = findings.shown(read_json(run.directory.metrics))
    size = read_json(run.directory.config)["run"]["demonstrations"]
    spaces = ((OBSERVATION, model.observation_space), (ACTION, model.action_space))
    measured = tuple(measurements(metrics))
    tried_in = metrics.get("test_environment")
    content = CardContent(
        title=about.title,
        repository=repo_id,
        verdict=findings.playstyles.verdict,
        styles=tuple(
            CardStyle(findings.title(style), style.weight, findings.words[style.index])
            for style in findings.playstyles.styles
        ),
        labelled=bool(findings.labels.keys() - findings.names.keys()),
        num_episodes=size["episodes"],
        num_steps=size["steps"],
        held_out=about.config.training.held_out,
        signals=tuple((prefix + s.name, describe(s)) for prefix, space in spaces for s in space.signals),
        measurements=measured,
        test=None if tried_in is None else Trial(tried_in, metrics["test_episodes"]),
        warnings=tuple(metrics.get("warnings", ())),
        command=shlex.join(["tvae", *about.command[1:]]),
        version=tvae.__version__,
        seed=about.config.seed,
        environment=None if about.arena is None else _call(about.arena),
        license=license,
    )
    results = [
        Result(
            row.metric,
            f"{row.metric}, {row.style}" if row.style else row.metric,
            row.value,
            tried_in if row.style and tried_in is not None else about.title,
        )
        for row in measured
    ]
    return model_card(card_page(content), name=about.title, license=license, results=results)


def _call(arena: Arena) -> str:
    options = "".join(f", {name}={value!r}" for name, value in arena.options.items())
    return f"gymnasium.make({arena.env!r}{options})"


def write_folder(run: FinishedRun, directory: Path, repo_id: str, *, license: str | None) -> None:
    """Write what `publish` uploads, whole or not at all; `FileExistsError` for a directory that exists."""
    ship(run.model, run.findings, directory, card(run, repo_id, license=license))


def publish(run: FinishedRun, repo_id: str, *, license: str | None, private: bool) -> str:
    """Upload a run's model, styles and card to `owner/name`, and return its address; `HubError` says what failed."""
    with TemporaryDirectory() as parent:
        directory = Path(parent) / "model"
        write_folder(run, directory, repo_id, license=license)
        return upload(directory, repo_id, private=private, message=f"{run.about.title}: model, playstyles and card")
