"""Whether a run goes on as it is asked to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from tvae.config import RunConfig
from tvae.errors import TvaeError
from tvae.experiments.fitting import about_run
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.source import AS_IT_IS, Reading, Source


def check_resumed(
    out: Path,
    config: RunConfig,
    *,
    force: bool,
    title: str | None = None,
    data: str | None = None,
    reading: Reading = AS_IT_IS,
    env: str | None = None,
    episodes: int | None = None,
) -> None:
    """Raise `TvaeError` for what is asked otherwise than the run in `out` was configured, with both.

    What is as by default was not asked for.
    """
    if force:
        raise TvaeError("--resume goes on with the run in --out, --force replaces it: give one of them, not both")
    about = about_run(RunDirectory.existing(out))
    kept_env, kept_episodes = (None, None) if about.arena is None else (about.arena.env, about.arena.episodes)
    told = {
        "the task": (title, about.title),
        "the data set": (None if data is None else Source(data).absolute().path, about.source.path),
        "--env": (env, kept_env),
        "--episodes": (episodes, kept_episodes),
    }
    others = [f"{name} {asked} (there: {kept})" for name, (asked, kept) in told.items() if asked not in (None, kept)]
    others += differences(reading, AS_IT_IS, about.source.reading)
    others += differences(config, RunConfig(), about.config)
    if others:
        raise TvaeError(
            f"--resume goes on with the run in {out} as it was configured, which is not with {', '.join(others)}; "
            "leave this out, or begin another run in another --out"
        )


def differences(asked: Any, usual: Any, kept: Any, prefix: str = "--") -> Iterator[str]:
    """The options in which `asked` is neither as by default nor as kept, with both values.

    >>> from tvae.config import TrainingConfig
    >>> asked = RunConfig(seed=3, training=TrainingConfig(num_steps=5))
    >>> list(differences(asked, RunConfig(), RunConfig(seed=3)))
    ['--training.num-steps 5 (there: None)']
    """
    for name in (field.name for field in fields(asked)):
        option = prefix + name.replace("_", "-")
        one, by_default, there = (getattr(values, name) for values in (asked, usual, kept))
        if is_dataclass(one):
            yield from differences(one, by_default, there, f"{option}.")
        elif one not in (by_default, there):
            yield f"{option} {_text(one)} (there: {_text(there)})"


def _text(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
