"""`tvae embed`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Device, Force, RunOrModel
from tvae.experiments.sessions import embed as embed_sessions
from tvae.experiments.sessions import open_trained


def embed(
    run: RunOrModel, data: str | None = None, *, out: Path, device: Device = "auto", force: Force = False
) -> None:
    """Write one row per session: episode, attributes, z (posterior mean), its scale, style and probability.

    Parameters
    ----------
    data
        Sessions of the model's signals: a Parquet or CSV table, a directory, or a Minari id; by default the run's own.
    out
        Table to write, a .parquet or .csv file.
    """
    count = embed_sessions(open_trained(run, device), data, out, overwrite=force)
    CONSOLE.print(f"{count} sessions: {out}", markup=False)
