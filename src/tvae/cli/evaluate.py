"""`tvae evaluate`."""

from __future__ import annotations

from dataclasses import replace

from tvae.cli.options import CONSOLE, Count, Device, Run, Seed
from tvae.errors import TvaeError
from tvae.experiments.bots import try_bots
from tvae.experiments.evaluation import compare_without_latent
from tvae.experiments.tables import metrics_table
from tvae.experiments.using import open_run

_EPISODES = 1000


def evaluate(
    run: Run,
    *,
    env: str | None = None,
    episodes: Count | None = None,
    samples: Count = 64,
    seed: Seed = 1,
    device: Device = "auto",
) -> None:
    """Measure a run: held-out likelihood with z against the same model trained without, and its bots.

    Parameters
    ----------
    env
        Gymnasium id, or MODULE:NAME of a parallel environment of PettingZoo; by default the environment in which the
        run tried its bots, if any.
    episodes
        Test episodes of each bot; 1000 if not given.
    samples
        Samples of z in the importance-weighted bound.
    """
    opened = open_run(run, device)
    arena = None if opened.about.arena is None and env is None else opened.arena(env)
    if arena is None and episodes is not None:
        raise TvaeError("episodes are played in an environment, and this run names none: name it with --env")
    compare_without_latent(opened, num_samples=samples, device=device, console=CONSOLE)
    if arena is not None:
        arena = replace(arena, episodes=episodes or _EPISODES)
        try_bots(opened.directory, opened.model, opened.findings, arena, seed=seed, console=CONSOLE)
    CONSOLE.print(metrics_table(opened))
