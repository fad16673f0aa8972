"""`tvae demo`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from tvae.cli.options import CONSOLE, Device, Flag, Force, Seed
from tvae.cli.tracking import TRACKING, Tracking
from tvae.config import RunConfig
from tvae.experiments.resuming import check_resumed
from tvae.experiments.run import complete, new_recipe_run, resumed_run
from tvae.experiments.tasks import TASKS

_TASK = "zombie"


def demo(
    task: Literal["zombie", "navigation", "circle", "pusht", "overcooked"] | None = None,
    *,
    out: Path | None = None,
    data: Path | None = None,
    seed: Seed = 0,
    device: Device = "auto",
    resume: Flag = False,
    force: Force = False,
    tracking: Tracking = TRACKING,
) -> None:
    """Run a whole example: unlabelled demonstrations become styles, a bot for each, and a page to look at.

    Parameters
    ----------
    task
        zombie: scripted demonstrators, attack or avoid. navigation: walks to three hidden goals. circle: walks
        around three hidden circles. pusht: 206 human demonstrations of pushing a block. overcooked: human pairs
        cooking together. If not given, zombie.
    out
        The run directory to make; runs/TASK if not given.
    data
        The file of the human demonstrations, of pusht and overcooked; by default the one in data/.
    resume
        Go on with the run in --out where it was killed.
    """
    directory = out or Path("runs") / (task or _TASK)
    trackers = tracking.trackers()
    if resume:
        title = None if task is None else TASKS[task](data, seed).title
        asked = None if data is None else str(data)
        check_resumed(directory, RunConfig(seed=seed), force=force, title=title, data=asked)
        begun = resumed_run(directory)
    else:
        recipe = TASKS[task or _TASK](data, seed)
        begun = new_recipe_run(directory, recipe, command=sys.argv, device=device, force=force)
    complete(begun, device=device, console=CONSOLE, trackers=trackers)
