"""`tvae similar`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from tvae.cli.options import CONSOLE, Device, Force, RunOrModel
from tvae.experiments.analysis import write_table
from tvae.experiments.sessions import open_trained, similar_table
from tvae.experiments.tables import rows_table


def similar(
    run: RunOrModel,
    data: str,
    session: str | None = None,
    *,
    count: Annotated[int, Parameter(validator=Number(gte=1))] = 10,
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
        Parquet table to write as well.
    """
    where, which = (None, data) if session is None else (data, session)
    found = similar_table(open_trained(run, device), where, which, count=count)
    CONSOLE.print(rows_table(found))
    if out is not None:
        write_table(found, out, overwrite=force)
        CONSOLE.print(f"{len(found)} sessions: {out}", markup=False)
