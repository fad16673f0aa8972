"""Columns as people name them: by their name, with what is below it, or by a pattern."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase

_MOST_ALIKE = 3


def is_named(name: str, wanted: str) -> bool:
    """Whether a column is the one that is wanted, or a part of it, or fits it as a pattern.

    >>> is_named("action.move.0", "action.move"), is_named("move_x", "move_*"), is_named("actions", "action")
    (True, True, False)
    """
    return name == wanted or name.startswith(f"{wanted}.") or fnmatchcase(name, wanted)


def is_asked_for(name: str, columns: Sequence[str]) -> bool:
    """Whether a column, or a part of it, is among `columns`; without `columns` every one is.

    >>> [is_asked_for("observation.state", columns) for columns in ([], ["observation.state.0"], ["action"])]
    [True, True, False]
    """
    return not columns or any(is_named(name, wanted) or is_named(wanted, name) for wanted in columns)


def absent(wanted: str, there: Collection[str]) -> str:
    """That no column is called so, which ones nearly are, and which there are.

    >>> absent("match", ["match_id", "tick"])
    "no column is called 'match'; perhaps match_id is meant; the columns are match_id, tick"
    """
    return f"no column is called {wanted!r}{alike(wanted, there)}; the columns are {', '.join(there)}"


def alike(wanted: str, there: Collection[str]) -> str:
    """In words, which columns are nearly called so; nothing where none is."""
    found = get_close_matches(wanted, there, n=_MOST_ALIKE)
    return f"; perhaps {' or '.join(found)} is meant" if found else ""
