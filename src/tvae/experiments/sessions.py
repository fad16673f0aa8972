"""What an analyst asks of a trained model: where sessions lie, how likely they are, which are alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rich.console import Console

from tvae.data.demonstrations import Demonstrations
from tvae.device import resolve_device
from tvae.errors import TvaeError
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.scores import Scores, score
from tvae.evaluate.similarity import nearest, overlap
from tvae.evaluate.styles import Playstyles
from tvae.experiments.analysis import episode_names
from tvae.experiments.fitting import About, about_run, demonstrations_of, split
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import RunDirectory, read_json
from tvae.experiments.source import Source
from tvae.experiments.targets import check_table, write_table
from tvae.model.tvae import TrajectoryVAE
from tvae.pretrained import pretrained_directory

_MOST_NAMES = 8


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained model: that of a run, or one that comes with the package."""

    directory: Path
    model: TrajectoryVAE
    about: About | None
    """What the run knows of itself; nothing where a model was saved without a run."""

    def sessions(self, data: str | None) -> Demonstrations:
        """Sessions at `data`, read as the run's own were, or without it the run's own.

        Raises `DataError` for other signals than the model's, `TvaeError` where there is no run to know its own, and as
        `demonstrations_of` does where its own are no longer the same.
        """
        spaces = (self.model.observation_space, self.model.action_space)
        if self.about is not None:
            own = RunDirectory(self.directory)
            return demonstrations_of(own) if data is None else self.about.source.load_others(data, *spaces)
        if data is None:
            raise TvaeError(f"{self.directory} holds a model without a run, which knows no sessions: name a data set")
        return Source(data).load(*spaces)


def open_trained(name: str, device: str) -> Trained:
    """The run or model in a directory, or the shipped model of this name; `ModelError` for what is neither."""
    directory = pretrained_directory(name)
    model = TrajectoryVAE.load(directory).to(resolve_device(device))
    run = RunDirectory(directory)
    return Trained(directory, model, about_run(run) if "run" in read_json(run.config) else None)


def position_of(sessions: Demonstrations, session: str) -> int:
    """Where the session of this name is; `TvaeError` says which there are."""
    names = episode_names(sessions).astype(str)
    found = np.flatnonzero(names == session)
    if len(found) == 0:
        first = ", ".join(names[:_MOST_NAMES])
        more = f", ... to {names[-1]}" if len(names) > _MOST_NAMES else ""
        raise TvaeError(f"there is no session {session!r}; there are {len(names)}: {first}{more}")
    return int(found[0])


def _facts(sessions: Demonstrations, columns: Iterable[str]) -> dict[str, NDArray[Any]]:
    """`episode` and the other attributes; one that is called like one of `columns` becomes `recorded.NAME`."""
    taken = set(columns)
    attributes = {
        f"recorded.{name}" if name in taken else name: values for name, values in sessions.attributes.items()
    }
    return {"episode": episode_names(sessions), **{n: v for n, v in attributes.items() if n != "episode"}}


def embedding_table(sessions: Demonstrations, posteriors: Posteriors, playstyles: Playstyles) -> pa.Table:
    """One row per session: `episode`, its attributes, `z_0` ..., `scale_0` ..., `style`, `probability`.

    z is the posterior mean, scale the posterior's standard deviation. An attribute that is called like one of these
    columns is there as `recorded.NAME`.
    """
    style, probability = playstyles.assign(posteriors)
    found = {
        **{f"z_{index}": values for index, values in enumerate(posteriors.means.T)},
        **{f"scale_{index}": values for index, values in enumerate(posteriors.scales.T)},
        "style": style,
        "probability": probability,
    }
    return pa.table({**_facts(sessions, found), **found})


def embed(trained: Trained, data: str | None, out: Path, *, overwrite: bool) -> int:
    """Write `embedding_table`; how many sessions there are. Raises as `check_table` does, before anything is read."""
    check_table(out, overwrite=overwrite)
    playstyles = Playstyles.load(trained.directory)
    sessions = trained.sessions(data)
    write_table(embedding_table(sessions, encode(trained.model, sessions), playstyles), out, overwrite=overwrite)
    return len(sessions)


