"""Parquet and CSV files as Arrow tables, with the schema that we wrote into or beside them."""

from __future__ import annotations

import codecs
import zlib
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from tvae.data.issues import Issue
from tvae.data.raw_table import RawTable
from tvae.data.table_schema import TableSchema
from tvae.data.trajectory import DataError

PARQUET_SUFFIXES = (".parquet", ".pq")
CSV_SUFFIXES = (".csv", ".csv.gz")
METADATA_KEY = b"tvae"
_LOOK_BYTES = 1 << 16
_BLOCK_BYTES = 1 << 26


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


def read_table_file(path: Path) -> RawTable:
    """The table in a Parquet or CSV file, and its schema if we wrote it.

    Lines of a CSV file with more or fewer values than the first are left out and reported as an issue.

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
    raw = _read_parquet(path) if wanted == "Parquet" else _read_csv(path)
    if raw.schema is not None and raw.schema.num_rows != raw.table.num_rows:
        raise DataError(
            f"{path}: the schema was written for {raw.schema.num_rows:,} rows, but there are {raw.table.num_rows:,}: "
            "the file was cut or changed"
        )
    return raw


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


def _read_parquet(path: Path) -> RawTable:
    try:
        with pq.ParquetFile(path) as file:
            table = file.read()
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: no whole Parquet file: {error}") from error
    text = (table.schema.metadata or {}).get(METADATA_KEY)
    return RawTable(table, None if text is None else TableSchema.from_text(text.decode(), str(path)))


def _read_csv(path: Path) -> RawTable:
    beside = schema_path(path)
    schema = None
    if beside.is_file():
        schema = TableSchema.from_text(beside.read_text(encoding="utf-8", errors="replace"), str(beside))
    table, uneven = _parsed(path, schema, use_threads=True)
    if uneven:
        table, uneven = _parsed(path, schema, use_threads=False)  # only a single thread knows the numbers of lines
    if schema is not None and not _ends_with_newline(path):
        raise DataError(f"{path}: the last line is not whole: the file was cut")
    issues = []
    if uneven:
        first = uneven[0]
        message = (
            f"line {first.number} of {path.name} has {first.actual_columns} values, "
            f"but the first line has {first.expected_columns}"
        )
        issues.append(Issue(message, count=len(uneven)))
    return RawTable(table, schema, tuple(issues))


def _parsed(
    path: Path, schema: TableSchema | None, *, use_threads: bool
) -> tuple[pa.Table, list[pa_csv.InvalidRow]]:
    """The table of a CSV file, and the lines that have more or fewer values than the first.

    Types follow from as much of the file as fits in a block, so that all values of a column are of one.
    """
    types = {} if schema is None else {name: pa.type_for_alias(kind) for name, kind in schema.types.items()}
    uneven: list[pa_csv.InvalidRow] = []

    def left_out(row: pa_csv.InvalidRow) -> str:
        uneven.append(row)
        return "skip"

    try:
        with pa.input_stream(path) as stream:
            table = pa_csv.read_csv(
                stream,
                read_options=pa_csv.ReadOptions(use_threads=use_threads, block_size=_BLOCK_BYTES),
                parse_options=pa_csv.ParseOptions(newlines_in_values=True, invalid_row_handler=left_out),
                convert_options=pa_csv.ConvertOptions(
                    column_types=types, strings_can_be_null=True, quoted_strings_can_be_null=False
                ),
            )
    except (pa.ArrowException, OSError, zlib.error, UnicodeDecodeError) as error:
        raise DataError(f"{path}: no whole CSV file: {error}") from error
    return table, uneven


def _ends_with_newline(path: Path) -> bool:
    """Whether the last line is finished; a compressed file is checked by its own checksum."""
    if path.name.lower().endswith(".gz"):
        return True
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) == b"\n"
