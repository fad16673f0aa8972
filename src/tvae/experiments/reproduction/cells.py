"""One training with its measurements: a directory that is made once, and skipped when it is there already."""

from __future__ import annotations

import subprocess
import time
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch

import tvae
from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.device import resolve_device
from tvae.errors import TvaeError
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.evaluate.words import describe
from tvae.experiments.analysis import names_of
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import amounts_of, split, trained
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.subject import Subject
from tvae.experiments.run_directory import read_json, write_json
from tvae.model.schema import SCHEMA_VERSION
from tvae.model.tvae import TrajectoryVAE
from tvae.train.diagnosis import TrainingWarning
from tvae.train.observer import Observer


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

    def is_measured(self) -> bool:
        """Whether its numbers are there; `CellError` where the directory holds another cell."""
        stored = self.directory / "cell.json"
        if stored.exists():
            there = read_json(stored)
        elif self.metrics.exists():
            there = self.read()["cell"]
        else:
            return False
        there, asked = RunConfig.completed(there), _plain(self.asked)
        if there != asked:
            differing = sorted(name for name in {*there, *asked} if there.get(name) != asked.get(name))
            raise CellError(
                f"{self.directory} holds a cell whose {', '.join(differing)} differs from what is asked; "
                "choose another --out, or make it anew with --force"
            )
        return self.metrics.exists()

    def is_finished(self) -> bool:
        """Whether its numbers, its model, which this version can read, and its styles are there."""
        config = self.directory / "config.json"
        return (
            self.is_measured()
            and all((self.directory / name).exists() for name in ("model.safetensors", "findings.json"))
            and config.exists()
            and read_json(config).get("schema_version") == SCHEMA_VERSION
        )

    def run(self, device: str) -> None:
        """Train what is not trained yet, and measure; a training that was killed goes on.

        Raises `CellError`, which names the cell, for whatever goes wrong.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            write_json(self.directory / "cell.json", self.asked)
            demonstrations = STUDIES[self.task].learnt_from(self.preset, self.seed)
            if not (self.directory / "training.json").exists():
                self._train(demonstrations, device)
            began = time.perf_counter()
            code, training = commit(), read_json(self.directory / "training.json")
            subject = self._find_styles(demonstrations, device)
            found = STUDIES[self.task].measures[self.preset](subject)
            seconds = {"measure_seconds": time.perf_counter() - began}
            made = {"commit": code, "cell": self.asked, "versions": _versions()}
            write_json(self.metrics, {**found, **training, **seconds, **made})
        except Exception as error:
            raise CellError(f"{self.name}: {type(error).__name__}: {error}") from error

    def _train(self, demonstrations: Demonstrations, device: str) -> None:
        """Weights and `training.json`, which is written last."""
        checkpoint = self.directory / "checkpoint.safetensors"
        resumed, began, code = checkpoint.exists(), time.perf_counter(), commit()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always", TrainingWarning)
            model, _ = trained(
                demonstrations, self.config, checkpoint=checkpoint, device=device, observer=Observer()
            )
        facts: dict[str, Any] = {
            "trained_at_commit": code,
            "amounts": asdict(amounts_of(self.config, split(demonstrations, self.config)[0])),
            "warnings": [str(warning.message) for warning in warned],
        }
        if not resumed:
            facts["train_seconds"] = time.perf_counter() - began
        model.save(self.directory)
        write_json(self.directory / "training.json", facts)
        checkpoint.unlink(missing_ok=True)

    def _find_styles(self, demonstrations: Demonstrations, device: str) -> Subject:
        model = TrajectoryVAE.load(self.directory).to(resolve_device(device))
        playstyles = find_playstyles(encode(model, demonstrations), seed=self.seed)
        words = describe(demonstrations, playstyles.assignment)
        findings = Findings(playstyles, names_of(playstyles, demonstrations), words)
        write_json(self.directory / "findings.json", findings.to_json())
        return self._subject(model, demonstrations, findings)

    def _subject(self, model: TrajectoryVAE, demonstrations: Demonstrations, findings: Findings) -> Subject:
        test = STUDIES[self.task].test_demonstrations()
        return Subject(model, demonstrations, findings, test, self.seed, self.effort.episodes)

    def read(self) -> dict[str, Any]:
        """The numbers of a finished cell."""
        found: dict[str, Any] = read_json(self.metrics)
        return found

    def subject(self) -> Subject:
        """What pictures are drawn from."""
        return self._subject(
            TrajectoryVAE.load(self.directory),
            STUDIES[self.task].learnt_from(self.preset, self.seed),
            Findings.from_json(read_json(self.directory / "findings.json")),
        )


def commit() -> str:
    """The commit of the checkout that this code lies in, `-dirty` where sources differ; empty outside of one."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=True).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)
        changed = git("status", "--porcelain", "--", ":/src", ":/pyproject.toml", ":/constraints.txt")
        return git("rev-parse", "--short=12", "HEAD") + ("-dirty" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


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
