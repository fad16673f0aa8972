"""What can be done with a finished run: imagine, act, label other sessions, measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.device import resolve_device
from tvae.errors import TvaeError
from tvae.evaluate.playstyles import Playstyles, Style
from tvae.experiments.arenas import Arena
from tvae.experiments.bots import bot_episodes
from tvae.experiments.fitting import About, about_run
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import RunDirectory, read_json
from tvae.generate.decoding import Choice
from tvae.generate.open_loop import imagine
from tvae.model.tvae import TrajectoryVAE


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run with its model and its styles."""

    directory: RunDirectory
    about: About
    model: TrajectoryVAE
    playstyles: Playstyles
    words: dict[str, list[str]]
    """Sentences of each style, by its number."""

    def style(self, name: str) -> Style:
        """The style of this number, name or label; `TvaeError` says which there are."""
        labels = self.playstyles.labels
        for style in self.playstyles.styles:
            if name in {str(style.index), style.name, labels.get(style.index)}:
                return style
        there = ", ".join(str(labels.get(s.index, s.index)) for s in self.playstyles.styles)
        raise TvaeError(f"there is no style {name!r}; there are: {there}")


def open_run(path: Path, device: str) -> FinishedRun:
    """The run in a directory; `TvaeError` if it is none or did not end."""
    directory = RunDirectory.existing(path)
    found = read_json(directory.playstyles)
    return FinishedRun(
        directory,
        about_run(directory),
        TrajectoryVAE.load(path).to(resolve_device(device)),
        Playstyles.from_json(found["playstyles"]),
        found["words"],
    )


def act(
    run: FinishedRun,
    style: str,
    arena: Arena | None,
    *,
    choice: Choice,
    window: int | None,
    seed: int,
    console: Console,
) -> Demonstrations:
    """Episodes of a style's bot, in `arena` or else the one of the run."""
    arena = arena or run.about.arena
    if arena is None:
        raise TvaeError("the run knows no environment; name one with --env")
    with counting("episodes", arena.episodes, console) as done:
        return bot_episodes(
            run.model, run.style(style), arena, choice=choice, window=window, seed=seed, on_step=done
        )


def imagine_style(
    run: FinishedRun, style: str, num_episodes: int, *, choice: Choice, window: int | None, seed: int
) -> Demonstrations:
    """Episodes of a style that the decoders imagine, from first observations of its demonstrations."""
    demonstrations = run.about.source.load()
    rng = np.random.default_rng(seed)
    chosen = run.style(style)
    assigned = run.playstyles.assignment
    members = np.flatnonzero(assigned == chosen.index)
    starts = demonstrations.observation_starts[rng.choice(members, num_episodes)]
    return imagine(
        run.model,
        demonstrations.observations[starts],
        chosen.sample(num_episodes, rng),
        num_steps=int(demonstrations.lengths.max()),
        choice=choice,
        window=window,
        seed=seed,
    )


def read_for(run: FinishedRun, source: str) -> Demonstrations:
    """Other demonstrations, read as the model's spaces say; `DataError` where they do not fit."""
    demonstrations = load_demonstrations(
        source, observation_space=run.model.observation_space, action_space=run.model.action_space
    )
    return replace_segments(demonstrations, run.about)
