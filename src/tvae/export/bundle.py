"""An export: a directory of graphs and the manifest that explains them."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

from tvae.export.compact import compact_json
from tvae.export.manifest import FORMAT, NamedStyle, Written, manifest
from tvae.export.parity import check_parity
from tvae.export.policy import PolicyStep
from tvae.export.ports import Graph
from tvae.export.sequences import EncoderGraph, StateDecoderGraph
from tvae.export.writing import write_onnx
from tvae.files import appearing
from tvae.model.tvae import TrajectoryVAE

MANIFEST = "manifest.json"


@dataclass(frozen=True, eq=False)
class Export:
    """What was written, and where."""

    directory: Path
    files: tuple[Written, ...]

    @property
    def largest_difference(self) -> float:
        """Between ONNX Runtime and PyTorch, over all graphs."""
        return max(written.largest_difference for written in self.files)


def is_export(directory: Path) -> bool:
    """Whether the directory holds the manifest of an export; a web page may have a file of that name too."""
    try:
        found = json.loads((directory / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and found.get("format") == FORMAT


def graphs(model: TrajectoryVAE) -> tuple[Graph, ...]:
    """The graphs of a model: the policy's step, the state decoder, and the encoder of a model that has a latent."""
    encoder: tuple[Graph, ...] = (EncoderGraph(model),) if model.latent_features else ()
    return (PolicyStep(model), StateDecoderGraph(model), *encoder)


def export_onnx(
    model: TrajectoryVAE,
    directory: str | Path,
    styles: Sequence[NamedStyle] = (),
    *,
    degrees: Collection[str] = (),
    overwrite: bool = False,
    on_graph: Callable[[int], None] = lambda done: None,
) -> Export:
    """Write `policy_step.onnx`, `state_decoder.onnx`, `encoder.onnx` and `manifest.json`, all of them or none.

    Each graph is run in ONNX Runtime and compared with PyTorch before anything appears. `on_graph` is told how many
    are done. The manifest says which angles were recorded in degrees: those of which the model's spaces say it, and
    columns that are named in `degrees`, such as `observation.heading`. The graphs read and write radians.

    Raises `ExportError` where a package is missing or the two differ by more than 1e-5, and `FileExistsError` for a
    directory that exists unless `overwrite`, and also then where it is no export.
    """
    directory = Path(directory)
    if overwrite and directory.exists() and not is_export(directory):
        raise FileExistsError(f"{directory} is no export (its {MANIFEST} is not of one), and is left alone")
    frozen = deepcopy(model).cpu().float().eval()
    written = []
    with appearing(directory, overwrite=overwrite) as partial:
        partial.mkdir()
        for graph in graphs(frozen):
            path = partial / f"{graph.name}.onnx"
            operators = write_onnx(graph.eval(), path)
            written.append(Written(graph, operators, check_parity(frozen, graph, path)))
            on_graph(len(written))
        content = compact_json(manifest(frozen, written, styles, degrees))
        (partial / MANIFEST).write_text(content + "\n", encoding="utf-8")
    return Export(directory, tuple(written))
