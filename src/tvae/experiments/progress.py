"""What a user sees while a run goes on: a bar with the terms of the bound, and TensorBoard events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch.utils.tensorboard import SummaryWriter

from tvae.fitting.amounts import Amounts
from tvae.train import checkpoint
from tvae.train.checkpoint import Record
from tvae.train.diagnosis import ending
from tvae.train.observer import Observer
from tvae.train.terms import Terms


@contextmanager
def watching(amounts: Amounts, tensorboard: Path, console: Console) -> Iterator[Observer]:
    """An observer of a training that draws a bar on `console` and writes events to `tensorboard`."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar, SummaryWriter(str(tensorboard), purge_step=0) as events:
        task = bar.add_task("training", total=amounts.num_steps)
        further = bar.add_task("policy alone", total=amounts.policy_steps, visible=amounts.policy_steps > 0)

        def on_step(step: int, terms: Terms) -> None:
            words = f"policy {terms.policy:.1f}  state {terms.state:.1f}  KL {terms.kl:.2f} nats"
            bar.update(task, completed=step, description=words)

        def on_record(record: Record) -> None:
            for name, number in scalars(record).items():
                events.add_scalar(name, number, record.step)
            bar.update(task, completed=record.step)

        def on_policy_step(step: int, nats: float) -> None:
            events.add_scalar("policy_alone/log_likelihood", nats, step)
            bar.update(further, completed=step, description=f"policy alone {nats:.2f} nats")

        def on_note(note: str) -> None:
            bar.console.print(note, markup=False, highlight=False)

        def on_end(progress: checkpoint.Progress) -> None:
            said = ending(progress, amounts.num_steps)
            if said:
                bar.console.print(said, markup=False, highlight=False)

        yield Observer(on_step, on_record, on_policy_step, on_end, on_note)


def scalars(record: Record) -> dict[str, float]:
    """The numbers of an evaluation, by the names that curves have: `held_out/elbo`, ..., `beta`.

    >>> terms = Terms(policy=-3.0, state=1.0, stop=0.0, kl=0.5)
    >>> scalars(Record(100, 1.5, terms, terms))["held_out/elbo"]
    -2.5
    """
    numbers: dict[str, float] = {}
    for part, terms in (("training", record.training), ("held_out", record.held_out)):
        numbers |= {f"{part}/{field.name}": getattr(terms, field.name) for field in fields(terms)}
        numbers[f"{part}/elbo"] = terms.value(1.0)
    return {**numbers, "beta": record.beta}


def together(observers: Sequence[Observer]) -> Observer:
    """One observer that tells all of them, in order.

    >>> told = []
    >>> both = together([Observer(on_step=lambda step, terms: told.append(step))] * 2)
    >>> both.on_step(7, Terms(0.0, 0.0, 0.0, 0.0))
    >>> told
    [7, 7]
    """

    def on_step(step: int, terms: Terms) -> None:
        for observer in observers:
            observer.on_step(step, terms)

    def on_record(record: Record) -> None:
        for observer in observers:
            observer.on_record(record)

    def on_policy_step(step: int, nats: float) -> None:
        for observer in observers:
            observer.on_policy_step(step, nats)

    def on_note(note: str) -> None:
        for observer in observers:
            observer.on_note(note)

    def on_end(progress: checkpoint.Progress) -> None:
        for observer in observers:
            observer.on_end(progress)

    return Observer(on_step, on_record, on_policy_step, on_end, on_note)


@contextmanager
def counting(description: str, total: int, console: Console) -> Iterator[Callable[[int], None]]:
    """A bar that counts to `total`; call what it gives with the number done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)
