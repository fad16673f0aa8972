"""The whole benchmark: make the cells that are not there yet, then the table and the figure from all of them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

import torch
from rich.console import Console
from threadpoolctl import threadpool_limits

from tvae.errors import TvaeError
from tvae.experiments.benchmark.cells import BenchmarkCell, Budget
from tvae.experiments.benchmark.methods import METHODS
from tvae.experiments.benchmark.playing import left_out, obstacle
from tvae.experiments.benchmark.stored import asked_of, name_of, require_one_table, stored
from tvae.experiments.benchmark.table import markdown, panels, summaries, write_csv
from tvae.experiments.benchmark.tasks import PAPER, TASKS
from tvae.experiments.progress import counting
from tvae.figures.benchmark import benchmark_figure
from tvae.figures.canvas import save
from tvae.files import appearing


@dataclass(frozen=True)
class Plan:
    """What to compare, where, and how thoroughly.

    OUT/cells/TASK/METHOD/seed-K/metrics.json holds a cell, one-in-P/metrics.json beside it that of a shorter training;
    OUT/README.md, OUT/benchmark.csv and OUT/benchmark.png (and .svg) what comes of all that are there, also those of
    earlier plans.

    A method is left out of a task that it cannot play (`tvae.experiments.benchmark.playing`). Raises `TvaeError` for a
    task or a method that there is not, and where there is nothing to do; the message says which there are, or why.
    """

    out: Path
    seeds: Sequence[int]
    tasks: Sequence[str] = PAPER
    methods: Sequence[str] = tuple(METHODS)
    budget: Budget = field(default_factory=Budget)
    finished: Path = Path("results/cells")
    data: Path = Path("data")
    parts: Sequence[int] = (1,)
    """Of its own gradient steps a method takes one in so many, in a cell for each of these."""
    command: str = "tvae benchmark"

    def __post_init__(self) -> None:
        for what, given, there in (("task", self.tasks, TASKS), ("method", self.methods, METHODS)):
            unknown = [name for name in given if name not in there]
            if unknown:
                raise TvaeError(f"there is no {what} {', '.join(unknown)}; there are: {', '.join(there)}")
        if not self.seeds:
            raise TvaeError("a benchmark needs at least one seed, got none")
        if not self.all_cells():
            why = "; ".join(left_out(self.methods, self.tasks))
            raise TvaeError(f"none of {', '.join(self.methods)} plays {', '.join(self.tasks)}: {why}")

    def methods_of(self, task: str) -> list[str]:
        """Those of the methods that play this task, in the order of the table."""
        return [name for name in METHODS if name in self.methods and obstacle(name, task) is None]

    def cells(self, task: str, method: str) -> list[BenchmarkCell]:
        """One for each seed and part; who learns nothing has no shorter training."""
        home, parts = self.out / "cells" / task / method, self.parts if METHODS[method].learns else (1,)
        return [
            BenchmarkCell(
                method,
                task,
                seed,
                home / f"seed-{seed}" / ("" if one_in == 1 else f"one-in-{one_in}"),
                self.budget,
                self.finished,
                self.data,
                one_in,
            )
            for seed in self.seeds
            for one_in in parts
        ]

    def all_cells(self) -> list[BenchmarkCell]:
        """Of all tasks and methods."""
        return [cell for task in self.tasks for method in self.methods_of(task) for cell in self.cells(task, method)]


def benchmark(plan: Plan, *, jobs: int, force: bool, console: Console) -> None:
    """Do all of `plan`, `jobs` cells at a time, each on one core; with `force` make its cells anew.

    Raises `CellError` before anything is learnt where a stored cell is another one than asked for, or where all cells
    would not stand in one table.
    """
    for sentence in left_out(plan.methods, plan.tasks):
        console.print(sentence, markup=False, highlight=False)
    cells = plan.all_cells()
    waiting = cells if force else [cell for cell in cells if not cell.is_measured()]
    made_anew = {cell.name for cell in waiting}
    kept = [asked for asked in asked_of(stored(plan.out)) if name_of(asked) not in made_anew]
    require_one_table([*kept, *(cell.asked for cell in waiting)])
    console.print(f"{len(cells)} cells, {len(cells) - len(waiting)} of them done already")
    make(waiting, jobs=jobs, console=console)
    write(plan)
    console.print(f"{plan.out / 'README.md'}", markup=False, highlight=False)


def make(cells: Sequence[BenchmarkCell], *, jobs: int, console: Console) -> None:
    """Make these cells, each in a process of its own; after the first that fails no other is begun."""
    workers = ProcessPoolExecutor(min(jobs, max(len(cells), 1)), mp_context=get_context("spawn"), max_tasks_per_child=1)
    with counting("cells", len(cells), console) as done, workers as pool:
        results = {pool.submit(_make, cell): cell for cell in cells}
        try:
            for count, result in enumerate(as_completed(results), 1):
                result.result()
                console.print(f"{results[result].name}: done", markup=False, highlight=False)
                done(count)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _make(cell: BenchmarkCell) -> None:
    torch.set_num_threads(1)
    with threadpool_limits(1):
        cell.run()


def write(plan: Plan) -> None:
    """`README.md`, `benchmark.csv` and the figure, from all cells that there are, those of earlier plans too."""
    runs = stored(plan.out)
    if not runs:
        raise TvaeError(f"there is no cell under {plan.out / 'cells'}")
    write_csv(runs, plan.out / "benchmark.csv")
    with appearing(plan.out / "README.md", overwrite=True) as partial:
        partial.write_text(markdown(runs, plan.command), encoding="utf-8")
    caption = "dots: means over seeds, lines: 95 % intervals; open: one seed; †: cannot be asked for a style"
    save(benchmark_figure(panels(summaries(runs)), caption=caption), plan.out / "benchmark")
