"""All cells of a benchmark as one table: CSV for machines, Markdown and a figure to read."""

from __future__ import annotations

import csv
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

from tvae.evaluate.over_seeds import over_seeds
from tvae.experiments.benchmark.measures import flat
from tvae.experiments.benchmark.methods import METHODS, Entry
from tvae.experiments.benchmark.playing import obstacle
from tvae.experiments.benchmark.sooner import PARTS, sooner
from tvae.experiments.benchmark.stored import Runs, every_cell
from tvae.figures.benchmark import Bar
from tvae.files import appearing

TITLES = {
    "navigation": "Navigation",
    "circle": "Circle",
    "zombie": "Zombie",
    "pusht": "PushT, people",
    "overcooked": "Overcooked, people",
}
NOTES = {
    "pusht": " Styles have no names here. The people: their recordings, replayed.",
    "overcooked": " A game is 400 steps, and so are soups counted. The people: their recordings of 200 steps.",
}
"""What a reader must know beside."""
_WORST = "the worst success over styles; †: success at will"
QUALITIES = {
    "navigation": _WORST,
    "circle": _WORST,
    "zombie": _WORST,
    "pusht": "how much of its goal the block covers at best",
    "overcooked": "the worst success over styles; †: soups at will",
}
"""What the quality is that a method soon has or not (`tvae.experiments.benchmark.sooner`)."""
_WITHOUT_STYLES = (
    ("fit", "trajectory_fit", 2),
    ("parameters", "num_parameters", 0),
    ("env steps", "env_steps", 0),
    ("training, s", "train_seconds", 0),
    ("ms per action", "ms_per_action", 2),
)
_EVERYWHERE = (
    ("controllability", "worst_controllability", 2),
    ("coverage", "coverage", 2),
    ("calibration", "calibration", 3),
    *_WITHOUT_STYLES,
)
COLUMNS: Mapping[str, tuple[tuple[str, str, int], ...]] = {
    "navigation": (
        ("success, worst", "worst_success", 2),
        ("end distance, worst", "worst_end_distance", 1),
        ("modes", "modes_recovered", 1),
        *_EVERYWHERE,
    ),
    "circle": (
        ("success, worst", "worst_success", 2),
        ("radial error, worst", "worst_radial_error", 3),
        ("turn, worst", "worst_turn_completed", 2),
        ("modes", "modes_recovered", 1),
        *_EVERYWHERE,
    ),
    "zombie": (
        ("success, attack", "success.attack", 3),
        ("success, avoid", "success.avoid", 3),
        ("worst", "worst_success", 3),
        ("at will", "at_will.success", 3),
        *_EVERYWHERE,
    ),
    "pusht": (
        ("success", "at_will.success", 3),
        ("block on its goal, best", "at_will.best_coverage", 2),
        ("at the end", "at_will.final_coverage", 2),
        *_WITHOUT_STYLES,
    ),
    "overcooked": (
        ("as asked, clockwise", "success.clockwise", 2),
        ("none", "success.none", 2),
        ("counter-clockwise", "success.counter-clockwise", 2),
        ("worst", "worst_success", 2),
        ("soups, worst", "worst_soups", 1),
        ("soups, at will", "at_will.soups", 1),
        *_EVERYWHERE,
    ),
}
"""Head, number and decimals of each column."""
_SHOWN = ("worst_success", "coverage", "at_will.best_coverage")
"""The numbers that the figure shows, as far as a task's table has them."""
_YOUNGER = "trajectory_fit"
"""A number that some stored cells lack because it was not measured when they were made; no number lacks otherwise but
where it cannot be told."""
_COSTS = {"num_parameters", "env_steps", "train_seconds", "ms_per_action"}
"""Told by their means alone."""
_HIDDEN = {"threads", "seed", "cell", "versions", "warnings", "commit", "shorter"}


def write_csv(runs: Runs, path: Path) -> None:
    """One row for each number of each cell: `task`, `method`, `seed`, `measure`, `value`."""
    with appearing(path, overwrite=True) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("task", "method", "seed", "measure", "value"))
        for task, methods in runs.items():
            for method, seeds in methods.items():
                for numbers in seeds:
                    told = {name: value for name, value in numbers.items() if name not in _HIDDEN}
                    for name, value in flat({**told, "sooner": sooner(numbers)}).items():
                        writer.writerow((task, method, numbers["cell"]["seed"], name, value))


def summaries(runs: Runs) -> dict[str, dict[str, dict[str, Any]]]:
    """By task and method: means and 95 % intervals over seeds; `seeds` of each number says over how many."""
    return {
        task: {method: _summary(seeds) for method, seeds in methods.items()} for task, methods in runs.items()
    }


