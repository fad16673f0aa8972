"""`tvae score`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Count, Device, Force, RunOrModel
from tvae.experiments.sessions import open_trained, score_sessions
from tvae.experiments.tables import unlike_places_table, unlike_sessions_table


def score(
    run: RunOrModel,
    data: str | None = None,
    *,
    out: Path,
    count: Count = 10,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Write the log-likelihood of every step, and of every signal in it; list what is least like the demonstrations.

    "As unlikely" is the share of the run's held-out demonstrations that are at least as unlikely, or where the run
    cannot read them, of the sessions themselves.

    Parameters
    ----------
    data
        Sessions of the model's signals: a Parquet or CSV table, a directory, or a Minari id; by default the run's own.
    out
        Table to write, a .parquet or .csv file, one row per step.
    count
        How many sessions, and how many steps, to list.
    """
    scored = score_sessions(open_trained(run, device), data, out, overwrite=force, console=CONSOLE)
    CONSOLE.print(f"{len(scored.names)} sessions, {len(scored.scores.action)} steps: {out}", markup=False)
    CONSOLE.print(f"sessions least like {scored.reference_words}, {len(scored.reference)} of them:")
    CONSOLE.print(unlike_sessions_table(scored, count))
    CONSOLE.print("least likely steps of all:")
    CONSOLE.print(unlike_places_table(scored, count))
