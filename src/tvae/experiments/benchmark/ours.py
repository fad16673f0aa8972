"""T-VAE, ours, with the configuration of the task's reproduction: styles found without labels, a bot for each.

Source: "Trajectory VAE for multi-modal imitation" (ICLR 2019 submission), as `docs/paper.md` reads it. Labels name the
styles that were found and teach nothing. At will, each episode's style is drawn by the styles' weights. A finished cell
of `tvae reproduce` with the very same configuration is read instead of trained again.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import num_parameters
from tvae.config import RunConfig
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.evaluate.styles import Playstyles
from tvae.experiments.analysis import names_of
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import trained
from tvae.experiments.reproduction.cells import Cell, CellError, Effort
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.subject import Subject
from tvae.generate.closed_loop import LatentPolicy
from tvae.spaces import FloatArray
from tvae.train.loop import Observer


@dataclass(frozen=True)
class Ours:
    """Our default for a task."""

    task: str
    config: RunConfig
    cells: Path
    """Where finished cells of `tvae reproduce` lie, if there are any; not a hyperparameter."""

    @classmethod
    def of(cls, task: str, cells: Path) -> Ours:
        """With the task's own configuration."""
        return cls(task, STUDIES[task].presets["default"], cells)

    def learn(self, lesson: Lesson) -> Bots:
        """A bot of each label: of the found style that bears it, or else of the posteriors of those episodes."""
        read = None if lesson.most_steps is not None else self._finished(lesson.seed)
        subject = self._trained(lesson) if read is None else read.subject()
        steps = Effort(lesson.most_steps).config(self.config, lesson.seed).training.num_steps
        facts = {
            "gradient_steps": min(steps, lesson.limited(steps)),
            "num_parameters": num_parameters(subject.model),
            "styles_found": len(subject.playstyles),
        }
        if read is not None:
            numbers = read.read()
            facts |= {name: numbers[name] for name in ("train_seconds", "trained_at_commit") if name in numbers}
            facts["from_reproduction"] = True
        return Bots(
            LatentPolicy(subject.model, AnyStyle(subject.playstyles)),
            {label: LatentPolicy(subject.model, subject.latents(label)) for label in lesson.labels},
            facts,
        )

    def _finished(self, seed: int) -> Cell | None:
        directory = self.cells / self.task / "default" / f"seed-{seed}"
        cell = Cell(self.task, "default", seed, directory, Effort())
        try:
            return cell if cell.is_finished() else None
        except CellError:
            return None

    def _trained(self, lesson: Lesson) -> Subject:
        config = self.config if lesson.most_steps is None else Effort(lesson.most_steps).config(self.config, 0)
        config = replace(config, seed=lesson.seed)
        with tempfile.TemporaryDirectory() as scratch:
            checkpoint = Path(scratch) / "checkpoint.safetensors"
            model, _ = trained(lesson.demonstrations, config, checkpoint=checkpoint, device="cpu", observer=Observer())
        playstyles = find_playstyles(encode(model, lesson.demonstrations), seed=lesson.seed)
        findings = Findings(playstyles, names_of(playstyles, lesson.demonstrations), {})
        return Subject(model, lesson.demonstrations, findings, lesson.demonstrations, lesson.seed, episodes=1)


@dataclass(frozen=True, eq=False)
class AnyStyle:
    """z of a style that is drawn by the styles' weights, for each episode."""

    playstyles: Playstyles

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        styles = self.playstyles.styles
        weights = np.array([style.weight for style in styles])
        which = rng.choice(len(styles), count, p=weights / weights.sum())
        drawn = np.stack([style.sample(count, rng) for style in styles])
        z: FloatArray = drawn[which, np.arange(count)]
        return z
