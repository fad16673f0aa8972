"""Parquet and CSV files as Arrow tables, with the schema that we wrote into or beside them."""

from __future__ import annotations

import codecs
import zlib
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from tvae.data.table_schema import TableSchema
from tvae.data.trajectory import DataError

PARQUET_SUFFIXES = (".parquet", ".pq")
CSV_SUFFIXES = (".csv", ".csv.gz")
METADATA_KEY = b"tvae"
_LOOK_BYTES = 1 << 16


def is_parquet_name(path: Path) -> bool:
    """Whether a file's name says that it is Parquet."""
    return path.name.lower().endswith(PARQUET_SUFFIXES)


def is_csv_name(path: Path) -> bool:
    """Whether a file's name says that it is CSV, perhaps compressed."""
    return path.name.lower().endswith(CSV_SUFFIXES)


def schema_path(path: Path) -> Path:
    """Where the schema of a CSV file stands.

    >>> schema_path(Path("runs/sessions.csv.gz")).name
    'sessions.schema.json'
    """
    suffix = next(suffix for suffix in reversed(CSV_SUFFIXES) if path.name.lower().endswith(suffix))
    return path.with_name(path.name[: -len(suffix)] + ".schema.json")


def read_table_file(path: Path) -> tuple[pa.Table, TableSchema | None]:
    """The table in a Parquet or CSV file, and its schema if we wrote it.

    Raises `DataError` if there is no such file, or it is not what its name says, or it is damaged.
    """
    if not path.is_file():
        raise DataError(f"{path}: there is no such file")
    if is_parquet_name(path):
        wanted = "Parquet"
    elif is_csv_name(path):
        wanted = "gzip-compressed data" if path.name.lower().endswith(".gz") else "text"
    else:
        names = ", ".join((*PARQUET_SUFFIXES, *CSV_SUFFIXES))
        raise DataError(f"{path}: the name of a table needs to end with one of {names}")
    got = _contents(path)
    if got != wanted:
        raise DataError(f"{path}: the name says {wanted}, but the contents are {got}")
    table, schema = _read_parquet(path) if wanted == "Parquet" else _read_csv(path)
    if schema is not None and schema.num_rows != table.num_rows:
        raise DataError(
            f"{path}: the schema was written for {schema.num_rows:,} rows, but there are {table.num_rows:,}: "
            "the file was cut or changed"
        )
    return table, schema


def _contents(path: Path) -> str:
    """What a file holds, from its first bytes, in words."""
    with path.open("rb") as file:
        start = file.read(_LOOK_BYTES)
    if not start:
        return "empty"
    for magic, what in (
        (b"PAR1", "Parquet"),
        (b"\x1f\x8b", "gzip-compressed data"),
        (b"\x89HDF", "HDF5"),
        (b"PK\x03\x04", "a zip archive (perhaps a spreadsheet)"),
        (b"\xff\xfe", "text in UTF-16, not UTF-8"),
        (b"\xfe\xff", "text in UTF-16, not UTF-8"),
    ):
        if start.startswith(magic):
            return what
    if b"\0" in start:
        return "binary data"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "not UTF-8 text"
    return "text"


def _read_parquet(path: Path) -> tuple[pa.Table, TableSchema | None]:
    try:
        with pq.ParquetFile(path) as file:
            table = file.read()
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: no whole Parquet file: {error}") from error
    text = (table.schema.metadata or {}).get(METADATA_KEY)
    return table, None if text is None else TableSchema.from_text(text.decode(), str(path))


def _read_csv(path: Path) -> tuple[pa.Table, TableSchema | None]:
    beside = schema_path(path)
    schema = None
    if beside.is_file():
        schema = TableSchema.from_text(beside.read_text(encoding="utf-8", errors="replace"), str(beside))
    types = {} if schema is None else {name: pa.type_for_alias(kind) for name, kind in schema.types.items()}
    try:
        with pa.input_stream(path) as stream:
            table = pa_csv.read_csv(
                stream,
                parse_options=pa_csv.ParseOptions(newlines_in_values=True),
                convert_options=pa_csv.ConvertOptions(
                    column_types=types, strings_can_be_null=True, quoted_strings_can_be_null=False
                ),
            )
    except (pa.ArrowException, OSError, zlib.error, UnicodeDecodeError) as error:
        raise DataError(f"{path}: no whole CSV file: {error}") from error
    if schema is not None and not _ends_with_newline(path):
        raise DataError(f"{path}: the last line is not whole: the file was cut")
    return table, schema


def _ends_with_newline(path: Path) -> bool:
    """Whether the last line is finished; a compressed file is checked by its own checksum."""
    if path.name.lower().endswith(".gz"):
        return True
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) == b"\n"
