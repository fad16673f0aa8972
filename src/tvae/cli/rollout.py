"""`tvae rollout`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from tvae.cli.options import CONSOLE, Count, Device, Flag, Force, Run, Seed, Styles, choice_of
from tvae.data.sources import save_demonstrations
from tvae.errors import TvaeError
from tvae.experiments.fitting import demonstrations_of
from tvae.experiments.targets import check_demonstrations
from tvae.experiments.using import act, open_run
from tvae.generate.closed_loop import LatentPolicy
from tvae.generate.restless import Restless
from tvae.model.decoding import LatentSource
from tvae.rollouts import Policy


def rollout(
    run: Run,
    *,
    out: Path,
    style: Styles = ("0",),
    env: str | None = None,
    episodes: Count | None = None,
    window: Count | None = None,
    most_likely: Flag = False,
    temperature: float | None = None,
    restless: Flag = False,
    seed: Seed = 0,
    device: Device = "auto",
    force: Force = False,
) -> None:
    """Let the bot of a style act in an environment, and write its episodes as demonstrations.

    Parameters
    ----------
    out
        Where to write them: a .parquet or .csv file, a .tvae directory, or minari:ID.
    env
        Gymnasium id, or MODULE:NAME of a parallel environment of PettingZoo, in which all players are bots of the
        style; by default the environment in which the run tried its bots.
    episodes
        How many; by default as many as the run's bots played.
    window
        Rolling window: the most past states that the bot remembers; by default as in training.
    most_likely
        Always take the most likely action instead of drawing one.
    temperature
        T > 0: draw from p^(1/T) instead of p. Below 1 nearer to the most likely and less varied, 1 as learnt.
    restless
        Try something else where nothing new has been seen for longer than in the run's demonstrations.
    """
    check_demonstrations(out, overwrite=force)
    opened = open_run(run, device)
    arena = opened.arena(env)
    if episodes is not None:
        arena = replace(arena, episodes=episodes)
    choice = choice_of(most_likely=most_likely, temperature=temperature)
    bot: Callable[[LatentSource], Policy] = partial(LatentPolicy, opened.model, choice=choice, window=window)
    if restless:
        if most_likely:
            raise TvaeError("--most-likely draws nothing, so that --restless cannot try something else")
        recorded = demonstrations_of(opened.directory)
        bot = partial(
            Restless, opened.model, demonstrations=recorded, temperature=temperature or 1.0, window=window
        )
    found = act(opened, style, arena, bot, seed=seed, console=CONSOLE)
    save_demonstrations(found, out, overwrite=force)
    CONSOLE.print(f"{len(found)} episodes, {found.num_steps} steps: {out}", markup=False)
