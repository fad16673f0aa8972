"""A picture with the numbers behind it: PNG and SVG to look at, CSV and JSON to compute with."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv
from matplotlib.figure import Figure

from tvae.figures.canvas import save
from tvae.files import appearing
from tvae.spaces import FloatArray

Runs: TypeAlias = Mapping[str, Sequence[Mapping[str, Any]]]
"""The metrics of each preset's seeds."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure, the table of all that it draws, and a few facts about it."""

    name: str
    figure: Figure
    table: Mapping[str, Sequence[Any]]
    """Columns of one length."""
    facts: Mapping[str, Any] = field(default_factory=dict)

    def write(self, directory: Path) -> None:
        """NAME.png, .svg, .csv and .json in `directory`, each whole or not at all."""
        directory.mkdir(parents=True, exist_ok=True)
        save(self.figure, directory / self.name)
        table = pa.table({name: pa.array(list(values)) for name, values in self.table.items()})
        with appearing(directory / f"{self.name}.csv", overwrite=True) as partial:
            pa.csv.write_csv(table, partial)
        with appearing(directory / f"{self.name}.json", overwrite=True) as partial:
            partial.write_text(json.dumps({**self.facts, "table": table.to_pydict()}, allow_nan=False) + "\n")


def stacked(tables: Sequence[Mapping[str, Sequence[Any]]]) -> dict[str, list[Any]]:
    """Tables with the same columns, one below the other.

    >>> stacked([{"a": [1]}, {"a": [2, 3]}])
    {'a': [1, 2, 3]}
    """
    return {name: [value for table in tables for value in table[name]] for name in tables[0]}


def path_table(panels: Mapping[str, Sequence[FloatArray]], labels: Sequence[str]) -> dict[str, list[Any]]:
    """Every place of every path: `panel`, `episode`, `label`, `step`, `x`, `y`."""
    return stacked(
        [
            {
                "panel": [panel] * len(path),
                "episode": [episode] * len(path),
                "label": [label] * len(path),
                "step": list(range(len(path))),
                "x": path[:, 0].round(3).tolist(),
                "y": path[:, 1].round(3).tolist(),
            }
            for panel, paths in panels.items()
            for episode, (path, label) in enumerate(zip(paths, labels, strict=True))
        ]
    )


def point_table(points: FloatArray, labels: Sequence[str], panel: str) -> dict[str, list[Any]]:
    """Latent means as rows like those of `path_table`, one step each."""
    flat = np.zeros((len(points), 2))
    flat[:, : points.shape[1]] = points[:, :2]
    return path_table({panel: [point[None] for point in flat]}, labels)
