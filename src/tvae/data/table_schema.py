"""What a table that we write holds, so that nothing is lost when it is read again.

It goes into the metadata of a Parquet file and stands beside a CSV file as `NAME.csv.schema.json`.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from tvae.data.trajectory import DataError
from tvae.spaces import Space

FORMAT = "tvae-table"
VERSION = 1
OBSERVATION = "observation."
ACTION = "action."


@dataclass(frozen=True)
class TableSchema:
    """The columns of a table: signals, facts about steps, facts about episodes."""

    observation_space: Space
    action_space: Space
    steps: tuple[str, ...]
    """Columns with a value for every action."""
    attributes: tuple[str, ...]
    """Columns with a value for every episode, `episode` not among them."""
    types: Mapping[str, str]
    """Name of the Arrow type of every column, in their order."""
    num_rows: int

    def only(self, columns: Collection[str]) -> TableSchema:
        """What it says about these columns."""

        def narrow(prefix: str, space: Space) -> Space:
            return Space(tuple(signal for signal in space.signals if prefix + signal.name in columns))

        return replace(
            self,
            observation_space=narrow(OBSERVATION, self.observation_space),
            action_space=narrow(ACTION, self.action_space),
            steps=tuple(name for name in self.steps if name in columns),
            attributes=tuple(name for name in self.attributes if name in columns),
            types={name: kind for name, kind in self.types.items() if name in columns},
        )

    def over(self, num_rows: int) -> TableSchema:
        """The same for another number of rows."""
        return replace(self, num_rows=num_rows)

    def to_text(self) -> str:
        """As JSON."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "num_rows": self.num_rows,
            "observation_space": self.observation_space.to_json(),
            "action_space": self.action_space.to_json(),
            "steps": list(self.steps),
            "attributes": list(self.attributes),
            "types": dict(self.types),
        }
        return json.dumps(content, indent=2, ensure_ascii=False)

    @classmethod
    def from_text(cls, text: str, where: str) -> TableSchema | None:
        """The inverse of `to_text`; None for JSON that is no such schema.

        Raises `DataError`, naming `where` it was found, for a damaged one.
        """
        try:
            content: Any = json.loads(text)
            if not isinstance(content, dict) or content.get("format") != FORMAT:
                return None
            if content["version"] != VERSION:
                raise ValueError(f"version {VERSION} is needed, got {content['version']}")
            types = {str(name): str(kind) for name, kind in content["types"].items()}
            for kind in types.values():
                pa.type_for_alias(kind)
            return cls(
                observation_space=Space.from_json(content["observation_space"]),
                action_space=Space.from_json(content["action_space"]),
                steps=tuple(map(str, content["steps"])),
                attributes=tuple(map(str, content["attributes"])),
                types=types,
                num_rows=int(content["num_rows"]),
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{where}: the schema is damaged: {error}") from error
