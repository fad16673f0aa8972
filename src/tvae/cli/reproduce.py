"""`tvae reproduce`."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path
from typing import Literal

from tvae.cli.options import CONSOLE, Count, Device, Flag, Force
from tvae.experiments.reproduction.cells import Effort
from tvae.experiments.reproduction.reproduce import TASKS, Plan
from tvae.experiments.reproduction.reproduce import reproduce as run

CORES = os.cpu_count() or 1


def reproduce(
    task: Literal["navigation", "circle", "zombie", "all"],
    *,
    out: Path = Path("results"),
    seeds: Count = 5,
    ablations: Flag = False,
    steps: Count | None = None,
    episodes: Count = 1000,
    jobs: Count = CORES,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Reproduce the paper: train our default and the paper's reading of a task, measure, draw its figures.

    A training that is there already is not made again, so that a killed command goes on where it was, and seeds or
    ablations can be added later.

    Parameters
    ----------
    task
        One of the paper's three tasks, or all of them.
    out
        Where results go: TASK/ (our default), TASK/paper/, and cells/ with each training.
    seeds
        How many seeds, from 0 on.
    ablations
        Train the ablations as well, and with fewer and more demonstrations (zombie).
    steps
        Training steps, instead of what each preset says; for a quick look.
    episodes
        Fresh episodes of each bot.
    jobs
        Trainings at a time, each on one core; by default as many as there are cores.
    """
    plan = Plan(
        tasks=TASKS if task == "all" else (task,),
        out=out,
        num_seeds=seeds,
        effort=Effort(steps, episodes),
        ablations=ablations,
        command=shlex.join(["tvae", *sys.argv[1:]]),
    )
    run(plan, jobs=jobs, device=device, force=force, console=CONSOLE)