def similar_table(trained: Trained, data: str | None, session: str, *, count: int) -> pa.Table:
    """The `count` sessions nearest to `session`, nearest first: a row each, itself left out.

    Columns: `episode`, its attributes, `distance` in nats, `overlap`, `style`, `probability`, `steps`.
    """
    playstyles = Playstyles.load(trained.directory)
    sessions = trained.sessions(data)
    at = position_of(sessions, session)
    posteriors = encode(trained.model, sessions)
    chosen, distance = nearest(posteriors, at, count)
    alike = sessions.select(chosen)
    style, probability = (values[chosen] for values in playstyles.assign(posteriors))
    found = {
        "distance": distance,
        "overlap": overlap(distance),
        "style": style,
        "probability": probability,
        "steps": alike.lengths,
    }
    return pa.table({**_facts(alike, found), **found})


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of sessions, and of what they are compared with."""

    names: NDArray[Any]
    """(N,) the sessions"""
    columns: tuple[str, ...]
    """What the columns of `Scores.signals` are called"""
    scores: Scores
    reference: Scores
    reference_words: str
    """What the reference is"""


def scores_table(model: TrajectoryVAE, sessions: Demonstrations, scores: Scores) -> pa.Table:
    """One row per step, in nats; `tvae.evaluate.scores` has the formulas.

    | column            | what                                                                                |
    |-------------------|-------------------------------------------------------------------------------------|
    | `episode`, `step` | which                                                                               |
    | `action`          | log pi(a_t given s_1..t, z)                                                         |
    | `action.NAME`     | the marginal of a signal                                                            |
    | `state`           | log p(s_t+1 given s_1..t, z); empty where the next state was not recorded           |
    | `observation.NAME`| the marginal of a signal of the next state                                          |
    | `end`             | log p(end_t given s_1..t, z), of a model that has it                                |
    | `event.NAME`      | log p(E given z), whether an event occurs in the session: in step 0, empty elsewhere |

    The sum of `action` and `event.*` over a session is its policy term, that of `state` its state term.
    """
    rows = np.repeat(np.arange(len(sessions)), scores.lengths)
    step = np.arange(len(rows)) - scores.starts[rows]

    def known(values: NDArray[Any]) -> pa.Array:
        return pa.array(values, from_pandas=True)  # NaN becomes empty

    table: dict[str, Any] = {"episode": episode_names(sessions)[rows], "step": step, "action": scores.action}
    for index, name in enumerate(model.action_space.names):
        table[f"action.{name}"] = scores.action_signals[:, index]
    table["state"] = known(scores.state)
    for index, name in enumerate(model.observation_space.names):
        table[f"observation.{name}"] = known(scores.observation_signals[:, index])
    if model.stop:
        table["end"] = scores.end
    for index, column in enumerate(model.events.columns.tolist()):
        first = np.where(step == 0, scores.events[rows, index], np.nan)
        table[f"event.{model.action_space.names[column]}"] = known(first)
    return pa.table(table)


def score_sessions(
    trained: Trained, data: str | None, out: Path, *, overwrite: bool, console: Console
) -> Scored:
    """Write `scores_table`, and score what the sessions are compared with.

    That is the run's held-out demonstrations where it can read them, else the sessions themselves. Raises as
    `check_table` does, before anything is read.
    """
    check_table(out, overwrite=overwrite)
    model = trained.model
    sessions = trained.sessions(data)
    scores = _score(model, sessions, "sessions", console)
    write_table(scores_table(model, sessions, scores), out, overwrite=overwrite)
    columns = (
        *(f"action.{name}" for name in model.action_space.names),
        *(f"observation.{name}" for name in model.observation_space.names),
        "end",
    )
    names = episode_names(sessions)
    themselves = Scored(names, columns, scores, scores, "these sessions themselves")
    if trained.about is None:
        return themselves
    try:
        _, held_out = split(trained.sessions(None), trained.about.config)
    except (TvaeError, OSError) as error:
        console.print(f"the run's own demonstrations cannot be read: {error}", markup=False, highlight=False)
        return themselves
    reference = _score(model, held_out, "held-out demonstrations", console)
    return replace(themselves, reference=reference, reference_words="the run's held-out demonstrations")


def _score(model: TrajectoryVAE, sessions: Demonstrations, what: str, console: Console) -> Scores:
    with counting(what, len(sessions), console) as done:
        return score(model, sessions, on_episodes=done)
