"""A run from beginning to end: train, discover, describe, try the bots, write the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tvae.config import RunConfig
from tvae.data.sources import save_demonstrations
from tvae.experiments.analysis import analyse
from tvae.experiments.arenas import Arena
from tvae.experiments.bots import try_bots
from tvae.experiments.fitting import About, about_run, begin, fit_run
from tvae.experiments.recipe import Recipe
from tvae.experiments.reporting import write_report
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.source import Source


def new_run(
    out: Path,
    source: Source,
    config: RunConfig,
    arena: Arena | None,
    *,
    command: Sequence[str],
    force: bool,
) -> RunDirectory:
    """A run directory that holds all that `complete` needs; the demonstrations are read and checked first."""
    source = source.absolute()
    demonstrations = source.load()
    run = RunDirectory.create(out, force=force)
    begin(run, demonstrations, About(config, source, arena, out.name, tuple(command)))
    return run


def new_recipe_run(out: Path, recipe: Recipe, *, command: Sequence[str], force: bool) -> RunDirectory:
    """The same for a task of ours, whose demonstrations are kept in the run directory."""
    demonstrations = recipe.demonstrations()
    run = RunDirectory.create(out, force=force)
    save_demonstrations(demonstrations, run.demonstrations)
    source = Source(str(run.demonstrations.resolve()))
    begin(run, demonstrations, About(recipe.config, source, recipe.arena, recipe.title, tuple(command)))
    return run


def complete(run: RunDirectory, *, device: str, console: Console) -> None:
    """Do all that is left of a run: training goes on from the last checkpoint, the rest is done anew."""
    about = about_run(run)
    demonstrations = about.source.load()
    model = fit_run(run, demonstrations, about.config, device=device, console=console)
    playstyles = analyse(run, model, demonstrations, about.config, console=console)
    if about.arena is not None:
        try_bots(run, model, playstyles, about.arena, seed=about.config.seed, console=console)
    write_report(run, demonstrations)
    console.print(f"report: {run.report}")
