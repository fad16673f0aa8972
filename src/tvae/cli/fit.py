"""`tvae fit`."""

from __future__ import annotations

import sys

from tvae.cli.options import (
    COLUMNS,
    CONSOLE,
    MODEL,
    POLICY,
    TRAINING,
    Columns,
    Count,
    Device,
    Flag,
    Force,
    Out,
    Seed,
)
from tvae.cli.tracking import TRACKING, Tracking
from tvae.config import ModelConfig, PolicyConfig, RunConfig, TrainingConfig
from tvae.errors import TvaeError
from tvae.experiments.arenas import Arena
from tvae.experiments.resuming import check_resumed
from tvae.experiments.run import complete, new_run, resumed_run
from tvae.experiments.source import Source


def fit(
    data: str | None = None,
    *,
    out: Out,
    env: str | None = None,
    episodes: Count | None = None,
    columns: Columns = COLUMNS,
    group: str | None = None,
    seed: Seed = 0,
    device: Device = "auto",
    resume: Flag = False,
    force: Force = False,
    tracking: Tracking = TRACKING,
    model: ModelConfig = MODEL,
    training: TrainingConfig = TRAINING,
    policy: PolicyConfig = POLICY,
) -> None:
    """Train on demonstrations, find and describe their styles, write a report.

    Parameters
    ----------
    data
        A table, a pattern of files, a directory, or a Minari id; not needed with --resume.
    env
        Gymnasium id of an environment in which the bot of each style is tried, or MODULE:NAME of a parallel
        environment of PettingZoo, in which all players are bots of that style.
    episodes
        Test episodes of each bot; 1000 by default.
    group
        Attribute whose groups, such as pairs of players, stay whole when demonstrations are held out.
    resume
        Go on with the run in --out where it was killed, as it was configured.
    """
    trackers = tracking.trackers()
    config = RunConfig(model=model, training=training, policy=policy, seed=seed, group=group)
    if resume:
        check_resumed(out, config, force=force, data=data, reading=columns, env=env, episodes=episodes)
        begun = resumed_run(out, env)
    elif data is None:
        raise TvaeError("tvae fit needs a data set, or --resume to go on with the run in --out")
    elif env is None and episodes is not None:
        raise TvaeError(f"--episodes {episodes} are those of bots in an environment: name it with --env")
    else:
        arena = None if env is None else Arena(env, episodes=episodes or Arena.episodes)
        begun = new_run(
            out, Source(data, columns), config, arena, command=sys.argv, device=device, force=force
        )
    complete(begun, device=device, console=CONSOLE, trackers=trackers)
