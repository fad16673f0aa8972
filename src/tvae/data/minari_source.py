"""Minari data sets as demonstrations.

A data set is found by its id under Minari's root or as a directory. Nothing is downloaded, and no environment
is made: a data set that does not state its spaces is refused.
"""

from __future__ import annotations

import os
import re
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from minari.dataset.minari_storage import METADATA_FILE_NAME, MinariStorage
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.minari_notes import COLUMNS, ENTRY, FINAL_OBSERVED, MinariNotes
from tvae.data.names import is_asked_for
from tvae.data.trajectory import Attribute, DataError, Trajectory
from tvae.gymnasium_spaces import UnsupportedSpaceError, flatten, space_from_gymnasium
from tvae.spaces import Space

_ID = re.compile(r"([-\w]+/)*[-\w]+-v\d+")


def is_minari_id(text: str) -> bool:
    """Whether a text has the form of a Minari id.

    >>> is_minari_id("tvae/zombie/scripted-v0"), is_minari_id("sessions.csv")
    (True, False)
    """
    return _ID.fullmatch(text) is not None


def minari_root() -> Path:
    """Where Minari keeps its data sets: `MINARI_DATASETS_PATH`, else `~/.minari/datasets`."""
    given = os.environ.get("MINARI_DATASETS_PATH")
    return Path(given) if given else Path.home() / ".minari" / "datasets"


def find_minari(source: str | Path) -> Path | None:
    """The directory with the files of a Minari data set, given by directory or id; None if there is none."""
    directories = [Path(source)]
    if isinstance(source, str) and is_minari_id(source):
        directories.append(minari_root() / source)
    for directory in directories:
        for candidate in (directory / "data", directory):
            if (candidate / METADATA_FILE_NAME).is_file():
                return candidate
    return None


def read_minari(source: str | Path, columns: Sequence[str] = ()) -> Demonstrations:
    """Demonstrations from a Minari data set, given by its id or its directory; of `columns`, if any are given, the
    signals of those only, such as `observation.state` and `action`.

    Kept are rewards, terminations and truncations (step columns `reward`, `terminated`, `truncated`), infos
    that are one value a step (`info.NAME`; the one of the reset is dropped), and what the episodes' metadata
    says in one value (attributes; the id is `episode`).

    Raises `DataError` if there is no such data set, it is damaged, or its spaces are no vectors of numbers and
    `columns` does not leave the part out that is none.
    """
    directory = find_minari(source)
    if directory is None:
        raise DataError(f"{source}: no Minari data set there, nor under {minari_root()}")
    try:
        metadata = MinariStorage.read_raw_metadata(directory)
        for name in ("observation_space", "action_space", "data_format"):
            if not isinstance(metadata.get(name), str):
                raise DataError(f"the metadata must state {name!r}")
        storage = MinariStorage.read(directory)
        about = list(storage.get_episode_metadata(range(int(metadata["total_episodes"]))))
        if not about:
            raise DataError("needs at least one episode, got none")
        spaces = _Spaces.of(storage, columns)
        ours = MinariNotes.from_json(metadata[ENTRY]) if ENTRY in metadata else None
        notes = (ours or _notes_for(storage, spaces, about)).only(columns)
        return Demonstrations.from_trajectories(
            _episodes(storage, spaces, notes, about), notes.observation_space, notes.action_space
        )
    except UnsupportedSpaceError as error:
        raise DataError(
            f"{source}: {error}; name the parts to read instead (--only), such as action and observation.KEY"
        ) from error
    except DataError as error:
        raise DataError(f"{source}: {error}") from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError, AssertionError, RuntimeError) as error:
        raise DataError(f"{source}: cannot be read as a Minari data set: {error}") from error


@dataclass(frozen=True)
class _Spaces:
    """The spaces of a data set, without the parts of a Dict that are not read."""

    observation: gymnasium.Space[Any]
    action: gymnasium.Space[Any]

    @classmethod
    def of(cls, storage: MinariStorage, columns: Sequence[str]) -> _Spaces:
        return cls(
            _parts_read(storage.observation_space, "observation", columns),
            _parts_read(storage.action_space, "action", columns),
        )


