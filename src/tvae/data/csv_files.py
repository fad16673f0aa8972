"""CSV files as they are written anywhere: which character separates columns, and which marks decimals."""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv

from tvae.data.issues import Issue
from tvae.data.texts import first_with_mark, with_points
from tvae.data.trajectory import DataError

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
"""What may separate columns without being named."""
_NAMED = re.compile(r"sep=(.)", re.IGNORECASE)
_LINE = r'((?:"[^"]*"|[^"\r\n])*)'
_LINES = re.compile(rf"{_LINE}(?:\r\n?|\n)?{_LINE}")
_QUOTED = re.compile(r'"[^"]*"')
_LINE_END = re.compile(r"\r\n?|\n")
_LOOK_BYTES = 1 << 20
_BLOCK_BYTES = 1 << 26


@dataclass(frozen=True)
class CsvFormat:
    """How the text of a CSV file is meant; None is found out from the file.

    >>> CsvFormat(separator=";", decimal=",").separator
    ';'
    """

    separator: str | None = None
    """The character between columns; by default the one of comma, semicolon and tab that the first line has."""
    decimal: str | None = None
    """`.` or `,`; by default a comma where commas do not separate columns and numbers are written so."""

    def __post_init__(self) -> None:
        if self.separator is not None and (len(self.separator) != 1 or self.separator in '"\r\n'):
            raise DataError(f"a separator of columns needs to be one character, got {self.separator!r}")
        if self.decimal not in {None, ".", ","}:
            raise DataError(f"a decimal mark needs to be a point or a comma, got {self.decimal!r}")
        if self.decimal is not None and self.decimal == self.separator:
            raise DataError(f"{self.decimal!r} cannot be both the separator of columns and the decimal mark")


AS_WRITTEN = CsvFormat()


def read_csv(
    path: Path, form: CsvFormat = AS_WRITTEN, types: Mapping[str, str] | None = None
) -> tuple[pa.Table, tuple[Issue, ...]]:
    """The table in a CSV file, whose columns are of these Arrow types where they are known.

    Lines with more or fewer values than the first are left out and reported as an issue. A line `sep=;` before the
    names of the columns, as spreadsheets write it, names the separator.

    Raises `DataError` for a damaged file, for a quote that is never closed, and where separator or decimal mark could
    be one or another.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "walks.csv"
    >>> _ = path.write_text("episode;step;speed\\n7;0;0,5\\n7;1;2\\n")
    >>> read_csv(path)[0].to_pydict()
    {'episode': [7, 7], 'step': [0, 1], 'speed': [0.5, 2.0]}
    """
    separator, skipped = _separator(path, form)
    parts = _Layout(path, separator, skipped)
    if form.decimal is not None or separator == ",":
        mark = form.decimal or "."
    else:
        recorded = parts.read(".", {})
        mark = "." if _first(recorded[0], ",") is None else ","
        if mark == "." and not types:
            return recorded
    table, issues = parts.read(mark, types or {})
    if mark == ".":
        return table, issues
    if form.decimal is None:
        _check_marks(path, table)
    return with_points(table), issues


def _separator(path: Path, form: CsvFormat) -> tuple[str, int]:
    """What separates columns, and how many lines come before their names."""
    first, second = _first_lines(path)
    named = _NAMED.fullmatch(first)
    skipped = 0 if named is None else 1
    if form.separator is not None:
        return form.separator, skipped
    if named is not None:
        return named[1], skipped
    bare = _QUOTED.sub("", second if skipped else first)
    found = [separator for separator in SEPARATORS if separator in bare]
    if len(found) > 1:
        counts = " and ".join(f"{bare.count(one)} times {one!r} ({SEPARATORS[one]})" for one in found)
        raise DataError(
            f"{path}: the line with the names of the columns has {counts} outside quotes: "
            "say which of them separates columns (--separator)"
        )
    return (found[0] if found else ","), skipped


def _first_lines(path: Path) -> tuple[str, str]:
    """The first two lines, without a mark of the byte order; empty where there are none. In quotes no line ends."""
    try:
        with pa.input_stream(path) as stream:
            start = stream.read(_LOOK_BYTES)
    except (pa.ArrowException, OSError, zlib.error) as error:
        raise DataError(f"{path}: no whole CSV file: {error}") from error
    found = _LINES.match(start.decode("utf-8-sig", errors="replace"))
    assert found is not None  # both may be empty
    return found[1], found[2]


