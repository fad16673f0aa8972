"""A run directory: all that a run leaves, each file written whole or not at all."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tvae.errors import TvaeError
from tvae.files import appearing


class RunDirectoryError(TvaeError):
    """A run directory that cannot be used as asked; the message says what to do."""


@dataclass(frozen=True)
class RunDirectory:
    """The paths of a run's files.

    | file                     | what                                                          |
    |--------------------------|---------------------------------------------------------------|
    | `config.json`            | schema version, model, configuration, data, command           |
    | `model.safetensors`      | weights                                                       |
    | `playstyles.json`        | the styles: weights, distributions of z, words, own names     |
    | `styles.parquet`         | one row per episode: style, probability, z, likelihood        |
    | `metrics.json`           | numbers                                                       |
    | `history.json`           | the evaluations during training                               |
    | `report.html`            | the page to look at                                           |
    | `rollouts/`              | test episodes of each style                                   |
    | `checkpoint.safetensors` | what resuming needs                                           |
    | `tensorboard/`           | events                                                        |
    """

    path: Path

    @property
    def config(self) -> Path:
        return self.path / "config.json"

    @property
    def model(self) -> Path:
        return self.path / "model.safetensors"

    @property
    def playstyles(self) -> Path:
        return self.path / "playstyles.json"

    @property
    def styles(self) -> Path:
        return self.path / "styles.parquet"

    @property
    def metrics(self) -> Path:
        return self.path / "metrics.json"

    @property
    def history(self) -> Path:
        return self.path / "history.json"

    @property
    def report(self) -> Path:
        return self.path / "report.html"

    @property
    def demonstrations(self) -> Path:
        return self.path / "demonstrations.parquet"

    @property
    def checkpoint(self) -> Path:
        return self.path / "checkpoint.safetensors"

    @property
    def tensorboard(self) -> Path:
        return self.path / "tensorboard"

    def rollouts(self, style: int) -> Path:
        """Test episodes of one style."""
        return self.path / "rollouts" / f"style-{style}.parquet"

    @classmethod
    def create(cls, path: Path, *, force: bool) -> RunDirectory:
        """A new directory; one that exists is refused, or with `force` emptied if it is a run's.

        Raises `RunDirectoryError` if it exists, or is no run's.
        """
        if path.exists() and any(path.iterdir() if path.is_dir() else [path]):
            if not force:
                raise RunDirectoryError(
                    f"{path} exists already; choose another --out, continue it with --resume, "
                    "or replace it with --force"
                )
            if not _is_run(path):
                raise RunDirectoryError(
                    f"{path} is not a run directory (no config.json of a run), so --force leaves it alone"
                )
            shutil.rmtree(path)
        path.mkdir(parents=True, exist_ok=True)
        return cls(path)

    @classmethod
    def existing(cls, path: Path) -> RunDirectory:
        """A directory that a run made; `RunDirectoryError` if it is none."""
        if not (path / "config.json").is_file():
            raise RunDirectoryError(f"{path} is not a run directory: it has no config.json")
        return cls(path)


def _is_run(path: Path) -> bool:
    """Whether a run began in this directory; other programs have a `config.json` too."""
    try:
        there = json.loads((path / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(there, dict) and there.get("format") == "tvae-model" and "run" in there


def write_json(path: Path, data: Any) -> None:
    """Write JSON, whole or not at all, without a copy of the text in memory."""
    with appearing(path, overwrite=True) as partial, partial.open("w", encoding="utf-8") as file:
        json.dump(data, file, indent=2, allow_nan=False)
        file.write("\n")


def read_json(path: Path) -> Any:
    """The data of a JSON file; `RunDirectoryError` if it is missing or broken."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise RunDirectoryError(f"{path} is missing: the run did not get that far") from None
    except ValueError as error:
        raise RunDirectoryError(f"{path} is not whole: {error}") from error
