"""Training on more demonstrations than memory should hold, against training on few.

    python scripts/benchmark_streaming.py --few 10000 --many 1000000

Writes both as memory-mapped directories (`NAME.tvae`), trains a model on each in a process of its own, in turns, and
deletes them. Of each training it prints

- `resident`: the largest resident set (VmHWM of Linux), pages of the mapped files among it;
- `anonymous`: the largest part of it that is no page of a file (RssAnon, looked at after each step), which the kernel
  cannot drop when memory is short;
- `step`: the median time from one step to the next;
- `processor`: the median time of the processor from one step to the next, which other processes disturb less;
- `training`: time of the processor for calibration, steps and evaluations together, divided by the number of steps;

and how many times as long each of these times is with many episodes as with few, in the same run of this script.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import cyclopts
import numpy as np
import torch
from numpy.lib.format import open_memmap

from tvae.data.demonstrations import Demonstrations
from tvae.fitting.fit import fit
from tvae.spaces import Angular, Binary, Continuous, Space
from tvae.train.observer import Observer

OBSERVATION = Space((Continuous("x"), Continuous("y")))
ACTION = Space((Angular("heading"), Binary("rest")))
_CHUNK = 10_000


@dataclass(frozen=True)
class Measured:
    """What a training took."""

    resident: float
    """MB"""
    anonymous: float
    """MB"""
    step: float
    """Milliseconds."""
    processor: float
    """Milliseconds."""
    training: float
    """Milliseconds a step."""

    def __str__(self) -> str:
        memory = f"resident {self.resident:,.0f} MB, anonymous {self.anonymous:,.0f} MB"
        times = f"step {self.step:.1f} ms, processor {self.processor:.1f} ms, training {self.training:.1f} ms"
        return f"{memory}, {times}"


def make(directory: Path, num_episodes: int, num_steps: int) -> None:
    """Write walks that turn left or right, a chunk of episodes at a time."""
    rng = np.random.default_rng(0)
    with TemporaryDirectory(dir=directory.parent) as parts:
        observations, actions = (
            open_memmap(Path(parts) / name, mode="w+", dtype=np.float64, shape=(num_episodes, length, 2))
            for name, length in (("observations.npy", num_steps + 1), ("actions.npy", num_steps))
        )
        for first in range(0, num_episodes, _CHUNK):
            count = min(_CHUNK, num_episodes - first)
            turn = rng.choice([-0.2, 0.2], (count, 1)) + 0.1 * rng.standard_normal((count, num_steps))
            heading = rng.uniform(-np.pi, np.pi, (count, 1)) + turn.cumsum(1)
            rest = rng.random((count, num_steps)) < 0.1
            move = ~rest[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
            observations[first : first + count, 0] = rng.standard_normal((count, 2))
            observations[first : first + count, 1:] = observations[first : first + count, :1] + move.cumsum(1)
            actions[first : first + count] = np.stack([(heading + np.pi) % (2 * np.pi) - np.pi, rest], axis=-1)
        at = np.arange(num_episodes)
        Demonstrations(
            OBSERVATION,
            ACTION,
            observations.reshape(-1, 2),
            actions.reshape(-1, 2),
            at * (num_steps + 1),
            at * num_steps,
            np.full(num_episodes, num_steps),
            np.ones(num_episodes, dtype=np.bool_),
            attributes={"episode": at},
        ).write(directory)


def train(directory: Path, num_steps: int) -> Measured:
    """Train on what `make` wrote, in this process."""
    torch.set_num_threads(1)
    demonstrations = Demonstrations.open(directory)
    times, processor, anonymous = [], [], []

    def note(step: int, terms: object) -> None:
        times.append(time.perf_counter())
        processor.append(time.process_time())
        anonymous.append(megabytes("RssAnon"))

    begun = time.process_time()
    fit(demonstrations, num_steps=num_steps, device="cpu", observer=Observer(on_step=note))
    taken = time.process_time() - begun
    return Measured(
        resident=megabytes("VmHWM"),
        anonymous=max(anonymous),
        step=1e3 * float(np.median(np.diff(times))),
        processor=1e3 * float(np.median(np.diff(processor))),
        training=1e3 * taken / len(times),
    )


def megabytes(name: str) -> float:
    """A number of /proc/self/status; NaN where there is none, as elsewhere than on Linux."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith(f"{name}:")), np.nan)


def alone(call: Callable[..., Measured | None], *arguments: object) -> Measured | None:
    """What a function gives in a fresh process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(call, *arguments).result()


def main(*, few: int = 10_000, many: int = 1_000_000, length: int = 50, steps: int = 300, turns: int = 3) -> None:
    """Print a line for each training, and the ratios of the medians.

    Parameters
    ----------
    few, many
        Numbers of episodes.
    length
        Steps of each episode.
    steps
        Steps of each training.
    turns
        Trainings with each number of episodes.
    """
    found: dict[int, list[Measured]] = {few: [], many: []}
    with TemporaryDirectory(dir=Path.cwd()) as parent:
        for count in found:
            alone(make, Path(parent) / f"{count}.tvae", count, length)
        for _ in range(turns):
            for count, all_measured in found.items():
                measured = alone(train, Path(parent) / f"{count}.tvae", steps)
                assert measured is not None
                all_measured.append(measured)
                print(f"{count:,} episodes: {measured}", flush=True)
    for name in ("step", "processor", "training"):
        fast, slow = (float(np.median([getattr(one, name) for one in found[count]])) for count in (few, many))
        print(f"{name}: {slow / fast:.2f} times as long with {many:,} episodes")


if __name__ == "__main__":
    cyclopts.run(main)
