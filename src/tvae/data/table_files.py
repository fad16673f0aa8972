"""Parquet and CSV files as Arrow tables, with the schema that we wrote into or beside them."""

from __future__ import annotations

import codecs
import zlib
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from tvae.data.csv_files import AS_WRITTEN, CsvFormat, read_csv
from tvae.data.raw_table import RawTable
from tvae.data.table_schema import TableSchema
from tvae.data.trajectory import DataError

PARQUET_SUFFIXES = (".parquet", ".pq")
CSV_SUFFIXES = (".csv", ".csv.gz", ".tsv", ".tsv.gz")
METADATA_KEY = b"tvae"
_UTF_16 = "text in UTF-16, not UTF-8"
_OTHER_TEXT = "not UTF-8 text"
_LOOK_BYTES = 1 << 16


def is_parquet_name(path: Path) -> bool:
    """Whether a file's name says that it is Parquet."""
    return path.name.lower().endswith(PARQUET_SUFFIXES)


def is_csv_name(path: Path) -> bool:
    """Whether a file's name says that it is CSV, perhaps with tabs or compressed."""
    return path.name.lower().endswith(CSV_SUFFIXES)


def has_tabs(path: Path) -> bool:
    """Whether the name of a CSV file says that tabs separate its columns."""
    return path.name.lower().endswith((".tsv", ".tsv.gz"))


def schema_path(path: Path) -> Path:
    """Where the schema of a CSV file is written.

    >>> schema_path(Path("runs/sessions.csv.gz")).name
    'sessions.csv.gz.schema.json'
    """
    return path.with_name(f"{path.name}.schema.json")


def found_schema(path: Path) -> Path | None:
    """The schema that stands beside a CSV file, if there is one.

    Older versions wrote `NAME.schema.json` for `NAME.csv`, `NAME.csv.gz`, `NAME.tsv` and `NAME.tsv.gz` alike: it counts
    for the only one of them that has no schema of its own.

    Raises `DataError` where there are several.
    """
    if schema_path(path).is_file():
        return schema_path(path)
    older = schema_path(path.with_name(_stem(path)))
    if not older.is_file():
        return None
    likely = sorted(
        other.name
        for other in path.parent.iterdir()
        if is_csv_name(other) and _stem(other) == _stem(path) and not schema_path(other).is_file()
    )
    if len(likely) > 1:
        raise DataError(
            f"{path}: {older.name} needs to be the schema of one file, but could be that of {' or '.join(likely)}: "
            f"rename it after the file that it was written with, such as {schema_path(path).name}"
        )
    return older


def _stem(path: Path) -> str:
    """The name of a CSV file without its ending."""
    suffix = next(suffix for suffix in reversed(CSV_SUFFIXES) if path.name.lower().endswith(suffix))
    return path.name[: -len(suffix)]


def read_table_file(path: Path, form: CsvFormat = AS_WRITTEN) -> RawTable:
    """The table in a Parquet or CSV file, whose text is of this form, and its schema if we wrote it.

    Lines of a CSV file with more or fewer values than the first are left out and reported as an issue.

    Raises `DataError` if there is no such file, or it is not what its name says, or it is damaged.
    """
    if not path.is_file():
        raise DataError(f"{path}: there is no such file")
    compressed = path.name.lower().endswith(".gz")
    if is_parquet_name(path):
        wanted = "Parquet"
    elif is_csv_name(path):
        wanted = "gzip-compressed data" if compressed else "text"
    else:
        names = ", ".join((*PARQUET_SUFFIXES, *CSV_SUFFIXES))
        raise DataError(f"{path}: the name of a table needs to end with one of {names}")
    got = _contents(_start(path))
    if got == wanted and compressed:
        wanted, got = "text", _contents(_start(path, "gzip"))
    if got != wanted:
        how = "; save it as UTF-8, which spreadsheets call CSV UTF-8" if got in {_UTF_16, _OTHER_TEXT} else ""
        raise DataError(f"{path}: the name says {wanted}, but the contents are {got}{how}")
    raw = _read_parquet(path) if wanted == "Parquet" else _read_csv(path, form)
    if raw.schema is not None and raw.schema.num_rows != raw.table.num_rows:
        raise DataError(
            f"{path}: the schema was written for {raw.schema.num_rows:,} rows, but there are {raw.table.num_rows:,}: "
            "the file was cut or changed"
        )
    return raw


def _start(path: Path, compression: str | None = None) -> bytes:
    """The first bytes of a file, or of what is compressed in it."""
    try:
        with pa.input_stream(path, compression=compression) as stream:
            return bytes(stream.read(_LOOK_BYTES))
    except (pa.ArrowException, OSError, zlib.error) as error:
        raise DataError(f"{path}: no whole CSV file: {error}") from error


def _contents(start: bytes) -> str:
    """What a file holds, from its first bytes, in words."""
    if not start:
        return "empty"
    for magic, what in (
        (b"PAR1", "Parquet"),
        (b"\x1f\x8b", "gzip-compressed data"),
        (b"\x89HDF", "HDF5"),
        (b"PK\x03\x04", "a zip archive (perhaps a spreadsheet)"),
        (b"\xff\xfe", _UTF_16),
        (b"\xfe\xff", _UTF_16),
    ):
        if start.startswith(magic):
            return what
    if b"\0" in start:
        half = len(start) // 2
        every_second = half > 1 and half in (start[0::2].count(0), start[1::2].count(0))
        return _UTF_16 if every_second else "binary data"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return _OTHER_TEXT
    return "text"


def _read_parquet(path: Path) -> RawTable:
    try:
        with pq.ParquetFile(path) as file:
            table = file.read()
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: no whole Parquet file: {error}") from error
    text = (table.schema.metadata or {}).get(METADATA_KEY)
    return RawTable(table, None if text is None else TableSchema.from_text(text.decode(), str(path)))


def _read_csv(path: Path, form: CsvFormat) -> RawTable:
    beside = found_schema(path)
    schema = None
    if beside is not None:
        schema = TableSchema.from_text(beside.read_text(encoding="utf-8", errors="replace"), str(beside))
    table, issues = read_csv(path, form, None if schema is None else schema.types)
    if schema is not None and not _ends_with_newline(path):
        raise DataError(f"{path}: the last line is not whole: the file was cut")
    return RawTable(table, schema, issues)


def _ends_with_newline(path: Path) -> bool:
    """Whether the last line is finished; a compressed file is checked by its own checksum."""
    if path.name.lower().endswith(".gz"):
        return True
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) == b"\n"
