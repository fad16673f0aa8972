"""All seeds of a preset in one `metrics.json`, and all presets in one table to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.metrics import adjusted_rand_score

from tvae.evaluate.over_seeds import over_seeds
from tvae.files import appearing

_HIDDEN = {"nats_per_trajectory", "success_by_window", "wasserstein", "config"}
"""Left to `metrics.json` and the figures."""


def summary(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means with 95 % intervals over the seeds, the agreement of their styles, and what made them.

    `between_seeds.ari`: adjusted Rand index of the styles that two seeds find in the same test demonstrations, over
    all pairs of seeds that found more than one; the interval is that from the lowest to the highest pair.
    """
    found = over_seeds([{name: run[name] for name in run if name != "cell"} for run in runs])
    pairs = [
        float(adjusted_rand_score(first["test_assignment"], second["test_assignment"]))
        for first, second in combinations(runs, 2)
        if all(len(set(run.get("test_assignment", ()))) > 1 for run in (first, second))
    ]
    if pairs:
        found["between_seeds"] = {
            "ari": {"mean": float(np.mean(pairs)), "ci95": [min(pairs), max(pairs)], "pairs": len(pairs)}
        }
    return {
        **found,
        "seeds": [run["cell"]["seed"] for run in runs],
        "episodes": runs[0]["cell"]["episodes"],
        "commit": ", ".join(sorted({str(run["commit"]) for run in runs})),
        "versions": runs[0]["versions"],
        "warnings": sorted({warning for run in runs for warning in run["warnings"]}),
        "config": {name: runs[0]["cell"][name] for name in ("model", "training")},
    }


def write_table(columns: Mapping[str, Mapping[str, Any]], title: str, command: str, path: Path) -> None:
    """A Markdown table of summaries, one column each: mean and 95 % interval over seeds."""
    names: list[str] = []
    leaves = {column: dict(_leaves(found)) for column, found in columns.items()}
    for found in leaves.values():
        names += [name for name in found if name not in names]
    lines = [
        f"# {title}",
        "",
        "Means over seeds with 95 % intervals (Student's t over training seeds; all seeds share one test set, and each",
        "has fresh worlds of its own). `docs/paper.md` says what each number means. Made by:",
        "",
        "```",
        command,
        "```",
        "",
        f"| | {' | '.join(columns)} |",
        f"|---{'|---' * len(columns)}|",
    ]
    lines += [f"| {name} | {' | '.join(found.get(name, '') for found in leaves.values())} |" for name in names]
    with appearing(path, overwrite=True) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _leaves(found: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, str]]:
    """Name and words of each number over seeds."""
    for name, value in found.items():
        if not isinstance(value, Mapping) or (not path and name in _HIDDEN):
            continue
        if "ci95" in value:
            interval = "" if value["ci95"] is None else f" [{', '.join(_short(end) for end in value['ci95'])}]"
            yield f"{path}{name}", f"{_short(value['mean'])}{interval}"
        else:
            yield from _leaves(value, f"{path}{name}.")


def _short(value: float) -> str:
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"
