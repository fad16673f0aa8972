"""A run from beginning to end: train, discover, describe, try the bots, write the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.data.hints import hints
from tvae.data.issues import Issue
from tvae.data.sources import save_demonstrations
from tvae.data.validation import summarise
from tvae.device import resolve_device
from tvae.errors import TvaeError
from tvae.experiments.analysis import analyse
from tvae.experiments.arenas import Arena
from tvae.experiments.bots import check_arena, try_bots
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import (
    About,
    about_run,
    begin,
    demonstrations_of,
    fit_run,
    penalties_of,
    schedule_of,
    split,
)
from tvae.experiments.parallel import named_again
from tvae.experiments.recipe import Recipe
from tvae.experiments.remedies import doubts, hinted
from tvae.experiments.reporting import write_report
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.source import Source
from tvae.experiments.tables import signals_table
from tvae.experiments.tracking import Tracker
from tvae.fitting.fit import new_model


@dataclass(frozen=True, eq=False)
class Begun:
    """A run whose directory is there, and its demonstrations."""

    run: RunDirectory
    demonstrations: Demonstrations
    hints: tuple[Issue, ...] = ()
    """What its user may have forgotten to say of them."""


def new_run(
    out: Path,
    source: Source,
    config: RunConfig,
    arena: Arena | None,
    *,
    command: Sequence[str],
    device: str,
    force: bool,
) -> Begun:
    """A run directory that holds all that `complete` needs; everything is checked before it is made."""
    source = source.absolute()
    demonstrations, decided = source.read()
    _check(demonstrations, config, device)
    if arena is not None:
        check_arena(arena, demonstrations.observation_space, demonstrations.action_space)
    if Path(source.path).is_relative_to(out.absolute()):
        raise TvaeError(f"{out} holds what is to be read, {source.path}; choose another --out")
    run = RunDirectory.create(out, force=force)
    begin(run, demonstrations, About(config, source, arena, out.name, tuple(command)))
    return Begun(run, demonstrations, tuple(hints(demonstrations, decided)))


def new_recipe_run(out: Path, recipe: Recipe, *, command: Sequence[str], device: str, force: bool) -> Begun:
    """The same for a task of ours, whose demonstrations are kept in the run directory."""
    demonstrations = recipe.demonstrations()
    _check(demonstrations, recipe.config, device)
    run = RunDirectory.create(out, force=force)
    save_demonstrations(demonstrations, run.demonstrations)
    source = Source(str(run.demonstrations.resolve()))
    begin(run, demonstrations, About(recipe.config, source, recipe.arena, recipe.title, tuple(command)))
    return Begun(run, demonstrations)


def resumed_run(out: Path, env: str | None = None) -> Begun:
    """A run that began earlier; `TvaeError` where its environment is code of its own and `env` does not name it."""
    run = RunDirectory.existing(out)
    about = about_run(run)
    if about.arena is not None:
        named_again(about.arena, env)
    return Begun(run, demonstrations_of(run))


def _check(demonstrations: Demonstrations, config: RunConfig, device: str) -> None:
    """Raise `TvaeError` for a training that cannot be, before anything of it is written."""
    resolve_device(device)
    try:
        config.check()
        split(demonstrations, config)
        schedule_of(config.training)
        penalties_of(config.training)
        new_model(demonstrations, seed=config.seed, device="cpu", **asdict(config.model))
    except TvaeError:
        raise
    except (ValueError, RuntimeError) as error:
        raise TvaeError(f"this training cannot be: {error}") from error


def complete(begun: Begun, *, device: str, console: Console, trackers: Sequence[Tracker] = ()) -> None:
    """Do all that is left of a run: training goes on from the last checkpoint, the rest is done anew."""
    run, demonstrations = begun.run, begun.demonstrations
    about = about_run(run)
    summary = summarise(demonstrations)
    console.print(f"{summary.num_episodes} episodes, {summary.num_steps} steps, taken for:")
    console.print(signals_table(summary))
    for doubt in doubts(summary):
        console.print(doubt, style="yellow", highlight=False, markup=False)
    for hint in hinted(begun.hints):
        console.print(hint, highlight=False, markup=False)
    if about.source.reading.left_over is not None:
        console.print(about.source.reading.left_over, highlight=False, markup=False)
    model = fit_run(run, demonstrations, about, device=device, console=console, trackers=trackers)
    findings = analyse(run, model, demonstrations, about.config, console=console)
    _say(findings, console)
    if about.arena is not None:
        try_bots(run, model, findings, about.arena, seed=about.config.seed, console=console)
    write_report(run, demonstrations)
    console.print(f"report: {run.report}", highlight=False, markup=False)


def _say(findings: Findings, console: Console) -> None:
    console.print(findings.playstyles.verdict, highlight=False, markup=False)
    for style in findings.playstyles.styles:
        words = "; ".join(findings.words[style.index])
        console.print(f"{findings.title(style)}: {words}", markup=False, highlight=False)
    if findings.explanation:
        console.print(findings.explanation, highlight=False)
