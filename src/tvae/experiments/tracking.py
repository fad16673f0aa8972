"""Services that follow experiments, beside TensorBoard: Trackio and Weights & Biases.

Both are extras, and both have the calls `init(project, name, config)`, `run.log(numbers, step)` and `run.finish()`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tvae.errors import TvaeError
from tvae.experiments.progress import scalars
from tvae.train.checkpoint import Record
from tvae.train.observer import Observer


class TrackerError(TvaeError):
    """A service that cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class Tracker:
    """A project of a service; made by `trackio` or `wandb`."""

    package: str
    project: str

    def __post_init__(self) -> None:
        try:
            import_module(self.package)
        except ImportError as error:
            raise TrackerError(
                f"--{self.package} needs an extra: pip install 'tvae[{self.package}]' ({error})"
            ) from error

    @contextmanager
    def watching(self, name: str, config: Mapping[str, Any]) -> Iterator[Observer]:
        """An observer that logs each evaluation of a training as a run called `name` with this configuration.

        Raises `TrackerError` where the service does not begin a run, such as without a login.
        """
        service = import_module(self.package)
        try:
            run = service.init(project=self.project, name=name, config=dict(config))
        except (OSError, getattr(service, "Error", OSError)) as error:
            raise TrackerError(
                f"--{self.package} cannot begin a run: {error} (tvae fit --resume goes on without it)"
            ) from error

        def on_record(record: Record) -> None:
            run.log(scalars(record), step=record.step)

        try:
            yield Observer(on_record=on_record)
        finally:
            run.finish()


def trackio(project: str) -> Tracker:
    """A project of Trackio, which keeps its runs on this machine; `TrackerError` without the extra `trackio`."""
    return Tracker("trackio", project)


def wandb(project: str) -> Tracker:
    """A project of Weights & Biases; `TrackerError` without the extra `wandb`."""
    return Tracker("wandb", project)
