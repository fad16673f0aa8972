"""Demonstrations as Minari data sets, which Minari's own tools open."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage
from minari.namespace import create_namespace, list_local_namespaces
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.minari_notes import COLUMNS, ENTRY, FINAL_OBSERVED, MinariNotes
from tvae.data.minari_source import find_minari, is_minari_id, minari_root
from tvae.data.trajectory import Attribute, DataError, Trajectory
from tvae.files import appearing
from tvae.gymnasium_spaces import gymnasium_from_space, space_from_gymnasium, unflatten
from tvae.spaces import Continuous, FloatArray, Space


def write_minari(
    demonstrations: Demonstrations,
    target: str | Path,
    *,
    overwrite: bool = False,
    environment: str | None = None,
    description: str | None = None,
) -> None:
    """Write a Minari data set: a `str` is an id under Minari's root, a `Path` a directory of its own.

    Its spaces are those of `gymnasium_from_space`. Minari wants an observation after the last action: where
    there was none, the last one is repeated and noted as unobserved. Missing rewards are written as 0,
    missing ends as truncated at the last step, and noted likewise. `environment`, the id of a Gymnasium
    environment, lets Minari recover it. The data set appears only when whole.

    Raises `FileExistsError` where it exists and `overwrite` is False.

    >>> import tempfile
    >>> from tvae.data.minari_source import read_minari
    >>> from tvae.spaces import Angular
    >>> walk = Trajectory(np.zeros((4, 1)), np.ones((3, 1)), attributes={"label": "east"})
    >>> space = Space((Angular("heading"),))
    >>> directory = Path(tempfile.mkdtemp()) / "walks-v0"
    >>> write_minari(Demonstrations.from_trajectories([walk], space, space), directory)
    >>> read_minari(directory)[0].attributes
    {'label': 'east'}
    """
    if isinstance(target, str) and not is_minari_id(target):
        raise DataError(f"a Minari id looks like namespace/name-v0, got {target!r}")
    directory = minari_root() / target if isinstance(target, str) else target
    if overwrite and directory.exists() and find_minari(directory) is None:
        raise FileExistsError(f"{directory} exists already and is no Minari data set")
    dataset_id = target if isinstance(target, str) else _id_for(directory)
    with appearing(directory, overwrite=overwrite) as partial:
        partial.mkdir()
        storage = MinariStorage.new(
            (partial / "data").absolute(),  # Minari cannot size a relative path
            observation_space=_storage_space(demonstrations.observation_space, demonstrations.observations),
            action_space=_storage_space(demonstrations.action_space, demonstrations.actions),
            env_spec=None if environment is None else gymnasium.spec(environment),
        )
        notes = _notes(demonstrations, storage)
        storage.update_metadata(
            {
                "dataset_id": dataset_id,
                "minari_version": minari.__version__,
                **({} if description is None else {"description": description}),
                ENTRY: notes.to_json(),
            }
        )
        storage.update_episodes(_buffer(episode, storage, notes) for episode in demonstrations)
        storage.update_episode_metadata(_episode_metadata(episode, notes) for episode in demonstrations)
    namespace = dataset_id.rpartition("/")[0]
    if isinstance(target, str) and namespace and namespace not in list_local_namespaces():
        create_namespace(namespace)


def _id_for(directory: Path) -> str:
    """A valid id that resembles the directory's name."""
    name = re.sub(r"[^-\w]", "-", directory.name)
    return name if is_minari_id(name) else f"{name}-v0"


def _keys(names: Sequence[str], what: str) -> list[str]:
    """Names under which HDF5 and Minari can store these: themselves wherever that is possible."""
    unsafe = re.compile(rf"|\.|.*/.*|{what}_\d+|id|seed|options|total_steps|{FINAL_OBSERVED}", re.DOTALL)
    return [
        f"{what}_{index}" if unsafe.fullmatch(name) or names.count(name) > 1 else name
        for index, name in enumerate(names)
    ]


def _notes(demonstrations: Demonstrations, storage: MinariStorage) -> MinariNotes:
    extra = [name for name in demonstrations.steps if name not in COLUMNS]
    attributes = list(demonstrations.attributes)
    return MinariNotes(
        observation_space=demonstrations.observation_space,
        action_space=demonstrations.action_space,
        observation_keys=space_from_gymnasium(storage.observation_space).names,
        action_keys=space_from_gymnasium(storage.action_space).names,
        columns=[name for name in COLUMNS if name in demonstrations.steps],
        infos=dict(zip(_keys([name.removeprefix("info.") for name in extra], "info"), extra, strict=True)),
        attributes=dict(zip(_keys(attributes, "attribute"), attributes, strict=True)),
    )


def _storage_space(space: Space, rows: FloatArray) -> gymnasium.Space[Any]:
    """A Gymnasium space that contains these rows as they are, its parts named so that HDF5 can hold them.

    An angle that was recorded beyond +-pi is stored as an unbounded number; our notes know that it is one.
    """
    wide = space.angular[(np.abs(rows[:, space.angular]) > np.pi).any(axis=0)]
    signals = [
        Continuous(key) if column in wide else replace(signal, name=key)
        for column, (signal, key) in enumerate(zip(space.signals, _keys(space.names, "signal"), strict=True))
    ]
    return gymnasium_from_space(Space(tuple(signals)))


def _buffer(episode: Trajectory, storage: MinariStorage, notes: MinariNotes) -> EpisodeBuffer:
    length = len(episode)
    observations = episode.observations
    if not episode.has_final_observation:
        observations = np.concatenate([observations, observations[-1:]])
    cut = np.zeros(length, dtype=np.bool_)
    cut[-1] = "terminated" not in episode.steps
    return EpisodeBuffer(
        observations=unflatten(storage.observation_space, observations),
        actions=unflatten(storage.action_space, episode.actions),
        rewards=episode.steps.get("reward", np.zeros(length)),
        terminations=episode.steps.get("terminated", np.zeros(length, dtype=np.bool_)),
        truncations=episode.steps.get("truncated", cut),
        infos={key: _storable(episode.steps[name]) for key, name in notes.infos.items()} or None,
    )


def _storable(values: NDArray[Any]) -> Any:
    """HDF5 takes text as a list of Python's own."""
    return values.tolist() if values.dtype.kind == "U" else values


def _episode_metadata(episode: Trajectory, notes: MinariNotes) -> dict[str, Attribute]:
    facts = {key: episode.attributes[name] for key, name in notes.attributes.items()}
    return {**facts, FINAL_OBSERVED: episode.has_final_observation}
