"""All that `tvae fit` does, from the table of recordings to the report, on few and on many demonstrations.

    python scripts/benchmark_fit.py --counts 20000 --counts 100000

Writes walks of two styles as memory-mapped directories (`NAME.tvae`), fits each in a process of its own with a short
training, and deletes all of it. Of each stage it prints

- `seconds`: time from its beginning to its end;
- `processor`: seconds of the processor in it, which other processes disturb less;
- `resident`: the largest resident set during it (VmHWM of Linux, reset at its beginning), pages of the mapped files
  among it;
- `anonymous`: the largest part of it that is no page of a file (RssAnon of Linux, looked at every 20 ms), which the
  kernel cannot drop when memory is short.

A stage that is indented is part of the one above it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from types import ModuleType
from typing import Any

import cyclopts
import torch
from benchmark_streaming import make, megabytes
from rich.console import Console

from tvae.config import ModelConfig, RunConfig, TrainingConfig
from tvae.experiments import analysis, fitting, reporting, run, using
from tvae.experiments.source import Source
from tvae.model.decoding import sampled

_PEAK = Path("/proc/self/clear_refs")
_LOOK_SECONDS = 0.02
_PARTS: tuple[tuple[ModuleType, str], ...] = (
    (run, "summarise"),
    (run, "begin"),
    (run, "fit_run"),
    (fitting, "trained"),
    (run, "analyse"),
    (analysis, "encode"),
    (analysis, "find_playstyles"),
    (analysis, "describe"),
    (analysis, "likelihood_per_step"),
    (analysis, "styles_table"),
    (analysis, "write_table"),
    (analysis, "write_json"),
    (analysis, "_latent"),
    (run, "write_report"),
    (reporting, "write"),
)
"""Functions whose calls are stages."""


@dataclass(frozen=True)
class Stage:
    """What a stage took."""

    name: str
    depth: int
    seconds: float
    processor: float
    """Seconds."""
    resident: float
    """MB"""
    anonymous: float
    """MB"""

    def __str__(self) -> str:
        return (
            f"{'  ' * self.depth + self.name:<24}{self.seconds:8.1f} s  processor {self.processor:7.1f} s  "
            f"resident {self.resident:8,.0f} MB  anonymous {self.anonymous:8,.0f} MB"
        )


@dataclass
class Stages:
    """All stages so far, and those that are under way."""

    found: list[Stage | None] = field(default_factory=list)
    open: list[list[float]] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is done within."""
        place, depth = len(self.found), len(self.open)
        self.found.append(None)
        self._note()
        _reset_peak()
        self.open.append([0.0, 0.0])
        done = Event()
        looking = Thread(target=self._look, args=(done,), daemon=True) if depth == 0 else None
        if looking is not None:
            looking.start()
        begun, used = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            seconds, processor = time.perf_counter() - begun, time.process_time() - used
            done.set()
            self._note()
            _reset_peak()
            resident, anonymous = self.open.pop()
            self.found[place] = Stage(name, depth, seconds, processor, resident, anonymous)

    def _look(self, done: Event) -> None:
        while not done.wait(_LOOK_SECONDS):
            self._note()

    def _note(self) -> None:
        """What is under way has come to as much as there is now."""
        resident, anonymous = megabytes("VmHWM"), megabytes("RssAnon")
        for peak in self.open:
            peak[:] = max(peak[0], resident), max(peak[1], anonymous)

    @contextmanager
    def of_calls(self, module: ModuleType, name: str) -> Iterator[None]:
        """Each call of a module's function is a stage meanwhile."""
        function: Callable[..., Any] = getattr(module, name)

        def staged(*arguments: Any, **options: Any) -> Any:
            with self.stage(name.strip("_")):
                return function(*arguments, **options)

        setattr(module, name, staged)
        try:
            yield
        finally:
            setattr(module, name, function)


def _reset_peak() -> None:
    if _PEAK.exists():
        _PEAK.write_text("5")


def fit(directory: Path, num_steps: int, most_likelihoods: int | None = None) -> list[Stage]:
    """Fit what `make` wrote, and generate from it, in this process."""
    torch.set_num_threads(1)
    if most_likelihoods is not None:
        analysis.MOST_LIKELIHOODS = most_likelihoods
    stages = Stages()
    training = TrainingConfig(num_steps=num_steps, evaluate_every=num_steps)
    config = RunConfig(model=ModelConfig(), training=training, seed=0, group=None)
    out = directory.with_suffix(".run")
    console = Console(file=sys.stderr)
    with ExitStack() as stack:
        for module, name in _PARTS:
            stack.enter_context(stages.of_calls(module, name))
        stack.enter_context(stages.stage("tvae fit"))
        begun = run.new_run(
            out, Source(str(directory)), config, None, command=["tvae"], device="cpu", force=False
        )
        run.complete(begun, device="cpu", console=console)
    with stages.stage("tvae generate"):
        finished = using.open_run(out, "cpu")
        using.imagine_style(finished, "0", 100, choice=sampled, window=None, seed=0)
    return [stage for stage in stages.found if stage is not None]


def alone(call: Callable[..., Any], *arguments: object) -> Any:
    """What a function gives in a fresh process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(call, *arguments).result()


def main(
    *, counts: tuple[int, ...] = (20_000, 100_000), length: int = 50, steps: int = 100, likelihoods: int | None = None
) -> None:
    """Print a line for each stage of each fit.

    Parameters
    ----------
    counts
        Numbers of episodes; may be repeated.
    length
        Steps of each episode.
    steps
        Steps of each training.
    likelihoods
        Sessions whose likelihood is computed; by default as many as `tvae fit` takes, of which each takes as long as
        any other.
    """
    for count in counts:
        with TemporaryDirectory(dir=Path.cwd()) as parent:
            directory = Path(parent) / f"{count}.tvae"
            alone(make, directory, count, length)
            print(f"{count:,} episodes of {length} steps", flush=True)
            for stage in alone(fit, directory, steps, likelihoods):
                print(stage, flush=True)


if __name__ == "__main__":
    cyclopts.run(main)
