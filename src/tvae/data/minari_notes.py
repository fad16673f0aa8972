"""What we note in a Minari data set, because Minari has no place of its own for it.

The entry `tvae` of its metadata holds names and kinds of signals, text categories, which columns were
recorded, and which infos and facts about episodes are our step columns and attributes. The metadata of each
episode say whether the observation after the last action was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tvae.data.names import absent, is_named
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.data.trajectory import DataError
from tvae.spaces import Space

ENTRY = "tvae"
FINAL_OBSERVED = "final_observed"
COLUMNS = {"reward": "rewards", "terminated": "terminations", "truncated": "truncations"}
"""Minari's name of our step columns."""
_VERSION = 1


@dataclass(frozen=True)
class MinariNotes:
    """How to read the signals and facts of a Minari data set."""

    observation_space: Space
    action_space: Space
    observation_keys: Sequence[str]
    """Which signal of the stored space is which signal of `observation_space`."""
    action_keys: Sequence[str]
    """Likewise for `action_space`."""
    columns: Sequence[str]
    """Those of `reward`, `terminated`, `truncated` that were recorded."""
    infos: Mapping[str, str]
    """The step column in each info."""
    attributes: Mapping[str, str]
    """The attribute in each entry of an episode's metadata."""

    def only(self, columns: Sequence[str]) -> MinariNotes:
        """How to read the signals of these columns, such as `observation.state` or `action`; without any, of all.

        Raises `DataError` for a column that is not there, and where no observation or no action is left.
        """
        names = [OBSERVATION + name for name in self.observation_space.names]
        names += [ACTION + name for name in self.action_space.names]
        for wanted in columns:
            if not any(is_named(name, wanted) for name in names):
                raise DataError(absent(wanted, names))
        seen, seen_keys = _chosen(OBSERVATION, self.observation_space, self.observation_keys, columns)
        done, done_keys = _chosen(ACTION, self.action_space, self.action_keys, columns)
        return replace(
            self, observation_space=seen, observation_keys=seen_keys, action_space=done, action_keys=done_keys
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        return {
            "version": _VERSION,
            "observation_space": self.observation_space.to_json(),
            "action_space": self.action_space.to_json(),
            "observation_keys": list(self.observation_keys),
            "action_keys": list(self.action_keys),
            "columns": list(self.columns),
            "infos": dict(self.infos),
            "attributes": dict(self.attributes),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> MinariNotes:
        """The notes that `to_json` wrote; raises `DataError` for those of another version."""
        if data["version"] != _VERSION:
            raise DataError(f"version {_VERSION} of our notes is needed, got {data['version']}")
        return cls(
            observation_space=Space.from_json(data["observation_space"]),
            action_space=Space.from_json(data["action_space"]),
            observation_keys=data["observation_keys"],
            action_keys=data["action_keys"],
            columns=data["columns"],
            infos=data["infos"],
            attributes=data["attributes"],
        )


def _chosen(prefix: str, space: Space, keys: Sequence[str], columns: Sequence[str]) -> tuple[Space, list[str]]:
    """The signals that `columns` names, and where they are stored."""
    chosen = [
        (signal, key)
        for signal, key in zip(space.signals, keys, strict=True)
        if not columns or any(is_named(prefix + signal.name, wanted) for wanted in columns)
    ]
    if not chosen:
        there = ", ".join(prefix + name for name in space.names)
        raise DataError(f"needs at least one column {prefix}* to read; there are {there}")
    return Space(tuple(signal for signal, _ in chosen)), [key for _, key in chosen]
