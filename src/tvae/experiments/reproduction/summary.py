"""All seeds of a preset in one `metrics.json`, and all presets in one table to read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.metrics import adjusted_rand_score

from tvae.evaluate.over_seeds import over_seeds
from tvae.files import appearing

_HIDDEN = {"nats_per_trajectory", "success_by_window", "wasserstein", "config", "amounts"}
"""Left to `metrics.json` and the figures."""
_COMPARED = (
    "success",
    "success_most_likely",
    "style_consistency",
    "end_distance",
    "decoder_consistency",
    "radial_error",
    "radial_error_most_likely",
    "kl_nats",
    "leakage_r2",
)
"""Numbers that are compared seed by seed."""


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


def less(runs: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How much larger success, errors, nats and leakage are than those of others with the same seeds, one by one.

    Trainings of one seed have the same demonstrations and worlds, so that their difference varies less than they do.

    >>> ours, theirs = [{"kl_nats": 0.9}, {"kl_nats": 0.7}], [{"kl_nats": 0.8}, {"kl_nats": 0.6}]
    >>> less(ours, theirs)["kl_nats"]
    {'mean': 0.1, 'ci95': [0.1, 0.1], 'seeds': 2}
    """
    return over_seeds([_difference(run, other, _COMPARED) for run, other in zip(runs, others, strict=True)])


def _difference(run: Mapping[str, Any], other: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    return {
        name: _difference(run[name], other[name], run[name])
        if isinstance(run[name], Mapping)
        else run[name] - other[name]
        for name in names
        if name in run and name in other
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