def _parts_read(space: gymnasium.Space[Any], name: str, columns: Sequence[str]) -> gymnasium.Space[Any]:
    if not isinstance(space, gymnasium.spaces.Dict):
        return space
    parts = OrderedDict((key, f"{name}.{key}") for key in space.spaces if is_asked_for(f"{name}.{key}", columns))
    if not parts:
        there = ", ".join(f"{name}.{key}" for key in space.spaces)
        raise DataError(f"needs at least one part of {name}s to read; there are {there}")
    return gymnasium.spaces.Dict(
        OrderedDict((key, _parts_read(space.spaces[key], below, columns)) for key, below in parts.items())
    )


def _notes_for(storage: MinariStorage, spaces: _Spaces, about: list[dict[str, Any]]) -> MinariNotes:
    """How to read a data set that is not ours: all signals, infos and facts under their own names."""
    observation_space = _space("observation", spaces.observation)
    action_space = _space("action", spaces.action)
    first = next(iter(storage.get_episodes([0])))
    infos = _scalar_infos(first["infos"] or {}, len(first["rewards"]))
    common = set.intersection(*(set(_scalar_facts(entry)) for entry in about))
    return MinariNotes(
        observation_space=observation_space,
        action_space=action_space,
        observation_keys=observation_space.names,
        action_keys=action_space.names,
        columns=tuple(COLUMNS),
        infos={name: f"info.{name}" for name, _ in infos},
        attributes={"id": "episode", **{name: name for name in about[0] if name in common}},
    )


def _space(what: str, space: gymnasium.Space[Any]) -> Space:
    try:
        return space_from_gymnasium(space)
    except UnsupportedSpaceError as error:
        raise UnsupportedSpaceError(f"{what}s: {error}") from None


def _episodes(
    storage: MinariStorage, spaces: _Spaces, notes: MinariNotes, about: list[dict[str, Any]]
) -> Iterator[Trajectory]:
    observation_order = _order(spaces.observation, notes.observation_keys)
    action_order = _order(spaces.action, notes.action_keys)
    for index, episode in enumerate(storage.get_episodes(range(len(about)))):
        facts = {"id": index, **_scalar_facts(about[index])}
        observations = flatten(spaces.observation, episode["observations"])[:, observation_order]
        actions = flatten(spaces.action, episode["actions"])[:, action_order]
        if not about[index].get(FINAL_OBSERVED, True):
            observations = observations[: len(actions)]
        infos = dict(_scalar_infos(episode["infos"] or {}, len(actions)))
        try:
            yield Trajectory(
                observations,
                actions,
                steps={
                    **{name: np.asarray(episode[COLUMNS[name]]) for name in notes.columns},
                    **{name: infos[key] for key, name in notes.infos.items()},
                },
                attributes={name: facts[key] for key, name in notes.attributes.items()},
            )
        except DataError as error:
            raise DataError(f"episode {index}: {error}") from None
        except KeyError as error:
            raise DataError(f"episode {index}: lacks {error}, which other episodes have") from None


def _order(space: gymnasium.Space[Any], keys: Sequence[str]) -> list[int]:
    """Column of each of `keys` in a flattened value; Minari sorts the parts of a Dict."""
    columns = {name: column for column, name in enumerate(space_from_gymnasium(space).names)}
    return [columns[key] for key in keys]


def _scalar_facts(metadata: Mapping[str, Any]) -> dict[str, Attribute]:
    """What an episode's metadata says in one number or text, beyond what Minari says itself."""
    facts: dict[str, Attribute] = {}
    for name, value in metadata.items():
        plain = value.item() if isinstance(value, np.generic) else value
        if isinstance(plain, bytes):
            plain = plain.decode("utf-8", errors="replace")
        if isinstance(plain, str | int | float) and name not in {"id", "total_steps", FINAL_OBSERVED}:
            facts[name] = plain
    return facts


def _scalar_infos(
    infos: Mapping[str, Any], length: int, prefix: str = ""
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Infos with one value for each of `length` steps; the one of the reset, if there, is dropped."""
    for name, value in infos.items():
        if isinstance(value, Mapping):
            yield from _scalar_infos(value, length, f"{prefix}{name}.")
            continue
        values = np.asarray(value)
        if values.ndim != 1 or len(values) not in {length, length + 1}:
            continue
        if values.dtype.kind in "SO":
            texts = [text.decode() if isinstance(text, bytes) else text for text in values]
            if not all(isinstance(text, str) for text in texts):
                continue
            values = np.array(texts, dtype=np.str_)
        if values.dtype.kind in "biufU":
            yield prefix + name, values[len(values) - length :]
