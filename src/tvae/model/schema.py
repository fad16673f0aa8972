"""The description of a saved model: which version this code writes, and the only one that it reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tvae.errors import ModelError

SCHEMA_VERSION = 4


def read_description(directory: Path) -> dict[str, Any]:
    """What `config.json` in `directory` says; `ModelError` unless it describes a model that this version reads."""
    path = directory / "config.json"
    if not path.is_file():
        raise ModelError(f"{directory} is not a model directory: it has no config.json")
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ModelError(f"{path} is not whole JSON: {error}") from error
    if not isinstance(description, dict) or description.get("format") != "tvae-model":
        raise ModelError(f"{path} does not describe a tvae model")
    version = description.get("schema_version")
    if version != SCHEMA_VERSION:
        age = "a newer" if isinstance(version, int) and version > SCHEMA_VERSION else "an older"
        raise ModelError(
            f"{path} has schema version {version}, this tvae reads version {SCHEMA_VERSION}: "
            f"it was written by {age} release; install that one, or fit the model again"
        )
    return description
