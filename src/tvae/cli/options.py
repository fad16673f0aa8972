"""Options that several verbs share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from tvae.config import ModelConfig, TrainingConfig
from tvae.experiments.source import Source
from tvae.model.decoding import Choice, sampled
from tvae.model.decoding import most_likely as _most_likely

CONSOLE = Console()
MODEL = ModelConfig()
TRAINING = TrainingConfig()


@Parameter(name="*")
@dataclass(frozen=True)
class Columns:
    """How a table is read."""

    angular: Annotated[tuple[str, ...], Parameter(negative="")] = ()
    """Column that is an angle in radians, such as observation.heading; may be repeated."""
    continuous: Annotated[tuple[str, ...], Parameter(negative="")] = ()
    """Column that is a number; may be repeated."""
    categorical: Annotated[tuple[str, ...], Parameter(negative="")] = ()
    """Column that is a category; may be repeated."""
    segment: int | None = None
    """Cut recordings into segments of at most so many steps."""

    def of(self, path: str) -> Source:
        """The source that is read this way."""
        return Source(path, self.angular, self.continuous, self.categorical, self.segment)


COLUMNS = Columns()

Out = Annotated[Path, Parameter(help="The run directory to make.")]
Run = Annotated[Path, Parameter(help="A run directory, as `tvae fit` made it.")]
RunOrModel = Annotated[
    str,
    Parameter(
        help="A run directory, a directory with a model, the name of a model that comes with tvae, "
        "or owner/name of one on the Hugging Face Hub."
    ),
]
Seed = Annotated[int, Parameter(help="Everything random depends on it.")]
Device = Annotated[str, Parameter(help="auto, cpu, cuda, cuda:N or mps.")]
Force = Annotated[bool, Parameter(help="Replace what is there already.", negative="")]
Flag = Annotated[bool, Parameter(negative="")]


def choice_of(*, most_likely: bool) -> Choice:
    """How actions and states are chosen."""
    return _most_likely if most_likely else sampled
