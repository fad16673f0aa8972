"""`manifest.json`: all that a programmer needs who has the files and nothing else."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tvae import __version__
from tvae.evaluate.styles import Style
from tvae.export.engines import ENGINES, IR_VERSION, OPSET
from tvae.export.parity import TOLERANCE
from tvae.export.policy import PolicyStep
from tvae.export.ports import Graph
from tvae.export.sequences import StateDecoderGraph
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import Angular, Binary, Categorical, Signal, Space, kind_name

FORMAT = "tvae-onnx"
SCHEMA_VERSION = 1
_ACT = (
    "At the start of an episode: draw z from the style (see styles.z) and set memory to zeros.",
    "In each step: fill noise with uniform random numbers in [0, 1), run policy_step with observation, z, memory, "
    "noise and most_likely, do what action says, and keep memory_out as the next step's memory.",
    "For the most likely action set most_likely to [1]; noise then does not matter.",
    "Several bots are rows of one batch; to begin one's episode anew, draw its z and set its row of memory to zeros.",
)
_IMAGINE = (
    "Start with one observation (time = 1). Run state_decoder; the last row of next_observations is the next state. "
    "Append it to observations and repeat; where end is given, stop once its last entry is 1.",
    "Where window is a number, pass only the last so many observations (and their actions).",
)
_DRAW = (
    "z.members are the episodes of the style: take one at random and draw z = mean + deviation * n with standard "
    "normal n, per number of z. z.representative is one z for where no randomness is wanted."
)


@dataclass(frozen=True, eq=False)
class NamedStyle:
    """A style as people call it, and the sentences that set it apart."""

    style: Style
    name: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Written:
    """A graph that has been written: its operators, and how far ONNX Runtime is from PyTorch."""

    graph: Graph
    operators: tuple[str, ...]
    largest_difference: float


def manifest(
    model: TrajectoryVAE, files: Sequence[Written], styles: Sequence[NamedStyle], degrees: Collection[str] = ()
) -> dict[str, Any]:
    """The content of `manifest.json`, plain data.

    Columns that are named in `degrees` were recorded so, besides those of which the model's spaces say it.
    """
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "tvae_version": __version__,
        "opset": OPSET,
        "ir_version": IR_VERSION,
        "engines": [{"name": engine.name, "version": engine.version} for engine in ENGINES],
        "graphs": {written.graph.name: _graph(written) for written in files},
        "observation": _columns("observation.", model.observation_space, degrees),
        "action": _columns("action.", model.action_space, degrees),
        "policy": {"window": model.bot_window, "how_to_act": list(_ACT)},
        "imagination": {"window": model.window, "how_to_imagine": list(_IMAGINE)},
        "z": {"size": model.latent_features, "how_to_draw": _DRAW},
        "parity": {
            "tolerance": TOLERANCE,
            "largest_difference": {written.graph.name: written.largest_difference for written in files},
        },
        "styles": [_style(named) for named in styles],
    }


def _graph(written: Written) -> dict[str, Any]:
    graph = written.graph
    found: dict[str, Any] = {
        "file": f"{graph.name}.onnx",
        "inputs": [port.to_json() for port in graph.inputs],
        "outputs": [port.to_json() for port in graph.outputs],
        "operators": list(written.operators),
    }
    if isinstance(graph, PolicyStep | StateDecoderGraph):
        found["noise"] = list(graph.noise)
    if isinstance(graph, PolicyStep):
        ends = np.cumsum([field.size for field in graph.fields]).tolist()
        found["memory"] = [
            {
                "name": field.name,
                "first_column": end - field.size,
                "shape": list(field.shape),
                "meaning": field.meaning,
            }
            for field, end in zip(graph.fields, ends, strict=True)
        ]
    return found


def _columns(prefix: str, space: Space, degrees: Collection[str]) -> list[dict[str, Any]]:
    columns = []
    for column, signal in enumerate(space.signals):
        found = {"column": column, **_signal(signal)}
        noted = isinstance(signal, Angular) and signal.recorded_in_degrees
        columns.append(found | {"recorded_unit": "degrees"} if noted or prefix + signal.name in degrees else found)
    return columns


def _signal(signal: Signal) -> dict[str, Any]:
    found: dict[str, Any] = {"name": signal.name, "kind": kind_name(signal)}
    match signal:
        case Angular():
            return found | {"unit": "radians", "values": "any; given in [-pi, pi]"}
        case Binary():
            return found | {"unit": None, "values": "0 is no, 1 is yes"}
        case Categorical():
            return found | {"unit": None, "values": "position in categories", "categories": list(signal.categories)}
        case _:
            return found | {"unit": "as recorded", "values": "any number"}


def _style(named: NamedStyle) -> dict[str, Any]:
    style = named.style
    return {
        "index": style.index,
        "name": named.name,
        "words": list(named.words),
        "frequency": style.weight,
        "z": {
            "representative": representative(style),
            "mean": style.mean.tolist(),
            "covariance": style.covariance.tolist(),
            "members": {"means": style.members.means.tolist(), "deviations": style.members.scales.tolist()},
        },
    }


def representative(style: Style) -> list[float]:
    """The posterior mean of the member nearest to the style's middle, in the style's own spread."""
    spread = np.sqrt(np.maximum(np.diag(style.covariance), 1e-12))
    distance = np.square((style.members.means - style.mean) / spread).sum(-1)
    nearest: list[float] = style.members.means[int(distance.argmin())].tolist()
    return nearest


def named_styles(
    styles: Sequence[Style], labels: Mapping[int, str], words: Mapping[int, tuple[str, ...]]
) -> tuple[NamedStyle, ...]:
    """Styles with the labels and the words that were found for them, by their number."""
    return tuple(NamedStyle(style, labels.get(style.index, style.name), words.get(style.index, ())) for style in styles)
