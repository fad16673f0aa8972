"""Where a verb shall write: what cannot be is refused before the work, not after it."""

from __future__ import annotations

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from tvae.data.minari_source import is_minari_id, minari_root
from tvae.data.sources import DIRECTORY_SUFFIX, MINARI_PREFIX
from tvae.data.table_files import CSV_SUFFIXES, PARQUET_SUFFIXES, is_csv_name, is_parquet_name, schema_path
from tvae.errors import TvaeError
from tvae.files import appearing


def check_table(path: Path, *, overwrite: bool) -> None:
    """Raise for a target to which `write_table` cannot write.

    `TvaeError` for a name that says neither Parquet nor CSV, `FileExistsError` for what exists unless `overwrite`, and
    another `OSError` where nothing can be written.

    >>> check_table(Path("z.xlsx"), overwrite=False)
    Traceback (most recent call last):
    tvae.errors.TvaeError: z.xlsx: the name of a table needs to end with .parquet or .csv
    """
    if not (is_parquet_name(path) or _is_csv(path)):
        raise TvaeError(f"{path}: the name of a table needs to end with .parquet or .csv")
    _check_file(path, overwrite=overwrite)


def write_table(table: pa.Table, path: Path, *, overwrite: bool) -> None:
    """Write Parquet or CSV, as the name says, whole or not at all. Raises as `check_table` does."""
    check_table(path, overwrite=overwrite)
    with appearing(path, overwrite=overwrite) as partial:
        if _is_csv(path):
            pa_csv.write_csv(table, partial)
        else:
            pq.write_table(table, partial)


def check_demonstrations(target: str | Path, *, overwrite: bool) -> None:
    """Raise for a target to which `save_demonstrations` cannot write, as `check_table` does for a table.

    >>> check_demonstrations("walks.txt", overwrite=False)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    tvae.errors.TvaeError: walks.txt: the name needs to end with .parquet, .pq, .csv, ... or to begin with minari:
    """
    text, path = str(target), Path(target)
    if text.startswith(MINARI_PREFIX):
        rest = text.removeprefix(MINARI_PREFIX)
        _check_place(minari_root() / rest if is_minari_id(rest) else Path(rest), overwrite=overwrite)
    elif path.suffix == DIRECTORY_SUFFIX:
        _check_place(path, overwrite=overwrite)
    elif is_parquet_name(path):
        _check_file(path, overwrite=overwrite)
    elif is_csv_name(path):
        _check_file(path, overwrite=overwrite)
        _check_file(schema_path(path), overwrite=overwrite)
    else:
        names = ", ".join((*PARQUET_SUFFIXES, *CSV_SUFFIXES, DIRECTORY_SUFFIX))
        raise TvaeError(f"{target}: the name needs to end with {names}, or to begin with {MINARI_PREFIX}")


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == ".csv"


def _check_file(path: Path, *, overwrite: bool) -> None:
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a directory; choose another --out")
    _check_place(path, overwrite=overwrite)


def _check_place(path: Path, *, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; choose another --out, or replace it with --force")
    there = next(parent for parent in path.absolute().parents if parent.exists())
    if not there.is_dir():
        raise NotADirectoryError(f"{path} cannot be written: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(f"{path} cannot be written: {there} is not yours to write in")
