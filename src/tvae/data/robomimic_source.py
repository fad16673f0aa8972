"""HDF5 files in robomimic's layout.

| in the file                           | becomes                                                        |
|---------------------------------------|----------------------------------------------------------------|
| `data/demo_K`                         | the episode `demo_K`, in the order of K                        |
| `obs/KEY`                             | `observation.KEY`, or `observation.KEY.0`, ... where it is wide |
| `obs` that has no parts               | `observation.0`, ...                                            |
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
_OBSERVATION, _ACTION = OBSERVATION.removesuffix("."), ACTION.removesuffix(".")
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
            masks = _masks(file.get("mask"))
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


def _masks(group: h5py.Group | h5py.Dataset | None) -> Mapping[str, set[str]]:
    """The demonstrations of each filter key."""
    if group is None:
        return {}
    if not isinstance(group, h5py.Group):
        raise DataError(f"mask needs to be a group with the demonstrations of each filter key, got {_what(group)}")
    return {name: set(_members(f"mask/{name}", group[name])) for name in group}


def _members(where: str, mask: h5py.Group | h5py.Dataset) -> Iterator[str]:
    """The names in a filter key."""
    members = np.ravel(mask[()]).tolist() if isinstance(mask, h5py.Dataset) else [mask]
    for member in members:
        if not isinstance(member, bytes):
            raise DataError(f"{where} needs names of demonstrations, such as demo_0, got {_what(mask)}")
        yield member.decode()


def _table(
    name: str, demo: h5py.Group | h5py.Dataset, facts: Mapping[str, bool], columns: Sequence[str]
) -> pa.Table:
    """One row a step, and one for the observation after the last action."""
    if not isinstance(demo, h5py.Group):
        raise DataError(f"{name}: needs to be a group with 'obs' and 'actions', got {_what(demo)}")
    for part in ("obs", "actions"):
        if part not in demo:
            raise DataError(f"{name}: needs {part!r}; there are {_names(demo)}")
    actions = dict(_wide(name, "actions", _ACTION, demo["actions"]))
    length = len(demo["actions"])
    if length == 0:
        raise DataError(f"{name}: needs at least one action, got none")
    rows: dict[str, NDArray[Any]] = {}
    final = "next_obs" in demo
    for key, values in _leaves(demo["obs"]):
        column = OBSERVATION + key if key else _OBSERVATION
        if not is_asked_for(column, columns):
            continue
        path = f"/{key}" if key else ""
        seen = dict(_wide(name, f"obs{path}", column, values))
        after = _after(demo["next_obs"], key) if final else None
        if final and after is None:
            raise DataError(f"{name}: needs next_obs{path}, as there is an obs{path}")
        if len(values) != length or (after is not None and len(after) != length):
            raise DataError(f"{name}: obs{path} needs {length} rows, as many as actions, got {len(values)}")
        last = {} if after is None else dict(_wide(name, f"next_obs{path}", column, after, slice(-1, None)))
        if last and last.keys() != seen.keys():
            raise DataError(f"{name}: next_obs{path} needs {len(seen)} signals, as obs{path} has, got {len(last)}")
        rows |= {part: np.concatenate([now, last[part]]) if last else now for part, now in seen.items()}
    count = length + final
    acting = np.arange(count) < length
    table: dict[str, Any] = {
        "episode": pa.array([name] * count, pa.string()),
        "step": np.arange(count),
        **rows,
    }
    held = {**actions, **{_FACTS[key]: _numbers(name, key, demo[key]) for key in _FACTS if key in demo}}
    for column, values in held.items():
        if values.shape != (length,):
            raise DataError(f"{name}: {column} needs {length} values, as many as actions, got shape {values.shape}")
        table[column] = pa.array(np.resize(values, count), mask=~acting)
    return pa.table({**table, **{fact: pa.array([holds] * count) for fact, holds in facts.items()}})


def _leaves(member: h5py.Group | h5py.Dataset, name: str = "") -> Iterator[tuple[str, h5py.Dataset]]:
    """All arrays in a group and in those within it; an array itself has no name."""
    if not isinstance(member, h5py.Group):
        yield name, member
        return
    for part, within in member.items():
        yield from _leaves(within, f"{name}.{part}" if name else part)


def _after(member: h5py.Group | h5py.Dataset, key: str) -> h5py.Dataset | None:
    """The array in `next_obs` that is called as that in `obs`."""
    return dict(_leaves(member)).get(key)


def _wide(
    name: str, where: str, column: str, values: h5py.Group | h5py.Dataset, rows: slice = slice(None)
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Each column of an array (steps, signals): `column` where it is the only one, else `column.0`, ..."""
    if isinstance(values, h5py.Dataset) and values.ndim not in {1, 2}:
        raise DataError(
            f"{name}: {where} needs numbers of the shape (steps,) or (steps, signals), got the shape {values.shape} of "
            f"dtype {values.dtype}: images cannot be learned from; name the columns to read instead (--only), such as "
            "action and observation.KEY"
        )
    read = _numbers(name, where, values, rows)
    wide = read.reshape(len(read), -1) if len(read) else read.reshape(0, 1)
    for index in range(wide.shape[1]):
        alone = wide.shape[1] == 1 and column not in {_OBSERVATION, _ACTION}
        yield (column if alone else f"{column}.{index}"), np.ascontiguousarray(wide[:, index])


def _numbers(
    name: str, where: str, values: h5py.Group | h5py.Dataset, rows: slice | tuple[()] = ()
) -> NDArray[Any]:
    """The numbers in an array, in this machine's order of bytes."""
    if not isinstance(values, h5py.Dataset) or values.dtype.kind not in "biuf":
        raise DataError(f"{name}: {where} needs an array of numbers, got {_what(values)}")
    read: NDArray[Any] = np.asarray(values[rows])
    return read.astype(read.dtype.newbyteorder("="), copy=False)


def _what(member: h5py.Group | h5py.Dataset) -> str:
    """What stands where something else should."""
    if isinstance(member, h5py.Group):
        return f"a group of {_names(member)}"
    return f"an array of dtype {member.dtype} and shape {member.shape}"
