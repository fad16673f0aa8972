"""What can be read as a table of steps, wherever it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, TypeAlias, runtime_checkable

import pyarrow as pa

from tvae.data.lerobot_source import is_lerobot, read_lerobot
from tvae.data.preparation import AS_RECORDED, Preparation
from tvae.data.raw_table import RawTable
from tvae.data.robomimic_source import is_hdf5_name, read_robomimic
from tvae.data.table_files import is_csv_name, is_parquet_name, read_table_file
from tvae.data.table_sets import is_pattern, matching_files, read_table_files, table_files_in
from tvae.data.trajectory import DataError


@runtime_checkable
class ArrowStream(Protocol):
    """A table in memory of any library that speaks Arrow's C stream: pandas, polars, pyarrow and others."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...


DataSource: TypeAlias = str | Path | Sequence[str | Path] | ArrowStream
"""A file, a pattern of files, a directory, an id, a list of files, or a table in memory."""


def title(source: DataSource) -> str:
    """How errors name a source.

    >>> title(Path("a.csv")), title(["a.csv", "b.csv"]), title(pa.table({}))
    ('a.csv', '2 files', 'Table')
    """
    if isinstance(source, str | Path):
        return str(source)
    return f"{len(source)} files" if isinstance(source, Sequence) else type(source).__name__


def open_table(source: DataSource, preparation: Preparation = AS_RECORDED) -> RawTable | None:
    """The rows of a source as they were recorded, of the columns that are to be read; None if it is no table.

    Raises `DataError` with the source's name if it should be one and cannot be read.

    >>> open_table(pa.table({"episode": [0], "step": [0]})).table.num_rows
    1
    """
    try:
        raw = _opened(source, preparation)
        if raw is None or not preparation.columns:
            return raw
        ours = () if raw.schema is None else ("episode", "step")
        return raw.only(preparation.columns, (*preparation.needed, *ours))
    except DataError as error:
        name = title(source)
        raise error if str(error).startswith(name) else DataError(f"{name}: {error}") from None


def _opened(source: DataSource, preparation: Preparation) -> RawTable | None:
    if isinstance(source, ArrowStream):
        return RawTable(_in_memory(source))
    files = _files(source)
    if files is not None:
        return read_table_files(files, preparation)
    assert isinstance(source, str | Path)
    path = Path(source)
    if is_lerobot(path):
        return read_lerobot(path, preparation.columns)
    if path.is_dir() or not (path.is_file() or is_table_name(path)):
        return None
    if is_hdf5_name(path):
        return read_robomimic(path, preparation.columns)
    return read_table_file(path, preparation.csv)


def _files(source: str | Path | Sequence[str | Path]) -> list[Path] | None:
    """The files of a list or a pattern; None where it is neither."""
    if not isinstance(source, str | Path):
        return [Path(path) for path in source]
    is_files = not Path(source).exists() and is_pattern(str(source))
    return matching_files(str(source)) if is_files else None


def is_table_name(path: Path) -> bool:
    """Whether a file's name says that it holds a table."""
    return is_hdf5_name(path) or is_parquet_name(path) or is_csv_name(path)


def open_directory(source: str | Path, preparation: Preparation) -> RawTable | None:
    """The rows of all Parquet and CSV files in a directory; None if it holds none."""
    files = table_files_in(Path(source))
    return open_table(files, preparation) if files else None


def _in_memory(source: ArrowStream) -> pa.Table:
    """An Arrow table; the index of a pandas frame becomes columns where it has names, else it is left out."""
    try:
        reset_index = getattr(source, "reset_index", None)
        if reset_index is None:
            return pa.table(source)
        named = any(name is not None for name in source.index.names)  # type: ignore[attr-defined]  # what has reset_index has an index
        return pa.Table.from_pandas(reset_index() if named else source, preserve_index=False)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise DataError(f"cannot be read as an Arrow table: {error}") from error
