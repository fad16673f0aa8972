"""Many files of one table: what a glob, a list or a directory names."""

from __future__ import annotations

import glob
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.columns import plain
from tvae.data.degrees import angles, noted
from tvae.data.issues import Issue
from tvae.data.preparation import AS_RECORDED, Preparation
from tvae.data.raw_table import RawTable
from tvae.data.table_files import CSV_SUFFIXES, PARQUET_SUFFIXES, is_csv_name, is_parquet_name, read_table_file
from tvae.data.table_schema import ACTION, OBSERVATION, TableSchema
from tvae.data.table_times import times_of
from tvae.data.texts import no_numbers
from tvae.data.trajectory import DataError

_SUFFIXES = ", ".join((*PARQUET_SUFFIXES, *CSV_SUFFIXES))


def is_pattern(text: str) -> bool:
    """Whether a text names files by a pattern, such as `sessions/*.parquet`.

    >>> is_pattern("day-?/*.csv"), is_pattern("day-1/a.csv")
    (True, False)
    """
    return glob.has_magic(text)


def matching_files(pattern: str) -> list[Path]:
    """The files that a pattern names, in the order of their names; `**` is any directory.

    Raises `DataError` where there is none.
    """
    found = sorted(Path(name) for name in glob.glob(pattern, recursive=True))
    files = [path for path in found if path.is_file()]
    if not files:
        raise DataError(f"{pattern}: no file has such a name")
    return files


def table_files_in(directory: Path) -> list[Path]:
    """All Parquet and CSV files in a directory and below it, in the order of their names.

    Hidden ones are left out, and what stands in a directory below that we wrote: a run, an export, demonstrations.
    """
    files = []
    for where, below, names in os.walk(directory):
        below[:] = [name for name in below if not name.startswith(".") and not _is_ours(Path(where, name))]
        files += [Path(where, name) for name in names if not name.startswith(".")]
    return sorted(path for path in files if (is_parquet_name(path) or is_csv_name(path)) and path.is_file())


