"""All cells that there are of a benchmark, whichever command made them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from tvae.config import RunConfig
from tvae.experiments.benchmark.methods import METHODS
from tvae.experiments.benchmark.tasks import TASKS
from tvae.experiments.reproduction.cells import CellError
from tvae.experiments.run_directory import read_json

Runs: TypeAlias = Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]
"""By task, then by method, both in the order of the table: the numbers of each seed."""


def stored(out: Path) -> Runs:
    """The numbers of every cell under `out`, seed by seed; tasks and methods without a cell are left out."""
    runs: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for task in TASKS:
        for method in METHODS:
            cells = [_with_shorter(path) for path in (out / "cells" / task / method).glob("seed-*/metrics.json")]
            if cells:
                runs.setdefault(task, {})[method] = sorted(cells, key=lambda numbers: int(numbers["cell"]["seed"]))
    return runs


def _with_shorter(path: Path) -> dict[str, Any]:
    """The numbers of a cell; `shorter` are those of its shorter trainings, if there are any."""
    shorter = [read_json(part) for part in path.parent.glob("one-in-*/metrics.json")]
    return {**read_json(path), **({"shorter": shorter} if shorter else {})}


def every_cell(runs: Runs) -> list[Mapping[str, Any]]:
    """The numbers of every cell, those of shorter trainings too."""
    return [
        cell
        for methods in runs.values()
        for seeds in methods.values()
        for whole in seeds
        for cell in (whole, *whole.get("shorter", ()))
    ]


def asked_of(runs: Runs) -> list[Mapping[str, Any]]:
    """What was asked of every cell (`BenchmarkCell.asked`)."""
    return [cell["cell"] for cell in every_cell(runs)]


def as_now(asked: Mapping[str, Any]) -> dict[str, Any]:
    """What was asked of a cell, where a setting that was not there yet has its default.

    >>> cell = {"method": "ours", "config": {"task": "zombie", "config": RunConfig().to_json()}}
    >>> del cell["config"]["config"]["policy"]
    >>> as_now(cell)["config"]["config"]["policy"]["num_steps"]
    0
    """
    asked = {"measures": 1, "one_in": 1, **asked}
    ours = asked["config"].get("config")
    if ours is None:
        return dict(asked)
    return {**asked, "config": {**asked["config"], "config": RunConfig.completed(ours)}}


def require_one_table(cells: Iterable[Mapping[str, Any]]) -> None:
    """`CellError` where what was asked of these cells cannot stand in one table.

    All must be learnt within the same most steps and measured by the same measures, those of a task over as many
    episodes, and those of a method and a task must have the same hyperparameters.

    >>> cell = {"method": "flow", "task": "zombie", "most_steps": None, "episodes": 50}
    >>> old, new = {**cell, "seed": 0, "config": {"num_taken": 4}}, {**cell, "seed": 1, "config": {"num_taken": 2}}
    >>> try:
    ...     require_one_table([old, new])
    ... except CellError as error:
    ...     print(str(error).split(";")[0])
    cells that cannot stand in one table: num_taken is 4 in zombie, flow, seed 0, but 2 in zombie, flow, seed 1
    """
    firsts: dict[tuple[str, ...], Mapping[str, Any]] = {}
    for cell in map(as_now, cells):
        kinds = (
            ((), {"most_steps": cell["most_steps"], "measures": cell["measures"]}),
            ((cell["task"],), {"episodes": cell["episodes"]}),
            ((cell["task"], cell["method"]), cell["config"]),
        )
        for kind, made_with in kinds:
            first = firsts.setdefault(kind, {"cell": cell, "made_with": made_with})
            before = first["made_with"]
            for name in sorted({*before, *made_with}):
                if before.get(name) != made_with.get(name):
                    raise CellError(
                        f"cells that cannot stand in one table: {name} is {before.get(name)} in "
                        f"{name_of(first['cell'])}, but {made_with.get(name)} in {name_of(cell)}; make some anew with "
                        "--force, or choose another --out"
                    )


def name_of(cell: Mapping[str, Any]) -> str:
    """As progress shows it."""
    part = cell.get("one_in", 1)
    return f"{cell['task']}, {cell['method']}, seed {cell['seed']}{f', 1/{part} of its steps' if part > 1 else ''}"
