"""`tvae styles`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tvae.cli.options import CONSOLE, Device, Flag, Force, Run
from tvae.errors import TvaeError
from tvae.experiments.joining import groups_with, rejoin
from tvae.experiments.naming import rename as name_styles
from tvae.experiments.tables import styles_table
from tvae.experiments.targets import check_table
from tvae.experiments.using import label, open_run

Words = Annotated[tuple[str, ...], Parameter(negative="", consume_multiple=True)]


def styles(
    run: Run,
    *,
    join: Words = (),
    as_found: Flag = False,
    rename: Words = (),
    env: str | None = None,
    data: str | None = None,
    out: Path | None = None,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Say in words which styles a run found; join or name them; label other sessions.

    Parameters
    ----------
    join
        Styles to make one, such as 0 2. The run keeps it: words, labels, numbers, bots' test episodes and the page
        are made anew.
    as_found
        Undo all that was joined.
    rename
        Names of your own, such as 0=campers 1=rushers. The run keeps them, and all commands show and take them.
    env
        With --join or --as-found, the run's environment, where that is code of your own (MODULE:NAME).
    data
        Sessions of the same signals, as in `tvae fit`.
    out
        Table to write, a .parquet or .csv file: one row per session with style, probability and z.
    """
    if join and as_found:
        raise TvaeError("--as-found undoes what was joined: give it or --join, not both")
    if env is not None and not (join or as_found):
        raise TvaeError("--env is for bots that are tried anew: give it with --join or --as-found")
    if out is not None:
        if data is None:
            raise TvaeError(f"--out {out} gets the styles of the sessions in --data: name them, too")
        check_table(out, overwrite=force)
    opened = open_run(run, device)
    if join or as_found:
        groups = groups_with(join, opened.findings) if join else []
        opened = rejoin(opened, groups, env, console=CONSOLE)
    if rename:
        opened = name_styles(opened, rename)
    CONSOLE.print(opened.findings.playstyles.verdict, markup=False)
    CONSOLE.print(styles_table(opened))
    if opened.findings.explanation:
        CONSOLE.print(opened.findings.explanation, highlight=False, markup=False)
    if rename:
        CONSOLE.print(f"The report shows these names after: tvae report {run}", highlight=False, markup=False)
    elif join or as_found:
        CONSOLE.print(f"report: {opened.directory.report}", highlight=False, markup=False)
    if data is not None:
        labelled = label(opened, data, out, overwrite=force, console=CONSOLE)
        for style in opened.findings.playstyles.styles:
            share = (labelled == style.index).mean()
            CONSOLE.print(f"{opened.findings.name(style)}: {share:.0%} of the sessions in {data}", markup=False)
        if out is not None:
            CONSOLE.print(f"{len(labelled)} sessions: {out}", markup=False)
