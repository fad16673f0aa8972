"""HDF5 files in robomimic's layout.

| in the file                           | becomes                                                        |
|---------------------------------------|----------------------------------------------------------------|
| `data/demo_K`                         | the episode `demo_K`, in the order of K                        |
| `obs/KEY`                             | `observation.KEY`, or `observation.KEY.0`, ... where it is wide |
| the last row of `next_obs`            | the observation after the last action                          |
| `actions`                             | `action.0`, ...                                                |
| `rewards`, `dones`                    | `reward`, `done`                                               |
| `mask/NAME`, the demonstrations of it | `mask.NAME`, yes or no, a fact about the episode               |

States of a simulator and models of its world are not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tvae.data.names import is_asked_for
from tvae.data.raw_table import RawTable
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.data.trajectory import DataError

HDF5_SUFFIXES = (".hdf5", ".h5")
_ACTION = ACTION.removesuffix(".")
_FACTS = {"rewards": "reward", "dones": "done"}


def is_hdf5_name(path: Path) -> bool:
    """Whether a file's name says that it is HDF5."""
    return path.name.lower().endswith(HDF5_SUFFIXES)


def read_robomimic(path: Path, columns: Sequence[str] = ()) -> RawTable:
    """The demonstrations in a file; of `columns`, if any are given, those only.

    Raises `DataError`, with the demonstration and what it lacks, for a file of another layout, for images that are
    not left out by `columns`, and for parts of different lengths.
    """
    if not path.is_file():
        raise DataError(f"{path}: there is no such file")
    try:
        with h5py.File(path, "r") as file:
            if not isinstance(file.get("data"), h5py.Group):
                raise DataError("needs a group 'data', as robomimic writes it; there are " + _names(file))
            demos = sorted(file["data"], key=_number)
            if not demos:
                raise DataError("needs at least one demonstration in 'data', got none")
            masks = _masks(file)
            tables = []
            for name in demos:
                facts = {f"mask.{mask}": name in members for mask, members in masks.items()}
                tables.append(_table(name, file["data"][name], facts, columns))
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise DataError(f"{path}: no whole HDF5 file: {error}") from error
    for name, table in zip(demos, tables, strict=True):
        if set(table.column_names) != set(tables[0].column_names):
            differing = ", ".join(sorted(set(table.column_names) ^ set(tables[0].column_names)))
            raise DataError(f"{path}: {name}: needs the same columns as {demos[0]}; these are in one only: {differing}")
    ordered = [table.select(tables[0].column_names) for table in tables]
    return RawTable(pa.concat_tables(ordered, promote_options="permissive"))


def _number(name: str) -> tuple[int, str]:
    match = re.search(r"\d+$", name)
    return (int(match[0]) if match else -1, name)


def _names(group: h5py.Group) -> str:
    return ", ".join(group) or "none"


def _masks(file: h5py.File) -> Mapping[str, set[str]]:
    """The demonstrations of each filter key."""
    group = file.get("mask")
    if group is None:
        return {}
    return {name: {member.decode() for member in group[name][()]} for name in group}


def _table(name: str, demo: h5py.Group, facts: Mapping[str, bool], columns: Sequence[str]) -> pa.Table:
    """One row a step, and one for the observation after the last action."""
    for part in ("obs", "actions"):
        if part not in demo:
            raise DataError(f"{name}: needs {part!r}; there are {_names(demo)}")
    actions = dict(_wide(name, "actions", _ACTION, demo["actions"]))
    length = len(demo["actions"])
    rows: dict[str, NDArray[Any]] = {}
    final = "next_obs" in demo
    for key, values in _leaves(demo["obs"]):
        column = OBSERVATION + key
        if not is_asked_for(column, columns):
            continue
        seen = dict(_wide(name, f"obs/{key}", column, values))
        after = demo["next_obs"].get(key.replace(".", "/")) if final else None
        if final and after is None:
            raise DataError(f"{name}: needs next_obs/{key}, as there is an obs/{key}")
        if len(values) != length or (after is not None and len(after) != length):
            raise DataError(f"{name}: obs/{key} needs {length} rows, as many as actions, got {len(values)}")
        last = {} if after is None else dict(_wide(name, f"next_obs/{key}", column, after, slice(-1, None)))
        rows |= {part: np.concatenate([now, last[part]]) if last else now for part, now in seen.items()}
    count = length + final
    acting = np.arange(count) < length
    table: dict[str, Any] = {
        "episode": pa.array([name] * count, pa.string()),
        "step": np.arange(count),
        **rows,
    }
    held = {**actions, **{_FACTS[key]: demo[key][()] for key in _FACTS if key in demo}}
    for column, values in held.items():
        if values.shape != (length,):
            raise DataError(f"{name}: {column} needs {length} values, as many as actions, got shape {values.shape}")
        table[column] = pa.array(np.resize(values, count) if length else values, mask=~acting)
    return pa.table({**table, **{fact: pa.array([holds] * count) for fact, holds in facts.items()}})


def _leaves(group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, h5py.Dataset]]:
    """All arrays in a group and in those within it."""
    for name, member in group.items():
        if isinstance(member, h5py.Group):
            yield from _leaves(member, f"{prefix}{name}.")
        else:
            yield prefix + name, member


def _wide(
    name: str, where: str, column: str, values: h5py.Dataset, rows: slice = slice(None)
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Each column of an array (steps, signals): `column` where it is the only one, else `column.0`, ..."""
    if values.ndim not in {1, 2}:
        raise DataError(
            f"{name}: {where} needs numbers of the shape (steps,) or (steps, signals), got the shape {values.shape} of "
            f"dtype {values.dtype}: images cannot be learned from; name the columns to read instead (--only), such as "
            "action and observation.KEY"
        )
    read = values[rows]
    wide = read.reshape(len(read), -1)
    for index in range(wide.shape[1]):
        alone = wide.shape[1] == 1 and column != _ACTION
        yield (column if alone else f"{column}.{index}"), np.ascontiguousarray(wide[:, index])
