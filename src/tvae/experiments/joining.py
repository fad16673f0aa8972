"""Styles of a run that a user makes one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rich.console import Console

from tvae.errors import TvaeError
from tvae.experiments.analysis import analyse
from tvae.experiments.bots import try_bots
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import demonstrations_of, update_metrics
from tvae.experiments.parallel import named_again
from tvae.experiments.reporting import write_report
from tvae.experiments.run_directory import read_json
from tvae.experiments.using import FinishedRun


def groups_with(given: Sequence[str], findings: Findings) -> list[tuple[int, ...]]:
    """The groups of found styles that are one when these styles, by their numbers, names or labels, are made one.

    Raises `TvaeError` for fewer than two styles, or one that is not there.
    """
    chosen = {style.index for style in findings.several(given)}
    if len(chosen) < 2:
        raise TvaeError(f"--join needs two styles or more, such as --join 0 2, got {' '.join(given)}")
    parts = findings.playstyles.parts
    others = [group for index, group in enumerate(parts) if index not in chosen and len(group) > 1]
    return [tuple(sorted(part for index in chosen for part in parts[index])), *others]


def rejoin(
    run: FinishedRun, groups: Sequence[Sequence[int]], env: str | None, *, console: Console
) -> FinishedRun:
    """The run with these groups of found styles made one, and no others.

    All that follows from the styles is done anew: labels, words, `styles.parquet`, numbers, the bots' test episodes
    where the run has an environment, and the page. `TvaeError` before anything is written where that environment is
    code of its own and `env` does not name it.
    """
    arena = None if run.about.arena is None else named_again(run.about.arena, env)
    demonstrations = demonstrations_of(run.directory)
    config = run.about.config
    findings = analyse(run.directory, run.model, demonstrations, config, joined=groups, console=console)
    update_metrics(run.directory, {}, dropping=_of_styles(read_json(run.directory.metrics), run.findings))
    for style in run.findings.playstyles.styles:
        run.directory.rollouts(style.index).unlink(missing_ok=True)
    if arena is not None:
        try_bots(run.directory, run.model, findings, arena, seed=config.seed, console=console)
    write_report(run.directory, demonstrations)
    return replace(run, findings=findings)


def _of_styles(metrics: Mapping[str, Any], findings: Findings) -> list[str]:
    """Names of the metrics that have a number for each style."""
    keys = {findings.key(style) for style in findings.playstyles.styles}
    return ["ci95", *(name for name, value in metrics.items() if isinstance(value, Mapping) and value.keys() <= keys)]
