"""What can be done with a finished run: imagine, act, label other sessions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from tvae.data.demonstrations import Demonstrations
from tvae.device import resolve_device
from tvae.errors import TvaeError
from tvae.evaluate.encoding import encode
from tvae.evaluate.styles import one_of
from tvae.experiments.analysis import likelihood_per_step, styles_table
from tvae.experiments.arenas import Arena
from tvae.experiments.bots import bot_episodes
from tvae.experiments.findings import Findings, read_findings
from tvae.experiments.fitting import About, about_run, demonstrations_of
from tvae.experiments.parallel import named_again
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.targets import write_table
from tvae.generate.open_loop import imagine
from tvae.model.decoding import Choice, LatentSource
from tvae.model.tvae import TrajectoryVAE
from tvae.rollouts import Policy
from tvae.spaces import IntArray


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run with its model and what it found."""

    directory: RunDirectory
    about: About
    model: TrajectoryVAE
    findings: Findings

    def arena(self, env: str | None) -> Arena:
        """The environment `env`; by default where its bots were tried, `TvaeError` if nowhere or by code of its own."""
        if env is not None:
            return Arena(env)
        if self.about.arena is None:
            raise TvaeError("the run knows no environment; name one with --env")
        return named_again(self.about.arena, env)


def open_run(path: Path, device: str) -> FinishedRun:
    """The run in a directory; `TvaeError` if it is none or did not end."""
    directory = RunDirectory.existing(path)
    return FinishedRun(
        directory,
        about_run(directory),
        TrajectoryVAE.load(path).to(resolve_device(device)),
        read_findings(directory.playstyles),
    )


def act(
    run: FinishedRun,
    styles: Sequence[str],
    arena: Arena,
    bot: Callable[[LatentSource], Policy],
    *,
    seed: int,
    console: Console,
) -> Demonstrations:
    """Episodes in `arena` of the bot that gets z from a style; of several, each episode from one of them."""
    latents = one_of(run.findings.several(styles))
    with counting("episodes", arena.episodes, console) as done:
        return bot_episodes(run.model, partial(bot, latents), arena, seed=seed, on_step=done)


def imagine_style(
    run: FinishedRun, styles: Sequence[str], num_episodes: int, *, choice: Choice, window: int | None, seed: int
) -> Demonstrations:
    """Episodes of a style, or of several, that the decoders imagine, from first observations of its demonstrations."""
    demonstrations = demonstrations_of(run.directory)
    chosen = run.findings.several(styles)
    rng = np.random.default_rng(seed)
    members = np.flatnonzero(np.isin(run.findings.playstyles.assignment, [style.index for style in chosen]))
    starts = demonstrations.observation_starts[rng.choice(members, num_episodes)]
    return imagine(
        run.model,
        demonstrations.observations[starts],
        one_of(chosen).sample(num_episodes, rng),
        num_steps=int(demonstrations.lengths.max()),
        choice=choice,
        window=window,
        seed=seed,
    )


def label(run: FinishedRun, source: str, out: Path | None, *, overwrite: bool, console: Console) -> IntArray:
    """The style (N,) of other sessions, read as the run's own were; with `out`, also as a table."""
    model = run.model
    sessions = run.about.source.load_others(source, model.observation_space, model.action_space)
    posteriors = encode(model, sessions)
    assignment, probability = run.findings.playstyles.assign(posteriors)
    if out is not None:
        likelihood = likelihood_per_step(model, sessions, seed=0, console=console)
        table = styles_table(sessions, posteriors, assignment, probability, likelihood=likelihood)
        write_table(table, out, overwrite=overwrite)
    return assignment
