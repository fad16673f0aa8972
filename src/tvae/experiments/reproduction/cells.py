"""One training with its measurements: a directory that is made once, and skipped when it is there already."""

from __future__ import annotations

import subprocess
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

import tvae
from tvae.config import RunConfig
from tvae.errors import TvaeError
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.evaluate.styles import Playstyles
from tvae.experiments.fitting import trained
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.subject import Subject
from tvae.experiments.run_directory import read_json, write_json
from tvae.model.tvae import TrajectoryVAE
from tvae.train.loop import Observer, TrainingWarning


class CellError(TvaeError):
    """A stored cell that is not the one that was asked for; the message says what differs."""


@dataclass(frozen=True)
class Effort:
    """How much is trained and measured; `None` leaves the preset's training steps."""

    steps: int | None = None
    """Training steps."""
    episodes: int = 1000
    """Fresh episodes of each bot."""

    def config(self, preset: RunConfig, seed: int) -> RunConfig:
        """A preset's configuration at this effort."""
        training = preset.training if self.steps is None else replace(preset.training, num_steps=self.steps)
        return replace(preset, training=training, seed=seed)


@dataclass(frozen=True)
class Cell:
    """A preset of a task, trained with one seed."""

    task: str
    preset: str
    seed: int
    directory: Path
    effort: Effort

    @property
    def name(self) -> str:
        """As progress shows it."""
        return f"{self.task}, {self.preset.replace('_', ' ')}, seed {self.seed}"

    @property
    def config(self) -> RunConfig:
        """What is trained."""
        return self.effort.config(STUDIES[self.task].presets[self.preset], self.seed)

    @property
    def asked(self) -> dict[str, Any]:
        """All that its numbers depend on, but for the code."""
        return {
            "task": self.task,
            "preset": self.preset,
            "episodes": self.effort.episodes,
            **self.config.to_json(),
        }

    @property
    def metrics(self) -> Path:
        """Its numbers; they are written last."""
        return self.directory / "metrics.json"

    def is_finished(self) -> bool:
        """Whether it is there; `CellError` where the directory holds another cell."""
        if not self.metrics.exists():
            return False
        stored, asked = read_json(self.metrics)["cell"], _plain(self.asked)
        if stored != asked:
            differing = sorted(name for name in {*stored, *asked} if stored.get(name) != asked.get(name))
            raise CellError(
                f"{self.directory} holds a cell whose {', '.join(differing)} differs from what is asked; "
                "choose another --out, or make it anew with --force"
            )
        return (self.directory / "model.safetensors").exists()

    def run(self) -> None:
        """Train, find the styles, measure, and write all of it; a training that was killed goes on."""
        study = STUDIES[self.task]
        self.directory.mkdir(parents=True, exist_ok=True)
        demonstrations = study.demonstrations(self.seed)
        began = time.perf_counter()
        checkpoint = self.directory / "checkpoint.safetensors"
        with warnings.catch_warnings(record=True, category=TrainingWarning) as warned:
            warnings.simplefilter("always", TrainingWarning)
            model, _ = trained(demonstrations, self.config, checkpoint=checkpoint, device="cpu", observer=Observer())
        seconds = time.perf_counter() - began
        playstyles = find_playstyles(encode(model, demonstrations), seed=self.seed)
        subject = Subject(
            model, demonstrations, playstyles, study.test_demonstrations(), self.seed, self.effort.episodes
        )
        found = study.measures[self.preset](subject)
        model.save(self.directory)
        write_json(self.directory / "playstyles.json", playstyles.to_json())
        write_json(
            self.metrics,
            {
                **found,
                "train_seconds": seconds,
                "warnings": [str(warning.message) for warning in warned],
                "commit": commit(),
                "cell": self.asked,
                "versions": _versions(),
            },
        )
        checkpoint.unlink(missing_ok=True)

    def read(self) -> dict[str, Any]:
        """The numbers of a finished cell."""
        found: dict[str, Any] = read_json(self.metrics)
        return found

    def subject(self) -> Subject:
        """What pictures are drawn from."""
        study = STUDIES[self.task]
        return Subject(
            TrajectoryVAE.load(self.directory),
            study.demonstrations(self.seed),
            Playstyles.from_json(read_json(self.directory / "playstyles.json")),
            study.test_demonstrations(),
            self.seed,
            self.effort.episodes,
        )


def commit() -> str:
    """The commit of the checkout that this code lies in, marked where files differ from it; empty outside of one."""
    here = Path(__file__).parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--abbrev=12", "--dirty", "--exclude", "*"],
            cwd=here,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return found.stdout.strip()


def _versions() -> dict[str, str]:
    return {"tvae": tvae.__version__, "torch": torch.__version__}


def _plain(data: Any) -> Any:
    """As JSON gives it back: tuples are lists."""
    match data:
        case dict():
            return {name: _plain(value) for name, value in data.items()}
        case tuple() | list():
            return [_plain(value) for value in data]
        case _:
            return data
