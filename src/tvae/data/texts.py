"""Text in columns of numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

_NUMBER = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*$"
_INTEGER = r"^\s*[-+]?\d{1,18}\s*$"
_WITH_MARK = {
    ",": r"^\s*[-+]?(\d+,\d*|,\d+)([eE][-+]?\d+)?\s*$",
    ".": r"^\s*[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?\s*$",
}
_MOST_SHOWN = 4


def no_numbers(texts: pa.ChunkedArray) -> NDArray[np.bool_]:
    """(N,) where a text is no number; one that is missing counts as a number.

    >>> no_numbers(pa.chunked_array([["1.5", " -2e3", "lost", None]])).tolist()
    [False, False, True, False]
    """
    numbers: NDArray[np.bool_] = pc.fill_null(pc.match_substring_regex(texts, _NUMBER), True).to_numpy()
    return ~numbers


def as_numbers(texts: pa.ChunkedArray) -> pa.ChunkedArray:
    """The numbers that texts are; integers if all are.

    >>> as_numbers(pa.chunked_array([["1", " 2", None]])).to_pylist()
    [1, 2, None]
    """
    whole = pc.all(pc.match_substring_regex(texts, _INTEGER)).as_py()
    return pc.utf8_trim_whitespace(texts).cast(pa.int64() if whole else pa.float64())


def first_with_mark(values: pa.ChunkedArray, mark: str) -> str | None:
    """The first number with this decimal mark, a comma or a point, in text of which at least half is numbers.

    None where there is no such number, or where most is no number.

    >>> first_with_mark(pa.chunked_array([["3", "1,5", "lost"]]), ",")
    '1,5'
    """
    if not pa.types.is_string(values.type):
        return None
    known = pc.drop_null(values)
    marked = pc.match_substring_regex(known, _WITH_MARK[mark])
    numbers = pc.or_(marked, pc.match_substring_regex(known, _NUMBER))
    if not pc.any(marked).as_py() or 2 * (pc.sum(numbers).as_py() or 0) < len(known):
        return None
    return str(known.filter(marked)[0].as_py()).strip()


def with_points(table: pa.Table) -> pa.Table:
    """The same with a decimal point in numbers with a comma that stand in columns of text.

    >>> with_points(pa.table({"ping": ["31,5", "lost"], "cell": ["a", "b"]}))["ping"].to_pylist()
    ['31.5', 'lost']
    """
    for at, name in enumerate(table.column_names):
        texts = table[name]
        if first_with_mark(texts, ",") is not None:
            pointed = pc.if_else(
                pc.match_substring_regex(texts, _WITH_MARK[","]), pc.replace_substring(texts, ",", "."), texts
            )
            table = table.set_column(at, name, pointed)
    return table


def without_nulls(table: pa.Table, nulls: Sequence[str]) -> pa.Table:
    """The same with nothing in place of these texts; a column of which only numbers are left becomes numbers.

    >>> without_nulls(pa.table({"ping": ["31", "lost"], "name": ["ann", "bob"]}), ["lost"]).to_pydict()
    {'ping': [31, None], 'name': ['ann', 'bob']}
    """
    wanted = pa.array(nulls, pa.string())
    for at, name in enumerate(table.column_names):
        texts = table[name]
        if not pa.types.is_string(texts.type):
            continue
        null = pc.is_in(texts, wanted)
        if not pc.any(null).as_py():
            continue
        left = pc.if_else(null, None, texts)
        known = left.null_count < len(left) and not no_numbers(left).any()
        table = table.set_column(at, name, as_numbers(left) if known else left)
    return table


def some_of(texts: pa.ChunkedArray, chosen: NDArray[np.bool_]) -> str:
    """The most frequent of the chosen texts, in words.

    >>> some_of(pa.chunked_array([["1", "lost", "-", "lost"]]), np.array([False, True, True, True]))
    "'lost' or '-'"
    """
    counts = pc.value_counts(texts.filter(pa.array(chosen))).to_pylist()
    found = [one["values"] for one in sorted(counts, key=lambda one: -one["counts"])]
    shown = " or ".join(repr(text) for text in found[:_MOST_SHOWN])
    more = len(found) - _MOST_SHOWN
    return f"{shown} or {more} more" if more > 0 else shown
