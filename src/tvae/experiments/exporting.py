"""A run, or a model that comes with the package, as ONNX."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from tvae.errors import TvaeError
from tvae.experiments.findings import Findings
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import read_json
from tvae.export.bundle import Export, export_onnx, graphs
from tvae.export.manifest import NamedStyle, named_styles
from tvae.model.tvae import TrajectoryVAE
from tvae.pretrained import pretrained_directory


def styles_of(directory: Path) -> tuple[NamedStyle, ...]:
    """The styles in a directory, with their labels and words; none for a model without `playstyles.json`."""
    path = directory / "playstyles.json"
    if not path.is_file():
        return ()
    data = read_json(path)
    try:
        found = Findings.from_json(data)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise TvaeError(f"{path} does not hold playstyles: {error}") from error
    return named_styles(found.playstyles.styles, found.labels, found.words)


def export(name: str, out: Path, *, force: bool, console: Console) -> Export:
    """Export the run or model in a directory, or the shipped model of this name.

    Raises `FileExistsError` for `out` that exists unless `force`, and also then where it is no export.
    """
    directory = pretrained_directory(name)
    model = TrajectoryVAE.load(directory)
    if out.exists() and not force:
        raise FileExistsError(f"{out} exists already; choose another --out, or replace it with --force")
    styles = styles_of(directory)
    with counting("graphs", len(graphs(model)), console) as done:
        return export_onnx(model, out, styles, overwrite=force, on_graph=done)
