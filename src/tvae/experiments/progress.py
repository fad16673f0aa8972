"""What a user sees while a run goes on: a bar with the terms of the bound, and TensorBoard events."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch.utils.tensorboard import SummaryWriter

from tvae.train.checkpoint import Record, Terms
from tvae.train.loop import Observer


@contextmanager
def watching(num_steps: int, tensorboard: Path, console: Console) -> Iterator[Observer]:
    """An observer of a training that draws a bar on `console` and writes events to `tensorboard`."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar, SummaryWriter(str(tensorboard), purge_step=0) as events:
        task = bar.add_task("training", total=num_steps)

        def on_step(step: int, terms: Terms) -> None:
            words = f"policy {terms.policy:.1f}  state {terms.state:.1f}  KL {terms.kl:.2f} nats"
            bar.update(task, completed=step, description=words)

        def on_record(record: Record) -> None:
            for part, terms in (("training", record.training), ("held_out", record.held_out)):
                for name in ("policy", "state", "stop", "kl"):
                    events.add_scalar(f"{part}/{name}", getattr(terms, name), record.step)
                events.add_scalar(f"{part}/elbo", terms.value(1.0), record.step)
            events.add_scalar("beta", record.beta, record.step)
            bar.update(task, completed=record.step)

        yield Observer(on_step, on_record)


@contextmanager
def counting(description: str, total: int, console: Console) -> Iterator[Callable[[int], None]]:
    """A bar that counts to `total`; call what it gives with the number done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)
