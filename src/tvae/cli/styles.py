"""`tvae styles`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tvae.cli.options import CONSOLE, Device, Force, Run
from tvae.experiments.naming import rename as name_styles
from tvae.experiments.tables import styles_table
from tvae.experiments.using import label, open_run


def styles(
    run: Run,
    *,
    rename: Annotated[tuple[str, ...], Parameter(negative="", consume_multiple=True)] = (),
    data: str | None = None,
    out: Path | None = None,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Say in words which styles a run found; with --rename, name them; with --data, label other sessions.

    Parameters
    ----------
    rename
        Names of your own, such as 0=campers 1=rushers. The run keeps them, and all commands show and take them.
    data
        Sessions of the same signals, as in `tvae fit`.
    out
        Parquet table to write: one row per session with style, probability and z.
    """
    opened = open_run(run, device)
    if rename:
        opened = name_styles(opened, rename)
    CONSOLE.print(opened.findings.playstyles.verdict)
    CONSOLE.print(styles_table(opened))
    if opened.findings.explanation:
        CONSOLE.print(opened.findings.explanation, highlight=False)
    if rename:
        CONSOLE.print(f"The report shows these names after: tvae report {run}", highlight=False, markup=False)
    if data is not None:
        labelled = label(opened, data, out, overwrite=force, console=CONSOLE)
        for style in opened.findings.playstyles.styles:
            share = (labelled == style.index).mean()
            CONSOLE.print(f"{opened.findings.name(style)}: {share:.0%} of the sessions in {data}", markup=False)
        if out is not None:
            CONSOLE.print(f"{len(labelled)} sessions: {out}")
