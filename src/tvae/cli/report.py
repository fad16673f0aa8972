"""`tvae report`."""

from __future__ import annotations

from tvae.cli.options import CONSOLE, Run
from tvae.experiments.fitting import demonstrations_of
from tvae.experiments.reporting import write_report
from tvae.experiments.run_directory import RunDirectory


def report(run: Run) -> None:
    """Write the page of a run anew, from what its directory holds.
    """
    directory = RunDirectory.existing(run)
    write_report(directory, demonstrations_of(directory))
    CONSOLE.print(f"report: {directory.report}", markup=False)
