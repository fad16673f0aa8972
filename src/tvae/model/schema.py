"""The version of a saved model: what this code writes, and all that it reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tvae.errors import ModelError

SCHEMA_VERSION = 4


def check_version(description: Any, path: Path) -> None:
    """Raise `ModelError` unless `path` holds the description of a model that this version reads."""
    if not isinstance(description, dict) or description.get("format") != "tvae-model":
        raise ModelError(f"{path} does not describe a tvae model")
    version = description.get("schema_version")
    if version != SCHEMA_VERSION:
        age = "a newer" if isinstance(version, int) and version > SCHEMA_VERSION else "an older"
        raise ModelError(
            f"{path} has schema version {version}, this tvae reads version {SCHEMA_VERSION}: "
            f"it was written by {age} release; install that one, or fit the model again"
        )