def _summary(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    numbers = [flat({name: value for name, value in run.items() if name not in _HIDDEN}) for run in runs]
    measured = [run for run in numbers if _YOUNGER in run]
    younger = over_seeds([{_YOUNGER: run[_YOUNGER]} for run in measured]) if measured else {}
    return {**over_seeds(numbers), **younger}


def markdown(runs: Runs, command: str) -> str:
    """A table for each task, a row for each method."""
    found = summaries(runs)
    most = every_cell(runs)[0]["cell"]["most_steps"]
    limit = "" if most is None else f" **At most {most} gradient steps: a trial only.**"
    lines = [
        "# Benchmark",
        "",
        "Means with 95 % intervals (Student's t) over the seeds that a row names; none where there is one seed, or",
        "where all show the same digits, and none of steps, sizes and times. Ends may lie outside of what is possible.",
        f"The same demonstrations and worlds for all.{limit}",
        "`docs/benchmark.md` says what each number means. Last added to by:",
        "",
        "```",
        command,
        "```",
        "",
        "† cannot be asked for a style: it acts at will whatever one asks for, so that its styles share its episodes.",
        *_remarks(runs),
    ]
    for task, methods in found.items():
        heads = " | ".join(head for head, _, _ in COLUMNS[task])
        episodes = next(iter(runs[task].values()))[0]["cell"]["episodes"]
        lines += ["", f"## {TITLES[task]}", "", f"{episodes:,} fresh episodes of each bot.{NOTES.get(task, '')}"]
        lines += ["", f"| method | learns from | seeds | {heads} |"]
        lines.append(f"|---|---|---{'|---' * len(COLUMNS[task])}|")
        for method, summary in methods.items():
            seeds = ", ".join(str(run["cell"]["seed"]) for run in runs[task][method])
            said = " | ".join(
                _said(name, summary.get(name), decimals, len(runs[task][method])) for _, name, decimals in COLUMNS[task]
            )
            lines.append(f"| {title(method, summary)} | {_needs(METHODS[method])} | {seeds} | {said} |")
        lines += [*_not_run(task, methods), *_how_soon(task, runs[task], methods)]
    return "\n".join(lines) + "\n"


def title(method: str, summary: Mapping[str, Any]) -> str:
    """A method's name, with a mark where it cannot be asked for a style though there are styles with names."""
    asked = summary.get("asked")
    return f"{METHODS[method].title}{'' if asked is None or asked['mean'] else ' †'}"


def panels(found: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> list[dict[str, list[Bar]]]:
    """What the figure shows of summaries: a row for each task, a panel for each number, a bar for each method."""
    return [
        {
            f"{TITLES[task]}: {'worst success' if name == 'worst_success' else head}": [
                Bar(title(method, numbers), numbers[name]["mean"], numbers[name]["ci95"])
                for method, numbers in methods.items()
                if name in numbers
            ]
            for head, name, _ in COLUMNS[task]
            if name in _SHOWN
        }
        for task, methods in found.items()
    ]


def _remarks(runs: Runs) -> list[str]:
    """What a reader should know of the cells: warnings of a whole training, and that they are of several commits."""
    cells = every_cell(runs)
    warned = [
        f"Warning, {cell['cell']['task']}, {cell['cell']['method']}, seed {cell['cell']['seed']}: {warning}"
        for cell in cells
        for warning in (() if cell["cell"].get("one_in", 1) > 1 else cell.get("warnings", ()))
    ]
    made_at = {cell.get("commit") or "unknown" for cell in cells}
    commits = sorted(made_at | {cell["trained_at_commit"] for cell in cells if "trained_at_commit" in cell})
    several = [f"These cells were made at several commits: {', '.join(commits)}."] if len(commits) > 1 else []
    return [line for remark in (*several, *warned) for line in ("", remark)]


def _not_run(task: str, methods: Container[str]) -> list[str]:
    """Which methods could play a task, but have no cell there."""
    missing = [entry.title for name, entry in METHODS.items() if name not in methods and obstacle(name, task) is None]
    return ["", f"Not run: {', '.join(missing)}."] if missing else []


def _how_soon(
    task: str, methods: Mapping[str, Sequence[Mapping[str, Any]]], found_of: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """What comes of shorter trainings, of the methods and seeds that have them all."""
    rows = []
    for method, runs in methods.items():
        seeds = [run for run in runs if len(run.get("shorter", ())) == len(PARTS)]
        if not seeds:
            continue
        found = over_seeds([sooner(run) for run in seeds])
        shares = (f"{quality['mean']:.2f}" for quality in reversed(found["quality"].values()))
        enough = [
            f"{found[name]['mean']:,.{decimals}f}" if name in found else ""
            for name, decimals in (("share_to_most", 3), ("train_seconds_to_most", 0))
        ]
        whole = f"{found['train_seconds']['1']['mean']:,.0f}"
        told = ", ".join(str(run["cell"]["seed"]) for run in seeds)
        rows.append(f"| {title(method, found_of[method])} | {told} | {' | '.join((*shares, *enough, whole))} |")
    if not rows:
        return []
    return [
        "",
        f"{TITLES[task]}, how soon: quality after an eighth, a quarter, half and all of the gradient steps, each a",
        "training of its own; and the share of the steps and the training seconds of the shortest that, like all",
        f"longer ones, has 0.9 of the last. Quality: {QUALITIES[task]}.",
        "",
        "| method | seeds | 1/8 | 1/4 | 1/2 | all | enough for 0.9 | s | all, s |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]


def _needs(entry: Entry) -> str:
    return ", ".join(need.value for need in entry.needs) or "demonstrations"


def _said(name: str, number: Mapping[str, Any] | None, decimals: int, num_seeds: int) -> str:
    if number is None:
        return ""
    interval = () if name in _COSTS else number["ci95"] or ()
    mean, *ends = (f"{value:,.{decimals}f}" for value in (number["mean"], *interval))
    few = "" if number["seeds"] == num_seeds else f" ({number['seeds']} of {num_seeds} seeds)"
    return (f"{mean} [{', '.join(ends)}]" if set(ends) - {mean} else mean) + few
