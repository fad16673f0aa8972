"""The whole reproduction: train what is not trained yet, put the seeds together, draw."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from threadpoolctl import threadpool_limits

from tvae.experiments.progress import counting
from tvae.experiments.reproduction.cells import Cell, CellError, Effort
from tvae.experiments.reproduction.presets import ABLATIONS, BASES, BESIDE, PRESETS
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.summary import less, summary, write_table
from tvae.experiments.run_directory import read_json, write_json
from tvae.figures.architecture import architecture
from tvae.figures.canvas import save
from tvae.figures.video import require_video, save_animation

TASKS = tuple(STUDIES)


@dataclass(frozen=True)
class Plan:
    """What to reproduce, where, and how thoroughly.

    OUT/TASK/ holds our default's `metrics.json` and pictures, OUT/TASK/paper/ those of the paper's reading,
    OUT/cells/TASK/PRESET/seed-K/ each training: a cell whose numbers are there is not made again, but for the one of
    seed 0 whose model is drawn.
    """

    tasks: Sequence[str]
    out: Path
    num_seeds: int
    effort: Effort
    ablations: bool
    """Train the ablations too."""
    command: str

    def cells(self, task: str, preset: str) -> list[Cell]:
        """One for each seed."""
        home = self.out / "cells" / task / preset
        return [Cell(task, preset, seed, home / f"seed-{seed}", self.effort) for seed in range(self.num_seeds)]

    def presets(self, task: str) -> list[str]:
        """What is trained for a task."""
        return [*PRESETS[task], *BESIDE[task], *(ABLATIONS[task] if self.ablations else ())]

    def directory(self, task: str, preset: str) -> Path:
        """Where a preset's results go."""
        return self.out / task if preset == "default" else self.out / task / preset

    def is_done(self, cell: Cell) -> bool:
        """Whether all that the results need of a cell is there."""
        drawn = cell.seed == 0 and cell.preset in PRESETS[cell.task]
        return cell.is_finished() if drawn else cell.is_measured()

    def all_cells(self) -> list[Cell]:
        """Of all tasks, our default first."""
        return [cell for task in self.tasks for preset in self.presets(task) for cell in self.cells(task, preset)]


def reproduce(plan: Plan, *, jobs: int, device: str, force: bool, console: Console) -> None:
    """Do all of `plan`, `jobs` trainings at a time, each on one core; with `force` make its cells anew.

    Raises `CellError` before anything is trained where a stored cell is another one than asked for.
    """
    if "zombie" in plan.tasks:
        require_video()
    cells = plan.all_cells()
    waiting = cells if force else [cell for cell in cells if not plan.is_done(cell)]
    console.print(f"{len(cells)} trainings, {len(cells) - len(waiting)} of them done already")
    train_all(waiting, jobs=jobs, device=device, force=force, console=console)
    for task in plan.tasks:
        finish(plan, task, console=console)
    save(architecture(), plan.out / "architecture")


def train_all(cells: Sequence[Cell], *, jobs: int, device: str, force: bool, console: Console) -> None:
    """Make these cells; after the first that fails no other is begun."""
    with counting("trainings", len(cells), console) as done, _workers(min(jobs, max(len(cells), 1))) as pool:
        results = {pool.submit(_make, cell, device, force): cell for cell in cells}
        try:
            for count, result in enumerate(as_completed(results), 1):
                result.result()
                cell = results[result]
                for warning in read_json(cell.directory / "training.json")["warnings"]:
                    console.print(f"{cell.name}: {warning}", style="yellow", markup=False)
                console.print(f"{cell.name}: done", markup=False, highlight=False)
                done(count)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def _workers(count: int) -> Iterator[ProcessPoolExecutor]:
    # A fresh process for each: threads and random numbers of one training cannot touch another's.
    with ProcessPoolExecutor(count, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        yield pool


def _make(cell: Cell, device: str, force: bool) -> None:
    torch.set_num_threads(1)
    with threadpool_limits(1):
        if force and (cell.directory / "cell.json").exists():
            shutil.rmtree(cell.directory)
        cell.run(device)


def finish(plan: Plan, task: str, *, console: Console) -> None:
    """The results of a task from its cells."""
    study = STUDIES[task]
    measured = [preset for preset in ABLATIONS[task] if _is_there(plan.cells(task, preset))]
    runs: dict[str, list[dict[str, Any]]] = {
        preset: [cell.read() for cell in plan.cells(task, preset)]
        for preset in [*PRESETS[task], *BESIDE[task], *measured]
    }
    summaries = {preset: summary(found) for preset, found in runs.items()}
    for preset in PRESETS[task]:
        directory = plan.directory(task, preset)
        directory.mkdir(parents=True, exist_ok=True)
        beside = {name: summaries[name] for name in BESIDE[task]} if preset == "default" else {}
        write_json(directory / "metrics.json", {**summaries[preset], **({"beside": beside} if beside else {})})
        subject = plan.cells(task, preset)[0].subject()
        for picture in study.draw(subject):
            picture.write(directory)
        for name, animation in study.animations(subject).items():
            save_animation(animation, directory / name)
        console.print(f"{task}, {preset}: {directory}", markup=False, highlight=False)
    home = plan.directory(task, "default")
    for picture in study.draw_across(runs):
        picture.write(home)
    shown = {name: summaries[name] for name in [*PRESETS[task], *BESIDE[task]]}
    write_table(shown, study.title, plan.command, home / "README.md")
    if measured:
        table = {name: summaries[name] for name in ["default", *measured]}
        for name, base in BASES[task].items():
            if {name, base} <= table.keys():
                table[name] = {**table[name], f"less_{base}": less(runs[name], runs[base])}
        write_json(home / "ablations.json", table)
        command = plan.command if plan.ablations else f"{plan.command} --ablations"
        write_table(table, f"{study.title}: one thing changed at a time", command, home / "ablations.md")


def _is_there(cells: Sequence[Cell]) -> bool:
    """Whether all of these are measured, and are what is asked for now."""
    try:
        return all(cell.is_measured() for cell in cells)
    except CellError:
        return False
