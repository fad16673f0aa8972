"""Everything that a killed training needs to go on as if nothing had happened, in one safetensors file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from tvae.errors import TvaeError
from tvae.model.saving import write_tensors
from tvae.train.terms import Terms

SCHEMA_VERSION = 3


class CheckpointError(TvaeError):
    """A checkpoint that cannot be used; the message says why."""


@dataclass(frozen=True)
class Record:
    """One evaluation: the terms on the training batches since the last one, and on held-out demonstrations."""

    step: int
    beta: float
    training: Terms
    held_out: Terms


@dataclass(frozen=True)
class Progress:
    """Where a training stands, its weights apart."""

    step: int
    beta: float
    last_kl: float
    best_step: int
    stale: int
    """Evaluations since the best one."""
    finished: bool
    records: tuple[Record, ...]

    @property
    def best(self) -> Record:
        """The evaluation whose weights are kept."""
        return next(record for record in self.records if record.step == self.best_step)


def copy_of_weights(model: nn.Module) -> dict[str, Tensor]:
    """The state of a module as it is now."""
    return {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}


def write_checkpoint(
    path: Path,
    *,
    settings: Mapping[str, object],
    progress: Progress,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    best: dict[str, Tensor],
) -> None:
    """Write to a temporary name beside `path`, then rename, so that a kill leaves the old file or the new one.

    `settings` are those of the training, kept as text; a resumed one must share them. Raises `OSError` where nothing
    can be written, as on a full disk.
    """
    tensors = {f"model.{name}": tensor for name, tensor in model.state_dict().items()}
    tensors |= {f"best.{name}": tensor for name, tensor in best.items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": tensor for name, tensor in state.items()}
    whole = {name: tensor.detach().contiguous().clone() for name, tensor in tensors.items()}
    metadata = {
        "format": "tvae-checkpoint",
        "version": str(SCHEMA_VERSION),
        "settings": json.dumps({name: str(value) for name, value in settings.items()}),
        "progress": json.dumps(asdict(progress)),
    }
    write_tensors(path, whole, metadata)


def read_checkpoint(
    path: Path, settings: Mapping[str, object], model: nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[Progress, dict[str, Tensor]]:
    """Restore `model` and `optimizer` in place; returns the progress and the best weights so far.

    Raises `CheckpointError` for a file that is no checkpoint of this version, or of another model or training.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - safe_open is no mapping
    except (SafetensorError, OSError) as error:
        raise CheckpointError(f"{path} is not a whole safetensors file: {error}") from error
    if metadata.get("format") != "tvae-checkpoint" or metadata.get("version") != str(SCHEMA_VERSION):
        raise CheckpointError(
            f"{path} needs format tvae-checkpoint, version {SCHEMA_VERSION}, "
            f"got {metadata.get('format')!r}, version {metadata.get('version')!r}"
        )
    theirs = json.loads(metadata["settings"])
    ours = {name: str(value) for name, value in settings.items()}
    differences = [
        f"{name} {theirs.get(name)} (now {ours.get(name)})"
        for name in dict.fromkeys([*ours, *theirs])
        if theirs.get(name) != ours.get(name)
    ]
    if differences:
        raise CheckpointError(
            f"{path} belongs to another training, with {', '.join(differences)}: "
            "continue with its settings, or choose another file"
        )
    parts: dict[str, dict[str, Tensor]] = {"model": {}, "best": {}, "optimizer": {}}
    for name, tensor in tensors.items():
        part, key = name.split(".", 1)
        parts[part][key] = tensor
    try:
        model.load_state_dict(parts["model"])
    except RuntimeError as error:
        raise CheckpointError(f"{path} belongs to another model: {error}") from error
    saved = optimizer.state_dict()
    saved["state"] = {}
    for name, tensor in parts["optimizer"].items():
        index, key = name.split(".", 1)
        saved["state"].setdefault(int(index), {})[key] = tensor
    optimizer.load_state_dict(saved)
    return _progress(json.loads(metadata["progress"])), parts["best"]


def _progress(data: dict[str, object]) -> Progress:
    records = data.pop("records")
    assert isinstance(records, list)
    return Progress(
        **data,  # type: ignore[arg-type]  # numbers and a flag, as `asdict` wrote them
        records=tuple(Record(r["step"], r["beta"], Terms(**r["training"]), Terms(**r["held_out"])) for r in records),
    )
