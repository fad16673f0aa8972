"""Signals as people name them: with or without `observation.` and `action.`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tvae.data.table_schema import ACTION, OBSERVATION


def bare(name: str) -> str:
    """The name of a column without `observation.` or `action.`.

    >>> bare("action.jump"), bare("reward")
    ('jump', 'reward')
    """
    return name.removeprefix(OBSERVATION) if name.startswith(OBSERVATION) else name.removeprefix(ACTION)


def called(wanted: str, signals: Sequence[str], recorded: Mapping[str, str] | None = None) -> str | None:
    """The one of `signals` that is called so, in full, as `recorded`, or without `observation.` or `action.`.

    None where there is none, or more than one.

    >>> called("x", ["observation.x", "action.dx"]), called("x", ["observation.x", "action.x"])
    ('observation.x', None)
    """
    if wanted in signals:
        return wanted
    own = [name for name in signals if wanted in ((recorded or {}).get(name), bare(name))]
    return own[0] if len(own) == 1 else None
