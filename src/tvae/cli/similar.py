"""`tvae similar`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Count, Device, Force, RunOrModel
from tvae.experiments.sessions import open_trained, similar_table
from tvae.experiments.tables import rows_table
from tvae.experiments.targets import check_table, write_table


def similar(
    run: RunOrModel,
    data: str,
    session: str | None = None,
    *,
    count: Count = 10,
    out: Path | None = None,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """List the sessions that are played most like a given one, by Bhattacharyya's distance of their posteriors.

    Distance 0, overlap 1: draws of z cannot tell the two apart. `tvae similar RUN SESSION` looks among the run's own
    sessions.

    Parameters
    ----------
    data
        Sessions of the model's signals: a Parquet or CSV table, a directory, or a Minari id. May be left out.
    session
        The session, as the column episode calls it.
    count
        How many to list.
    out
        Table to write as well, a .parquet or .csv file.
    """
    if out is not None:
        check_table(out, overwrite=force)
    where, which = (None, data) if session is None else (data, session)
    found = similar_table(open_trained(run, device), where, which, count=count)
    CONSOLE.print(rows_table(found))
    if out is not None:
        write_table(found, out, overwrite=force)
        CONSOLE.print(f"{len(found)} sessions: {out}", markup=False)
