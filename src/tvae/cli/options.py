"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter
from cyclopts.validators import Number
from rich.console import Console

from tvae.config import ModelConfig, PolicyConfig, TrainingConfig
from tvae.errors import TvaeError
from tvae.experiments.source import Reading
from tvae.model.decoding import Choice, Tempered, sampled
from tvae.model.decoding import most_likely as _most_likely

CONSOLE = Console()
MODEL = ModelConfig()
TRAINING = TrainingConfig()
POLICY = PolicyConfig()


Columns: TypeAlias = Annotated[Reading, Parameter(name="*", negative="")]
COLUMNS = Reading()

Out = Annotated[Path, Parameter(help="The run directory to make.")]
Run = Annotated[Path, Parameter(help="A run directory, as `tvae fit` made it.")]
RunOrModel = Annotated[
    str,
    Parameter(
        help="A run directory, a directory with a model, the name of a model that comes with tvae, "
        "or owner/name of one on the Hugging Face Hub."
    ),
]
Styles = Annotated[
    tuple[str, ...],
    Parameter(
        name="--style",
        negative="",
        show_default=" ".join,
        help="Number of the style, its name, or its label where the data had labels. "
        "Given several times: each episode is of one of them, drawn by their shares.",
    ),
]
Count = Annotated[int, Parameter(validator=Number(gte=1))]
Seed = Annotated[int, Parameter(help="Everything random depends on it.", validator=Number(gte=0, lt=2**32))]
Device = Annotated[str, Parameter(help="auto, cpu, cuda, cuda:N or mps.")]
Force = Annotated[bool, Parameter(help="Replace what is there already.", negative="")]
Flag = Annotated[bool, Parameter(negative="")]


def choice_of(*, most_likely: bool, temperature: float | None) -> Choice:
    """How actions and states are chosen; `TvaeError` for both, or for a temperature that is not positive."""
    if temperature is None:
        return _most_likely if most_likely else sampled
    if most_likely:
        raise TvaeError(f"--most-likely draws nothing, so that --temperature {temperature:g} has nothing to do")
    try:
        return Tempered(temperature)
    except ValueError as error:
        raise TvaeError(f"--temperature: {error}") from error
