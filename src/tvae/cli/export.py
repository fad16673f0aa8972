"""`tvae export`."""

from __future__ import annotations

from pathlib import Path

from tvae.cli.options import CONSOLE, Force, RunOrModel
from tvae.experiments.exporting import export as export_model


def export(run: RunOrModel, *, out: Path, force: Force = False) -> None:
    """Write the encoder, the state decoder and a step of the policy as ONNX, with a manifest for programmers.

    Each graph is compared with PyTorch before anything is written; nothing is where they differ.

    Parameters
    ----------
    out
        The directory to make.
    """
    written = export_model(run, out, force=force, console=CONSOLE)
    for graph in written.files:
        CONSOLE.print(f"{graph.graph.name}.onnx: differs from PyTorch by at most {graph.largest_difference:.1e}")
    CONSOLE.print(f"what each number means and how to act: {written.directory / 'manifest.json'}", markup=False)
