"""A run, or a model that comes with the package, as ONNX."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from tvae.data.degrees import with_degrees
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.experiments.findings import read_findings
from tvae.experiments.fitting import about_run
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import RunDirectory, read_json
from tvae.export.bundle import Export, export_onnx, graphs
from tvae.export.manifest import NamedStyle, named_styles
from tvae.model.tvae import TrajectoryVAE
from tvae.pretrained import pretrained_directory


def styles_of(directory: Path) -> tuple[NamedStyle, ...]:
    """The styles in a directory, with their names and words; none for a model without `playstyles.json`."""
    path = directory / "playstyles.json"
    if not path.is_file():
        return ()
    found = read_findings(path)
    return named_styles(found.playstyles.styles, {**found.labels, **found.names}, found.words)


def recorded_in_degrees(model: TrajectoryVAE, run: RunDirectory) -> list[str]:
    """The columns of which a run says `--degrees`; models of later versions know it themselves."""
    if "run" not in read_json(run.config):
        return []
    names = [OBSERVATION + name for name in model.observation_space.names]
    names += [ACTION + name for name in model.action_space.names]
    return with_degrees({}, about_run(run).source.reading.degrees, names, {})[1]


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
        degrees = recorded_in_degrees(model, RunDirectory(directory))
        return export_onnx(model, out, styles, degrees=degrees, overwrite=force, on_graph=done)
