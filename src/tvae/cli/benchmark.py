"""`tvae benchmark`."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from tvae.cli.options import CONSOLE, Count, Flag, Force
from tvae.experiments.benchmark.benchmark import Plan
from tvae.experiments.benchmark.benchmark import benchmark as run
from tvae.experiments.benchmark.cells import QUICK, Budget
from tvae.experiments.benchmark.methods import METHODS
from tvae.experiments.benchmark.sooner import PARTS
from tvae.experiments.benchmark.tasks import PAPER

CORES = os.cpu_count() or 1
Names = Annotated[tuple[str, ...], Parameter(negative="", consume_multiple=True)]


def benchmark(
    *,
    out: Path,
    seeds: Count = 5,
    seed: Annotated[int, Parameter(validator=Number(gte=0, lt=2**32))] = 0,
    tasks: Names = PAPER,
    methods: Names = tuple(METHODS),
    shorter: Flag = False,
    quick: Flag = False,
    steps: Count | None = None,
    episodes: Count | None = None,
    cells: Path = Path("results/cells"),
    data: Path = Path("data"),
    jobs: Count = CORES,
    force: Force = False,
) -> None:
    """Compare methods on the same demonstrations, in the same worlds, by the same measures.

    A cell (method, task, seed) that is there already is not made again, so that a killed command goes on where it
    was, and seeds, tasks or methods can be added later.

    Parameters
    ----------
    out
        Where the table, the figure and cells/ go.
    seeds
        How many seeds.
    seed
        The first of them. Whoever tunes a method does so on seeds from 100 on, which are not reported.
    tasks
        Which tasks: the paper's three by default; `pusht` and `overcooked` are the recordings of people.
    methods
        Which methods; one that cannot play a task is left out of it, and it is said why.
    shorter
        Also with an eighth, a quarter and half of each method's gradient steps: how soon is it nearly as good?
    quick
        One seed, 30 gradient steps, a twentieth of the episodes: to see that all of it works.
    steps
        The most gradient steps of any method; by default each has its own number.
    episodes
        Fresh episodes of each bot; by default each task has its own number, 1000 in the paper's, 200 and 100 in
        those of people.
    cells
        Where finished cells of `tvae reproduce` lie, which our own method reads instead of training.
    data
        The folder in which the recordings of people lie.
    jobs
        Cells at a time, each on one core.
    """
    budget = QUICK if quick else Budget()
    if steps is not None:
        budget = replace(budget, most_steps=steps)
    if episodes is not None:
        budget = replace(budget, episodes=episodes)
    plan = Plan(
        out=out,
        seeds=range(seed, seed + (1 if quick else seeds)),
        tasks=tasks,
        methods=methods,
        budget=budget,
        finished=cells,
        data=data,
        parts=(1, *PARTS) if shorter else (1,),
        command=shlex.join(["tvae", *sys.argv[1:]]),
    )
    run(plan, jobs=jobs, force=force, console=CONSOLE)
