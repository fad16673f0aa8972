"""T-VAE, ours: styles found without labels, and a bot for each.

Source: "Trajectory VAE for multi-modal imitation" (ICLR 2019 submission), as `docs/paper.md` reads it. Labels name the
styles that were found and teach nothing; styles that bear the same label are one bot. At will, each episode's style is
drawn by the styles' weights. A finished cell of `tvae reproduce` with the very same configuration is read instead of
trained again.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import num_parameters
from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles, match
from tvae.evaluate.styles import AnyStyle, Playstyles, Style, one_of
from tvae.experiments.analysis import names_of
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import amounts_of, split, trained
from tvae.experiments.reproduction.cells import Cell, CellError, Effort
from tvae.experiments.reproduction.studies import STUDIES
from tvae.experiments.reproduction.subject import Subject
from tvae.generate.closed_loop import LatentPolicy
from tvae.train.observer import Observer


@dataclass(frozen=True)
class Ours:
    """Ours, with a configuration."""

    task: str
    config: RunConfig
    cells: Path
    """Where finished cells of `tvae reproduce` lie, if there are any; not a hyperparameter."""

    def learn(self, lesson: Lesson) -> Bots:
        """A bot of each label: of the found styles that bear it, or of any style where none was found for it."""
        read = self._finished(lesson.seed) if lesson.most_steps is None and lesson.one_in == 1 else None
        subject, steps = self._trained(lesson) if read is None else (read.subject(), sum(steps_of(read.config, lesson)))
        bearing = styles_by_label(subject.playstyles, subject.demonstrations) if lesson.labels else {}
        facts: dict[str, Any] = {
            "num_parameters": num_parameters(subject.model),
            "styles_found": len(subject.playstyles),
            "labels_found": len(bearing),
            "gradient_steps": steps,
        }
        if read is not None:
            numbers = read.read()
            facts |= {name: numbers[name] for name in ("train_seconds", "trained_at_commit") if name in numbers}
            facts["from_reproduction"] = True
        every = subject.playstyles.styles
        return Bots(
            LatentPolicy(subject.model, AnyStyle(every)),
            {label: LatentPolicy(subject.model, one_of(bearing.get(label, every))) for label in lesson.labels},
            facts,
        )

    def _finished(self, seed: int) -> Cell | None:
        if self.task not in STUDIES:
            return None
        directory = self.cells / self.task / "default" / f"seed-{seed}"
        cell = Cell(self.task, "default", seed, directory, Effort())
        if cell.config != replace(self.config, seed=seed):
            return None
        try:
            return cell if cell.is_finished() else None
        except CellError:
            return None

    def _trained(self, lesson: Lesson) -> tuple[Subject, int]:
        """The model and its styles, and the gradient steps taken, of the bound and of the policy alone."""
        config = replace(self.config, seed=lesson.seed)
        if lesson.most_steps is not None:  # of which the policy alone takes as many as the bound
            config = Effort(max(1, lesson.most_steps // 2)).config(config, lesson.seed)
        bound, alone = steps_of(config, lesson)
        config = replace(
            config,
            training=replace(config.training, num_steps=bound),
            policy=replace(config.policy, num_steps=alone),
        )
        with tempfile.TemporaryDirectory() as scratch:
            checkpoint = Path(scratch) / "checkpoint.safetensors"
            model, records = trained(
                lesson.demonstrations, config, checkpoint=checkpoint, device="cpu", observer=Observer()
            )
        playstyles = find_playstyles(encode(model, lesson.demonstrations), seed=lesson.seed)
        findings = Findings(playstyles, names_of(playstyles, lesson.demonstrations), {})
        subject = Subject(model, lesson.demonstrations, findings, lesson.demonstrations, lesson.seed, episodes=1)
        return subject, records[-1].step + alone


def steps_of(config: RunConfig, lesson: Lesson) -> tuple[int, int]:
    """Gradient steps of the bound, if it does not end early, and of the policy alone; one in so many of the usual."""
    amounts = amounts_of(config, split(lesson.demonstrations, config)[0])
    bound, alone = (min(steps, max(1, steps // lesson.one_in)) for steps in (amounts.num_steps, amounts.policy_steps))
    return bound, alone


def styles_by_label(playstyles: Playstyles, demonstrations: Demonstrations) -> dict[str, list[Style]]:
    """For each label the found styles in which more than half of the demonstrations carry it, if there are any."""
    labels = demonstrations.attribute("label").astype(str)
    most = match(playstyles.assignment, labels)
    found: dict[str, list[Style]] = {}
    for style in playstyles.styles:
        label = most[style.index]
        if (labels[playstyles.assignment == style.index] == label).mean() > 0.5:
            found.setdefault(label, []).append(style)
    return found