def _first(table: pa.Table, mark: str) -> tuple[str, str] | None:
    """The first column of numbers as text, some with this decimal mark, and the first of them."""
    for name in table.column_names:
        found = first_with_mark(table[name], mark)
        if found is not None:
            return name, found
    return None


def _check_marks(path: Path, table: pa.Table) -> None:
    """Raise `DataError` where numbers have points, of a table that was read with a decimal comma."""
    with_point = _first(table, ".")
    if with_point is not None:
        name, value = with_point
        raise DataError(
            f"{path}: some numbers have a decimal comma, but {value} in column {name} has a decimal point: "
            "say which of them marks decimals (--decimal); what has the other one is then text"
        )


def _ends_in_lines(table: pa.Table, uneven: list[pa_csv.InvalidRow]) -> bool:
    """Whether the last value that was read, or a line that was left out, has several lines, as in an open quote."""
    last = table[-1][-1].as_py() if table.num_rows else None
    texts = [*(row.text for row in uneven), last if isinstance(last, str) else ""]
    return any(_LINE_END.search(text) for text in texts)


def _check_quotes(path: Path, separator: str) -> None:
    """Raise `DataError` with the line in which a quote opens that nothing closes; in quotes `""` is a quote."""
    with pa.input_stream(path) as stream:
        text = stream.read().decode("utf-8-sig", errors="replace")
    opening = re.compile(rf'(?<![^{re.escape(separator)}\r\n])"')
    at = 0
    while (found := opening.search(text, at)) is not None:
        at = text.find('"', found.end()) + 1
        while at and text.startswith('"', at):
            at = text.find('"', at + 1) + 1
        if not at:
            line = 1 + len(_LINE_END.findall(text, 0, found.start()))
            raise DataError(f"{path}: line {line} has a quote that is never closed: all behind it would be one value")


@dataclass(frozen=True)
class _Layout:
    """Where the columns of a file are."""

    path: Path
    separator: str
    skipped: int
    """Lines before the names of the columns."""

    def read(self, mark: str, types: Mapping[str, str]) -> tuple[pa.Table, tuple[Issue, ...]]:
        """The rows with this decimal mark, and what is wrong with lines."""
        table, uneven = self._parsed(mark, types, use_threads=True)
        if _ends_in_lines(table, uneven):
            _check_quotes(self.path, self.separator)
        if not uneven:
            return table, ()
        table, uneven = self._parsed(mark, types, use_threads=False)  # only one thread knows the numbers of lines
        first = uneven[0]
        message = (
            f"line {first.number} of {self.path.name} has {first.actual_columns} values, "
            f"but the first line has {first.expected_columns}"
        )
        return table, (Issue(message, count=len(uneven)),)

    def _parsed(
        self, mark: str, types: Mapping[str, str], *, use_threads: bool
    ) -> tuple[pa.Table, list[pa_csv.InvalidRow]]:
        """The table, and the lines that have more or fewer values than the first.

        Types follow from as much of the file as fits in a block, so that all values of a column are of one.
        """
        uneven: list[pa_csv.InvalidRow] = []

        def left_out(row: pa_csv.InvalidRow) -> str:
            uneven.append(row)
            return "skip"

        try:
            with pa.input_stream(self.path) as stream:
                table = pa_csv.read_csv(
                    stream,
                    read_options=pa_csv.ReadOptions(
                        use_threads=use_threads, block_size=_BLOCK_BYTES, skip_rows=self.skipped
                    ),
                    parse_options=pa_csv.ParseOptions(
                        delimiter=self.separator, newlines_in_values=True, invalid_row_handler=left_out
                    ),
                    convert_options=pa_csv.ConvertOptions(
                        column_types={name: pa.type_for_alias(kind) for name, kind in types.items()},
                        decimal_point=mark,
                        strings_can_be_null=True,
                        quoted_strings_can_be_null=False,
                    ),
                )
        except (pa.ArrowException, OSError, zlib.error, UnicodeDecodeError) as error:
            if "straddling" in str(error):  # one line is longer than a block
                _check_quotes(self.path, self.separator)
            raise DataError(f"{self.path}: no whole CSV file: {error}") from error
        return table, uneven
