"""`tvae styles`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Device, Force, Run
from tvae.experiments.tables import styles_table
from tvae.experiments.using import label, open_run


def styles(
    run: Run,
    *,
    data: str | None = None,
    out: Path | None = None,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Say in words which styles a run found; with --data, label other sessions.

    Parameters
    ----------
    data
        Sessions of the same signals, as in `tvae fit`.
    out
        Parquet table to write: one row per session with style, probability and z.
    """
    opened = open_run(run, device)
    CONSOLE.print(opened.findings.playstyles.verdict)
    CONSOLE.print(styles_table(opened))
    if opened.findings.explanation:
        CONSOLE.print(opened.findings.explanation, highlight=False)
    if data is not None:
        labelled = label(opened, data, out, overwrite=force, console=CONSOLE)
        for style in opened.findings.playstyles.styles:
            share = (labelled == style.index).mean()
            CONSOLE.print(f"{opened.findings.name(style)}: {share:.0%} of the sessions in {data}")
        if out is not None:
            CONSOLE.print(f"{len(labelled)} sessions: {out}")
