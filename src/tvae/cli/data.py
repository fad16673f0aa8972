"""`tvae data`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from rich.markup import escape

from tvae.cli.options import COLUMNS, CONSOLE, Columns, Force, Seed
from tvae.data.hints import hints
from tvae.data.sources import save_demonstrations
from tvae.data.validation import examine_source, summarise
from tvae.experiments.remedies import doubts, hinted, options_for
from tvae.experiments.source import Source
from tvae.experiments.tables import signals_table
from tvae.experiments.targets import check_demonstrations
from tvae.experiments.tasks import TASKS
from tvae.figures.canvas import save
from tvae.figures.overview import draw_overview


def info(data: str, *, columns: Columns = COLUMNS, out: Path | None = None) -> None:
    """Show what is in a data set: episodes, lengths, what each column was taken for.

    Parameters
    ----------
    data
        A table (Parquet, CSV, HDF5), a pattern of files, a directory, or a Minari id.
    out
        Directory for overview.png and overview.svg: lengths, the distribution of every signal, a few episodes.
    """
    demonstrations, decided = Source(data, columns).read()
    summary = summarise(demonstrations)
    shortest, _, median, _, longest = summary.length_quantiles
    CONSOLE.print(
        f"{summary.num_episodes} episodes, {summary.num_steps} steps; "
        f"{shortest:.0f} to {longest:.0f} steps an episode, median {median:.0f}; "
        f"the observation after the last action is known in {summary.num_final_observed}"
    )
    CONSOLE.print(signals_table(summary))
    for doubt in doubts(summary):
        CONSOLE.print(doubt, style="yellow", highlight=False, markup=False)
    for hint in hinted(hints(demonstrations, decided)):
        CONSOLE.print(hint, highlight=False, markup=False)
    if columns.left_over is not None:
        CONSOLE.print(columns.left_over, highlight=False, markup=False)
    for attribute in summary.attributes:
        values = ", ".join(f"{value} ({count})" for value, count in attribute.counts[:8])
        CONSOLE.print(f"{attribute.name}: {attribute.num_values} values: {values}", highlight=False, markup=False)
    if summary.steps:
        CONSOLE.print(f"further columns: {', '.join(summary.steps)}", highlight=False, markup=False)
    if out is not None:
        overview = draw_overview(demonstrations)
        save(overview, out / "overview")
        shown = f" shows {overview.get_suptitle()}" if overview.get_suptitle() else ""
        CONSOLE.print(f"pictures: {out / 'overview.png'}{shown}", highlight=False, markup=False)


def validate(data: str, *, columns: Columns = COLUMNS) -> None:
    """List everything that is wrong with a table, with counts, first places and the options that mend it.

    Exit status 1 if anything is wrong; what looks as if it were meant otherwise is said, too.

    Parameters
    ----------
    data
        A table (Parquet, CSV, HDF5), a pattern of files, a directory, or a Minari id.
    """
    found = examine_source(
        data,
        angular=columns.angular,
        continuous=columns.continuous,
        categorical=columns.categorical,
        binary=columns.binary,
        preparation=columns.preparation,
    )
    for issue in (*found.issues, *found.suspicions):
        CONSOLE.print(f"- {escape(str(issue))}", highlight=False)
        options = options_for(issue)
        if options is not None:
            CONSOLE.print(f"  {escape(options)}", style="cyan", highlight=False)
    if found.issues:
        sys.exit(1)
    CONSOLE.print(f"{data} can be read so" if found.suspicions else f"{data} is sound", markup=False)
    for hint in hinted(found.hints):
        CONSOLE.print(hint, highlight=False, markup=False)
    if columns.left_over is not None:
        CONSOLE.print(f"{columns.left_over} `tvae data info` lists all.", highlight=False, markup=False)


def convert(data: str, out: str, *, columns: Columns = COLUMNS, force: Force = False) -> None:
    """Write a data set in another format; nothing is lost.

    Parameters
    ----------
    data
        A table (Parquet, CSV, HDF5), a pattern of files, a directory, or a Minari id.
    out
        NAME.parquet, NAME.csv, NAME.csv.gz, NAME.tvae (memory-mapped directory), or minari:ID.
    """
    check_demonstrations(out, overwrite=force)
    demonstrations = Source(data, columns).load()
    save_demonstrations(demonstrations, out, overwrite=force)
    CONSOLE.print(f"{len(demonstrations)} episodes, {demonstrations.num_steps} steps: {out}", markup=False)


def make(
    task: Literal["zombie", "navigation", "circle", "pusht", "overcooked"],
    out: str | None = None,
    *,
    data: Path | None = None,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Write the demonstrations of one of our tasks.

    Parameters
    ----------
    out
        NAME.parquet, NAME.csv, NAME.csv.gz, NAME.tvae (memory-mapped directory), or minari:ID; by default the
        Minari data set tvae/TASK-v0.
    data
        The file of the human demonstrations, of pusht and overcooked; by default the one in data/.
    """
    target = f"minari:tvae/{task}-v0" if out is None else out
    check_demonstrations(target, overwrite=force)
    recipe = TASKS[task](data, seed)
    demonstrations = recipe.demonstrations()
    save_demonstrations(demonstrations, target, overwrite=force, environment=recipe.arena.env)
    CONSOLE.print(f"{len(demonstrations)} episodes, {demonstrations.num_steps} steps: {target}", markup=False)
