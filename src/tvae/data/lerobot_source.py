"""LeRobot data sets on disk, in version 3 of their format. Nothing is downloaded.

| in `meta/info.json` and `data/**/*.parquet` | becomes                                                        |
|---------------------------------------------|----------------------------------------------------------------|
| `episode_index`, `frame_index`              | `episode`, `step`                                              |
| `observation.NAME`                          | the same, or `observation.NAME.PART`, ... where it is wide     |
| `action`                                    | `action.PART`, ...                                             |
| `next.reward`                               | `reward`                                                       |
| `task_index` with `meta/tasks.parquet`      | `task`                                                         |
| other features                              | the same, or `NAME.PART` where they are wide                   |

A PART is called as the feature's `names` say, where they are different, else 0, 1, ... Images and videos cannot be
learned from; they are refused unless `columns` names others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from tvae.data.columns import plain
from tvae.data.names import is_asked_for
from tvae.data.raw_table import RawTable
from tvae.data.trajectory import DataError

INFO_PATH = Path("meta/info.json")
_PICTURES = {"image", "video"}
_RENAMED = {"episode_index": "episode", "frame_index": "step", "next.reward": "reward"}
_SUPPORTED = "single values and vectors of numbers, booleans or text"
_NOT_READ = {"index", "task_index"}


def is_lerobot(directory: Path) -> bool:
    """Whether a directory is a LeRobot data set, of any version."""
    return (directory / INFO_PATH).is_file()


def read_lerobot(directory: Path, columns: Sequence[str] = ()) -> RawTable:
    """The frames of all episodes; of `columns`, if any are given, those only.

    Raises `DataError` for another version, for images, for files that are missing or damaged, and where episodes have
    other lengths than `meta/episodes` says.
    """
    try:
        info = json.loads((directory / INFO_PATH).read_text(encoding="utf-8"))
        version, features = str(info["codebase_version"]), dict(info["features"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{directory}: {INFO_PATH} does not describe a LeRobot data set: {error}") from error
    if not version.startswith("v3."):
        raise DataError(f"{directory}: needs a LeRobot data set of version 3, got {version}")
    chosen = _chosen(directory, features, columns)
    frames = _read(directory, "data", [*chosen, *(name for name in _NOT_READ if name in features)])
    _check_lengths(directory, frames)
    table: dict[str, pa.ChunkedArray] = {}
    for name in chosen:
        table |= dict(_parts(directory, name, features[name], frames[name]))
    tasks = directory / "meta" / "tasks.parquet"
    if "task_index" in frames.column_names and tasks.is_file() and (not columns or "task" in columns):
        table["task"] = _tasks(tasks, frames["task_index"])
    return RawTable(pa.table(table))


def _chosen(directory: Path, features: Mapping[str, Any], columns: Sequence[str]) -> list[str]:
    """Features to read, without images."""
    missing = [name for name in ("episode_index", "frame_index") if name not in features]
    if missing:
        raise DataError(f"{directory}: needs the features episode_index and frame_index, got {', '.join(features)}")

    def wanted(name: str) -> bool:
        called = _RENAMED.get(name, name)
        return called in {"episode", "step"} or is_asked_for(called, columns)

    chosen = [name for name in features if name not in _NOT_READ and wanted(name)]
    pictures = [name for name in chosen if features[name]["dtype"] in _PICTURES]
    if pictures:
        numbers = [name for name in features if name.startswith(("observation", "action")) and name not in pictures]
        described = ", ".join(_described(name, features[name]) for name in pictures)
        raise DataError(
            f"{directory}: {described}: images cannot be learned from, only {_SUPPORTED}; name the columns to read "
            f"instead (--only), such as {', '.join(numbers) or 'action'}"
        )
    return chosen


def _described(name: str, feature: Mapping[str, Any]) -> str:
    return f"{name} of the shape {list(feature.get('shape') or ())} and dtype {feature.get('dtype')}"


def _read(directory: Path, part: str, columns: Sequence[str]) -> pa.Table:
    """These columns of all Parquet files in a part of the data set."""
    files = sorted((directory / part).rglob("*.parquet"))
    if not files:
        raise DataError(f"{directory}: there is no Parquet file in {part}")
    tables = []
    for path in files:
        try:
            with pq.ParquetFile(path) as file:
                lacking = [name for name in columns if name not in file.schema_arrow.names]
                if lacking:
                    raise DataError(f"{path}: lacks {', '.join(lacking)}, which {INFO_PATH} names")
                tables.append(file.read(columns=list(columns)).replace_schema_metadata(None))
        except (pa.ArrowException, OSError) as error:
            raise DataError(f"{path}: no whole Parquet file: {error}") from error
    try:
        return pa.concat_tables(tables, promote_options="permissive")
    except pa.ArrowException as error:
        raise DataError(f"{directory}: the files in {part} hold different types: {error}") from error


def _check_lengths(directory: Path, frames: pa.Table) -> None:
    """Every episode must have as many frames as `meta/episodes` says."""
    said = _read(directory, "meta/episodes", ["episode_index", "length"])
    expected = dict(zip(said["episode_index"].to_pylist(), said["length"].to_pylist(), strict=True))
    counted = pc.value_counts(frames["episode_index"].combine_chunks())
    found = {entry["values"]: entry["counts"] for entry in counted.to_pylist()}
    for episode in sorted(expected.keys() | found.keys()):
        if expected.get(episode, 0) != found.get(episode, 0):
            raise DataError(
                f"{directory}: episode {episode}: needs {expected.get(episode, 0)} frames, as meta/episodes says, "
                f"got {found.get(episode, 0)}"
            )


def _parts(
    directory: Path, name: str, feature: Mapping[str, Any], values: pa.ChunkedArray
) -> Iterator[tuple[str, pa.ChunkedArray]]:
    """A feature as columns of single values."""
    called = _RENAMED.get(name, name)
    kind = values.type
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        yield ("action.0" if called == "action" else called), values
        return
    widths = pc.unique(pc.list_value_length(values)).to_pylist()
    shape = tuple(feature.get("shape") or ())
    if len(shape) > 1:
        raise DataError(
            f"{directory}: {_described(name, feature)}: cannot be learned from, only {_SUPPORTED}; name the columns to "
            "read instead (--only)"
        )
    if len(shape) != 1 or widths != [shape[0]] or pa.types.is_nested(kind.value_type):
        raise DataError(
            f"{directory}: {name}: needs lists of one length, as its shape {list(shape)} says, got {widths}"
        )
    for part, word in enumerate(_names(feature, shape[0])):
        column = called if shape[0] == 1 and called != "action" else f"{called}.{word}"
        yield column, pc.list_element(values, part)


def _names(feature: Mapping[str, Any], width: int) -> list[str]:
    """What the parts of a feature are called: in a list, or in a dict of one list."""
    names = feature.get("names")
    if isinstance(names, Mapping) and len(names) == 1:
        names = next(iter(names.values()))
    if isinstance(names, list) and len(set(map(str, names))) == width == len(names):
        return [str(name) for name in names]
    return [str(index) for index in range(width)]


def _tasks(path: Path, index: pa.ChunkedArray) -> pa.ChunkedArray:
    """What each frame's task is called; the names stand in the only column of text."""
    try:
        tasks = pq.read_table(path)
        columns = {name: plain(tasks[name]) for name in tasks.column_names}
        words = next(values for values in columns.values() if pa.types.is_string(values.type))
        place = pc.index_in(index, columns["task_index"].combine_chunks())
        return words.take(place)
    except (pa.ArrowException, OSError, KeyError, StopIteration) as error:
        raise DataError(f"{path}: does not name the tasks: {error!r}") from error
