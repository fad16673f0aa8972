"""A column of a table as a signal, and back.

| type of the column                       | signal      |
|------------------------------------------|-------------|
| floating point, decimal                  | continuous  |
| boolean                                  | binary      |
| text with at most 200 different values   | categorical |
| integer with at most 20 different values | categorical |

A column with more values has no kind until the user says which one: an identity and a count look alike, and so do a
name and a category. Nor have more than 20 different numbers that are written as text.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from tvae.data.issues import Remedy
from tvae.data.texts import first_with_mark, no_numbers
from tvae.data.trajectory import DataError
from tvae.spaces import Angular, Binary, Categorical, Continuous, FloatArray, Signal

MOST_CATEGORIES = 20
MOST_TEXTS = 200
_FEW_ROWS = 100
UNKNOWN_CATEGORY = -1.0
"""What `encode` gives a value that is none of the categories."""


class KindError(ValueError):
    """A column that cannot be what it should be; the message continues "column x ..."."""

    def __init__(self, message: str, remedy: Remedy | None = None) -> None:
        super().__init__(message)
        self.remedy = remedy


def kinds_by_column(
    angular: Iterable[str], continuous: Iterable[str], categorical: Iterable[str], binary: Iterable[str]
) -> dict[str, type[Signal]]:
    """The kind that the user gave each of these columns.

    Raises `DataError` for a column that was given two.

    >>> kinds_by_column(["observation.heading"], [], [], [])
    {'observation.heading': <class 'tvae.spaces.Angular'>}
    """
    kinds: dict[str, type[Signal]] = {}
    given = ((Angular, angular), (Continuous, continuous), (Categorical, categorical), (Binary, binary))
    for kind, columns in given:
        for column in columns:
            if kinds.setdefault(column, kind) is not kind:
                raise DataError(f"column {column} needs one kind, got two")
    return kinds


def plain(values: pa.ChunkedArray) -> pa.ChunkedArray:
    """The same values as numbers, booleans or text where they were stored in a more special way."""
    kind = values.type
    if pa.types.is_dictionary(kind):
        return plain(values.cast(kind.value_type))
    if pa.types.is_decimal(kind):
        return values.cast(pa.float64(), safe=False)
    if pa.types.is_float16(kind):
        return values.cast(pa.float32())
    if pa.types.is_large_string(kind) or pa.types.is_string_view(kind):
        return values.cast(pa.string())
    return values


def signal_of(name: str, values: pa.ChunkedArray, kind: type[Signal] | None = None) -> Signal:
    """What a column is: of the given kind, or of the one that its type suggests.

    Raises `KindError` where that cannot be.

    >>> signal_of("move", pa.chunked_array([["right", "left", None, "left"]]))
    Categorical(name='move', categories=('left', 'right'))
    """
    kind = kind or _suggested_kind(values)
    if kind is Categorical:
        return Categorical(name, _categories(values))
    if kind is not Binary and not _is_number(values.type):
        raise KindError(f"cannot be {kind.__name__.lower()}: needs numbers, got {values.type}")
    assert kind in {Continuous, Angular, Binary}
    return kind(name)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind))


def _suggested_kind(values: pa.ChunkedArray) -> type[Signal]:
    kind = values.type
    if pa.types.is_floating(kind):
        return Continuous
    if pa.types.is_boolean(kind):
        return Binary
    if pa.types.is_null(kind):
        raise KindError("holds no values at all", Remedy.IGNORE)
    if not (pa.types.is_integer(kind) or pa.types.is_string(kind)):
        raise KindError(f"needs numbers, booleans or text, got {kind}{_inside(values)}", Remedy.IGNORE)
    count = pc.count_distinct(values).as_py()
    if count <= MOST_CATEGORIES:
        return Categorical
    if pa.types.is_integer(kind) or not no_numbers(values).any():
        what = "integers" if pa.types.is_integer(kind) else "numbers as text"
        raise KindError(
            f"holds {count} different {what}, more than {MOST_CATEGORIES}: "
            "say whether it is continuous, angular or categorical",
            Remedy.SAY_KIND,
        )
    with_comma = first_with_mark(values, ",")
    if with_comma is not None:
        message = f"holds {count} different texts, such as {with_comma!r}: are they numbers with a decimal comma?"
        raise KindError(message, Remedy.SAY_DECIMAL)
    if count > MOST_TEXTS:
        raise KindError(
            f"holds {count} different texts, more than {MOST_TEXTS}: say that it is categorical, or leave it out",
            Remedy.SAY_CATEGORY_OR_IGNORE,
        )
    return Categorical


def _inside(values: pa.ChunkedArray) -> str:
    """What stands in a column of lists or files, and what to do, in words; nothing for other types."""
    kind = values.type
    if pa.types.is_struct(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        return ": images and other files cannot be learned from"
    shape = []
    value = next((found for found in values.slice(0, _FEW_ROWS).to_pylist() if found is not None), None)
    while isinstance(value, list):
        shape.append(len(value))
        value = value[0] if value else None
    if not shape:
        return ""
    if len(shape) > 1:
        return f", the first of the shape {tuple(shape)}: images cannot be learned from"
    return f", the first of {shape[0]} values: make a column of each, such as NAME.0, NAME.1"


def _whole(values: pa.ChunkedArray) -> pa.ChunkedArray:
    """Numbers as integers; NaN counts as missing. Raises `KindError` for a fraction."""
    if pa.types.is_floating(values.type):
        values = pc.if_else(pc.is_nan(values), None, values)
    try:
        return values.cast(pa.int64())
    except pa.ArrowInvalid as error:
        raise KindError(f"cannot be categorical: {error}") from None


def _categories(values: pa.ChunkedArray) -> tuple[int | str, ...]:
    if pa.types.is_string(values.type):
        unique = values.unique()
    elif _is_number(values.type):
        unique = _whole(values).unique()
    else:
        raise KindError(f"cannot be categorical: needs text or integers, got {values.type}")
    found: list[Any] = sorted(unique.drop_null().to_pylist())
    if not found:
        raise KindError("holds no values at all")
    return tuple(found)


def encode(signal: Signal, values: pa.ChunkedArray) -> FloatArray:
    """(N,) the raw values of a column: NaN where one is missing, -1 where it is none of the categories.

    Raises `KindError` where the column's type does not fit the signal.

    >>> encode(Categorical("move", ("left", "right")), pa.chunked_array([["right", None, "up"]])).tolist()
    [1.0, nan, -1.0]
    """
    if isinstance(signal, Categorical):
        return _codes(signal, values)
    if not (_is_number(values.type) or pa.types.is_null(values.type)):
        raise KindError(f"needs numbers, got {values.type}")
    try:
        return _floats(values.cast(pa.float64()))
    except pa.ArrowInvalid as error:
        raise KindError(f"cannot be {type(signal).__name__.lower()}: {error}") from None


def _floats(values: pa.ChunkedArray) -> FloatArray:
    floats: FloatArray = values.to_numpy()
    return floats


def _codes(signal: Categorical, values: pa.ChunkedArray) -> FloatArray:
    known = _category_values(signal)
    if pa.types.is_string(known.type):
        same_type = values.cast(pa.string())
    elif _is_number(values.type) or pa.types.is_null(values.type):
        same_type = _whole(values)
    else:
        raise KindError(f"needs one of the integers {listed(signal.categories)}, got {values.type}")
    codes = pc.index_in(same_type, known)
    unknown = pc.and_(pc.is_null(codes), pc.is_valid(same_type))
    return _floats(pc.if_else(unknown, UNKNOWN_CATEGORY, codes.cast(pa.float64())))


def _category_values(signal: Categorical) -> pa.Array:
    """The categories as they stand in a table: integers, or text where any of them is text."""
    if all(isinstance(category, int) for category in signal.categories):
        return pa.array(signal.categories, pa.int64())
    written = [str(category) for category in signal.categories]
    if len(set(written)) < len(written):
        raise KindError(f"has categories that look alike as text: {listed(signal.categories)}")
    return pa.array(written, pa.string())


def listed(categories: tuple[int | str, ...]) -> str:
    """The first categories in words."""
    shown = ", ".join(map(str, categories[:MOST_CATEGORIES]))
    more = len(categories) - MOST_CATEGORIES
    return f"{shown} and {more} more" if more > 0 else shown


def decode(signal: Signal, raw: FloatArray) -> pa.Array:
    """The inverse of `encode`: raw values (N,) as they stand in a table.

    >>> decode(Categorical("move", ("left", "right")), np.array([1.0, 0.0])).to_pylist()
    ['right', 'left']
    """
    if isinstance(signal, Categorical):
        return _category_values(signal).take(pa.array(raw.astype(np.int64)))
    if isinstance(signal, Binary):
        return pa.array(raw != 0)
    return pa.array(raw)


def facts(values: pa.ChunkedArray) -> NDArray[Any]:
    """(N,) a column that is no signal, as numbers, booleans or text; dates and times become ISO text.

    Where a floating-point number is missing it becomes NaN; nothing else may be missing. Raises `KindError`
    for what is no single value (a list, bytes).
    """
    kind = values.type
    if pa.types.is_temporal(kind):
        values = values.cast(pa.string())
    elif not (_is_number(kind) or pa.types.is_string(kind) or pa.types.is_null(kind)):
        raise KindError(f"needs numbers, booleans, text or times, got {kind}", Remedy.IGNORE)
    if pa.types.is_string(values.type):
        coded = values.dictionary_encode().combine_chunks()
        texts: NDArray[Any] = np.array(coded.dictionary.to_pylist() or [""], dtype=np.str_)
        return np.asarray(texts[coded.indices.to_numpy()])
    numbers: NDArray[Any] = values.to_numpy()
    return numbers
