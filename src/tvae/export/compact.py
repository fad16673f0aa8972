"""JSON for people to read: short where it can be, with all numbers of a matrix on a single line."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

_WIDTH = 120
_INDENT = "  "


def compact_json(data: Any, indent: str = "", before: int = 0) -> str:
    """Plain data as JSON; whatever fits is on one line of 120 columns, and a vector or matrix is, however long.

    It stands behind `indent` and a name of `before` characters; lines after its first are indented deeper.

    Raises `ValueError` for infinity and NaN.

    >>> vector = {"means": [[0.25, -1.5]] * 2, "words": ["a rare word and another one " * 2] * 2}
    >>> print(compact_json({"name": "attack", "z": vector}))
    {
      "name": "attack",
      "z": {
        "means": [[0.25, -1.5], [0.25, -1.5]],
        "words": [
          "a rare word and another one a rare word and another one ",
          "a rare word and another one a rare word and another one "
        ]
      }
    }
    """
    line = json.dumps(data, allow_nan=False)
    if not isinstance(data, dict | list) or len(indent) + before + len(line) < _WIDTH or _is_numbers(data):
        return line
    inner = indent + _INDENT
    if isinstance(data, dict):
        names = {f"{json.dumps(key)}: ": value for key, value in data.items()}
        parts = (f"{inner}{name}{compact_json(value, inner, len(name))}" for name, value in names.items())
        return _between("{", parts, indent + "}")
    if any(isinstance(item, dict | list) for item in data):
        return _between("[", (inner + compact_json(item, inner) for item in data), indent + "]")
    return _between("[", _filled([json.dumps(item, allow_nan=False) for item in data], inner), indent + "]")


def _is_numbers(data: Any) -> bool:
    """Whether this is a number, a vector of them, a matrix, and so on."""
    if isinstance(data, list):
        return all(map(_is_numbers, data))
    return isinstance(data, int | float)


def _between(opening: str, lines: Iterator[str], closing: str) -> str:
    return "\n".join([opening, ",\n".join(lines), closing])


def _filled(items: Sequence[str], indent: str) -> Iterator[str]:
    """Lines with as many items as fit, at least one."""
    line = indent + items[0]
    for item in items[1:]:
        if len(line) + len(item) + 3 > _WIDTH:
            yield line
            line = indent + item
        else:
            line = f"{line}, {item}"
    yield line