def _is_ours(directory: Path) -> bool:
    """Whether a directory says of itself that we wrote it."""
    for name in ("config.json", "manifest.json", "demonstrations.json"):
        try:
            said = json.loads((directory / name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(said, dict) and str(said.get("format")).startswith("tvae-"):
            return True
    return False


def read_table_files(paths: Sequence[Path], preparation: Preparation = AS_RECORDED) -> RawTable:
    """The rows of all files, one after another, before anything of the preparation is done to them.

    Files without a column `episode` are an episode each, which is called like the file without its ending, unless
    another column is named as such.

    Raises `DataError`, naming a file, where the columns differ or one is there twice, an episode begins in two files
    or, by a clock, is in two at the same time, or one cannot be read.
    """
    if not paths:
        raise DataError(f"needs at least one file ({_SUFFIXES}), got none")
    raws = [read_table_file(path, preparation.csv) for path in paths]
    first = raws[0]
    for path, raw in zip(paths, raws, strict=True):
        _check_columns(path, raw.table, paths[0], first.table)
    tables = [raw.table for raw in raws]
    named = preparation.roles.episode is None and "episode" not in first.table.column_names
    table = _joined(paths, _named_after_files(paths, tables) if named else tables)
    if not named:
        _check_episodes(paths, np.repeat(np.arange(len(paths)), [len(table) for table in tables]), table, preparation)
    return RawTable(
        table,
        _common_schema(paths, [raw.schema for raw in raws]),
        tuple(issue for raw in raws for issue in raw.issues),
    )


def _check_columns(path: Path, table: pa.Table, first_path: Path, first: pa.Table) -> None:
    """All files need the same columns, each once, in any order."""
    names = table.column_names
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"{path}: column {twice}: is there {names.count(twice)} times")
    here, there = set(table.column_names), set(first.column_names)
    if here != there:
        lacking, more = ", ".join(sorted(there - here)), ", ".join(sorted(here - there))
        words = [f"lacks {lacking}"] if lacking else []
        words += [f"has {more} besides"] if more else []
        raise DataError(f"{path}: needs the same columns as {first_path}, but {' and '.join(words)}")


def _named_after_files(paths: Sequence[Path], tables: Sequence[pa.Table]) -> list[pa.Table]:
    names = [_stem(path) for path in paths]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise DataError(f"files without a column 'episode' need different names, got {twice!r} twice")
    return [
        table.append_column("episode", pa.array([name] * len(table), pa.string()))
        for name, table in zip(names, tables, strict=True)
    ]


def _stem(path: Path) -> str:
    suffix = next(s for s in reversed((*PARQUET_SUFFIXES, *CSV_SUFFIXES)) if path.name.lower().endswith(s))
    return path.name[: -len(suffix)]


def _check_episodes(
    paths: Sequence[Path], file: NDArray[np.int64], table: pa.Table, preparation: Preparation
) -> None:
    """An episode may go on in another file (N,), but begin in one only; by a clock it goes on at later times."""
    if not set(preparation.needed) <= set(table.column_names):
        return
    *identity, moment = preparation.needed
    times = times_of(table[moment], moment)
    if isinstance(times, Issue):  # reported with all else that is wrong
        return
    keys = [f"key {at}" for at in range(len(identity))]
    rows = pa.table([*(plain(table[name]) for name in identity), file, times], names=[*keys, "file", "time"])
    if preparation.clock is None:
        rows = rows.filter(pc.equal(rows["time"], 0))
    try:
        spans = rows.group_by([*keys, "file"]).aggregate([("time", "min"), ("time", "max")])
    except pa.ArrowException:  # nor do lists name an episode
        return
    latest: dict[tuple[object, ...], dict[str, Any]] = {}
    for span in spans.sort_by([("time_min", "ascending"), ("file", "ascending")]).to_pylist():
        key = tuple(span[name] for name in keys)
        before = latest.setdefault(key, span)
        if None not in key and before is not span and span["time_min"] <= before["time_max"]:
            here, there = (paths[at] for at in sorted((span["file"], before["file"]), reverse=True))
            who = ", ".join(f"{what} {one}" for what, one in zip(("episode", "player"), key, strict=False))
            how = (
                f"begins in {there} too; episodes"
                if preparation.clock is None
                else f"is in {there} too, at the same times ({moment}); different episodes"
            )
            raise DataError(f"{here}: {who} {how} need different names")
        latest[key] = span


def _joined(paths: Sequence[Path], tables: Sequence[pa.Table]) -> pa.Table:
    """One table; integers and fractions of one column become fractions, numbers and stray text become text."""
    names = tables[0].column_names
    same_order = [table.select(names).replace_schema_metadata(None) for table in tables]
    for name in names:
        if _is_stray(table[name] for table in same_order):
            same_order = [_with_text(table, name) for table in same_order]
    try:
        return pa.concat_tables(same_order, promote_options="permissive")
    except pa.ArrowException:
        for path, table in zip(paths[1:], same_order[1:], strict=True):
            for name in names:
                kinds = same_order[0].schema.field(name).type, table.schema.field(name).type
                try:
                    pa.unify_schemas([pa.schema([(name, kind)]) for kind in kinds], promote_options="permissive")
                except pa.ArrowException:
                    raise DataError(
                        f"{path}: column {name} holds {kinds[1]}, but that of {paths[0]} holds {kinds[0]}"
                    ) from None
        raise


def _is_stray(columns: Iterable[pa.ChunkedArray]) -> bool:
    """Whether some of these are numbers and the others text that is mostly numbers."""
    texts = False
    for column in columns:
        if pa.types.is_string(column.type) and 2 * no_numbers(column).sum() < len(column):
            texts = True
        elif not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            return False
    return texts


def _with_text(table: pa.Table, name: str) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, table[name].cast(pa.string()))


def _common_schema(paths: Sequence[Path], schemas: Sequence[TableSchema | None]) -> TableSchema | None:
    """What we wrote about all files; nothing where we did not write all of them.

    An angle counts as recorded in degrees where any file says so: old ones could not.
    """
    first, known = schemas[0], [schema for schema in schemas if schema is not None]
    if first is None or len(known) < len(schemas):
        return None
    for path, schema in zip(paths, known, strict=True):
        for what, mine, other in (
            ("observations", first.observation_space, schema.observation_space),
            ("actions", first.action_space, schema.action_space),
        ):
            differences = mine.differences(other)
            if differences:
                raise DataError(f"{path}: {what} differ from those of {paths[0]}: {'; '.join(differences)}")
    in_degrees = [
        column
        for schema in known
        for column, angle in angles(schema.observation_space, schema.action_space).items()
        if angle.recorded_in_degrees
    ]
    return replace(
        first.over(sum(schema.num_rows for schema in known)),
        observation_space=noted(first.observation_space, OBSERVATION, in_degrees),
        action_space=noted(first.action_space, ACTION, in_degrees),
    )
