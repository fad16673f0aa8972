"""One method, task and seed: learnt and measured once, and skipped when its numbers are there."""

from __future__ import annotations

import json
import time
import warnings
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch

import tvae
from tvae.baselines.contract import Lesson, Method
from tvae.experiments.benchmark.measures import MEASURES, measure
from tvae.experiments.benchmark.methods import METHODS
from tvae.experiments.benchmark.stored import as_now, name_of
from tvae.experiments.benchmark.task import Task
from tvae.experiments.benchmark.tasks import TASKS
from tvae.experiments.reproduction.cells import CellError, commit
from tvae.experiments.run_directory import read_json, write_json
from tvae.train.diagnosis import TrainingWarning


@dataclass(frozen=True)
class Budget:
    """How much is learnt and measured."""

    most_steps: int | None = None
    """Gradient steps beyond which no method goes; None leaves each its own."""
    episodes: int | None = None
    """Fresh episodes of each bot; None leaves each task its own number."""
    part: int = 1
    """Of its own number, one in so many."""

    def episodes_in(self, task: Task) -> int:
        """Fresh episodes of each bot in this task."""
        return max(1, task.episodes // self.part) if self.episodes is None else self.episodes


QUICK = Budget(most_steps=30, part=20)


@dataclass(frozen=True)
class BenchmarkCell:
    """Where the numbers of a method, a task and a seed are."""

    method: str
    task: str
    seed: int
    directory: Path
    budget: Budget
    finished: Path
    """Where finished cells of `tvae reproduce` lie."""
    data: Path = Path("data")
    """The folder of the recordings of people."""
    one_in: int = 1
    """Of its own gradient steps the method takes one in so many (`tvae.experiments.benchmark.sooner`)."""

    @property
    def name(self) -> str:
        """As progress shows it."""
        return name_of({"task": self.task, "method": self.method, "seed": self.seed, "one_in": self.one_in})

    @property
    def numbers(self) -> Path:
        """Its numbers and what made them; the only file, written last."""
        return self.directory / "metrics.json"

    def _made(self) -> Method:
        return METHODS[self.method].make(self.task, self.finished)

    @property
    def asked(self) -> dict[str, Any]:
        """All that its numbers depend on, but for the code; as JSON gives it back."""
        asked = {
            "method": self.method,
            "task": self.task,
            "seed": self.seed,
            "most_steps": self.budget.most_steps,
            "one_in": self.one_in,
            "episodes": self.budget.episodes_in(TASKS[self.task]),
            "config": hyperparameters(self._made()),
            "measures": MEASURES,
        }
        found: dict[str, Any] = json.loads(json.dumps(asked))
        return found

    def is_measured(self) -> bool:
        """Whether its numbers are there; `CellError` where they are of another cell than this."""
        if not self.numbers.exists():
            return False
        there, asked = as_now(self.read()["cell"]), self.asked
        if there != asked:
            differing = sorted(name for name in {*there, *asked} if there.get(name) != asked.get(name))
            raise CellError(
                f"{self.directory} holds a cell whose {', '.join(differing)} differs from what is asked; "
                "choose another --out, or make it anew with --force"
            )
        return True

    def read(self) -> dict[str, Any]:
        """The numbers of a measured cell."""
        found: dict[str, Any] = read_json(self.numbers)
        return found

    def run(self) -> None:
        """Learn and measure; `CellError`, which names the cell, for whatever goes wrong."""
        try:
            task = TASKS[self.task]
            demonstrations = task.demonstrations(self.data, self.seed)
            lesson = Lesson(demonstrations, task.world, self.seed, self.budget.most_steps, self.one_in)
            code, began = commit(), time.process_time()
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always", TrainingWarning)
                bots = self._made().learn(lesson)
            spent = {"train_seconds": time.process_time() - began, "env_steps": lesson.steps.count}
            test = task.test(self.data, self.seed)
            found = measure(bots, task, test, episodes=self.budget.episodes_in(task), seed=self.seed)
            made = {
                "warnings": [str(warning.message) for warning in warned],
                "commit": code,
                "cell": self.asked,
                "versions": {"tvae": tvae.__version__, "torch": torch.__version__},
                "threads": torch.get_num_threads(),
            }
            write_json(self.numbers, {**found, **spent, **bots.facts, **made})
        except Exception as error:
            raise CellError(f"{self.name}: {type(error).__name__}: {error}") from error


def hyperparameters(method: Method) -> dict[str, Any]:
    """A method's fields as plain data; where files lie is none of them.

    >>> from tvae.baselines.trivial import Walking
    >>> hyperparameters(Walking())
    {}
    """
    if not hasattr(method, "__dataclass_fields__"):
        raise TypeError(f"a method is a dataclass whose fields are its hyperparameters, got {type(method).__name__}")
    data: Any = method
    values = asdict(data)
    return {field.name: values[field.name] for field in fields(data) if not isinstance(values[field.name], Path)}
