"""The page of a run, from what its directory holds."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from platform import python_version
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from matplotlib.axes import Axes

import tvae
from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import load_demonstrations
from tvae.data.table_sets import is_pattern
from tvae.data.trajectory import Trajectory
from tvae.evaluate.styles import Style
from tvae.experiments.arenas import knowledge_of
from tvae.experiments.findings import Findings, read_findings
from tvae.experiments.fitting import About, about_run, history
from tvae.experiments.run_directory import RunDirectory, RunDirectoryError, read_json
from tvae.figures.lanes import Scales
from tvae.figures.palette import style_colour
from tvae.figures.trajectories import draw_trajectory
from tvae.report.content import ReportContent, StyleSection
from tvae.report.page import write


def write_report(run: RunDirectory, demonstrations: Demonstrations) -> None:
    """Write `report.html` from the files of the run and the demonstrations that it was fitted to."""
    about = about_run(run)
    findings = read_findings(run.playstyles)
    playstyles = findings.playstyles
    table = _styles(run, len(demonstrations))
    means = [table[name].to_numpy() for name in table.column_names if name.startswith("z_")]
    scales = Scales.of(demonstrations)
    metrics, now = findings.shown(_metrics(run)), datetime.now(UTC)
    content = ReportContent(
        title=_name_of_data(run, about),
        run=run.path.resolve().name,
        verdict=playstyles.verdict,
        demonstrations=demonstrations,
        episode_ids=tuple(str(episode) for episode in table["episode"].to_pylist()),
        latent_means=np.stack(means, axis=1) if means else np.zeros((len(demonstrations), 0)),
        assignment=table["style"].to_numpy(),
        probability=table["probability"].to_numpy(),
        styles=tuple(
            _section(run, about, demonstrations, findings, style, scales) for style in playstyles.styles
        ),
        command=shlex.join(["tvae", *about.command[1:]]),
        version=tvae.__version__,
        created=f"{now.day} {now:%B %Y, %H:%M} UTC",
        warnings=tuple(metrics.get("warnings", ())),
        metrics={name: value for name, value in metrics.items() if name != "warnings"},
        records=history(run),
        config=about.config.to_json(),
        versions={"Python": python_version(), "torch": torch.__version__, "gymnasium": version("gymnasium")},
    )
    write(content, run.report)


def _styles(run: RunDirectory, count: int) -> pa.Table:
    """The rows of `styles.parquet`; `RunDirectoryError` where it is not one for each of `count` sessions."""
    needed = {"episode", "style", "probability"}
    try:
        table = pq.read_table(run.styles)
    except (pa.ArrowException, OSError) as error:
        raise RunDirectoryError(f"{run.styles} is not whole: {error}") from error
    if not needed <= set(table.column_names) or len(table) != count:
        raise RunDirectoryError(
            f"{run.styles} needs the columns {', '.join(sorted(needed))} and a row for each of {count} sessions, "
            f"got {len(table)} rows of {', '.join(table.column_names)}"
        )
    return table


def _metrics(run: RunDirectory) -> dict[str, Any]:
    """What `metrics.json` holds; `RunDirectoryError` where that is nothing of styles."""
    metrics = read_json(run.metrics)
    if not isinstance(metrics, dict) or not isinstance(metrics.get("playstyles"), dict):
        raise RunDirectoryError(f"{run.metrics} is not whole: it has no playstyles")
    return metrics


def _name_of_data(run: RunDirectory, about: About) -> str:
    """The task's title where the run made its demonstrations itself, else the name of their file or data set."""
    path = Path(about.source.path)
    if path == run.demonstrations.resolve():
        return about.title
    if not path.is_absolute():
        return about.source.path
    return "/".join(path.parts[-2:]) if is_pattern(path.name) else path.name


def _section(
    run: RunDirectory,
    about: About,
    demonstrations: Demonstrations,
    findings: Findings,
    style: Style,
    scales: Scales,
) -> StyleSection:
    label = findings.labels.get(style.index)
    episodes, succeeded = None, None
    knowledge = None if about.arena is None else knowledge_of(about.arena.env)
    if knowledge is not None and run.rollouts(style.index).exists():
        episodes = load_demonstrations(run.rollouts(style.index))
        outcomes = knowledge.success(episodes)
        succeeded = outcomes.get(label or style.name, outcomes.get("all"))
    special = None if knowledge is None else knowledge.draw
    colour = style_colour(style.index)

    def draw(axes: Axes, episode: Trajectory) -> None:
        if special is not None:
            special(axes, episode, colour)
        else:
            draw_trajectory(
                axes, episode, demonstrations.observation_space, demonstrations.action_space, colour, scales
            )

    return StyleSection(
        name=style.name,
        weight=style.weight,
        draw=draw,
        label=findings.names.get(style.index, label),
        sentences=findings.words[style.index],
        prototypes=style.prototypes,
        test_episodes=episodes,
        succeeded=succeeded,
    )
