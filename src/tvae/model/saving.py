"""A model as files: saved, loaded, found by its name, published."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from tvae.errors import ModelError
from tvae.files import appearing
from tvae.hub import CARD, upload
from tvae.model.schema import read_description
from tvae.pretrained import pretrained_directory
from tvae.spaces import Space

M = TypeVar("M", bound="Saved")


class Saved(nn.Module, ABC):
    """A module that is made of two spaces and plain arguments, and can be made again from its description.

    `config.json` holds the description, `model.safetensors` the weights; nothing in either is executed.
    """

    @abstractmethod
    def description(self) -> dict[str, Any]:
        """All but the weights, as plain data: format, schema version, spaces, constructor arguments."""

    def save(self, directory: str | Path) -> None:
        """Write `model.safetensors` and `config.json` into `directory`; each appears only when whole."""
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        with appearing(directory / "config.json", overwrite=True) as partial:
            partial.write_text(json.dumps(self.description(), indent=2), encoding="utf-8")
            self.save_weights(directory / "model.safetensors")

    def save_weights(self, path: Path) -> None:
        """Write the weights as safetensors, whole or not at all."""
        write_tensors(path, {name: tensor.contiguous() for name, tensor in self.state_dict().items()})

    @classmethod
    def load(cls: type[M], directory: str | Path) -> M:
        """The model that `save` or a run wrote. Nothing in the directory is executed.

        Raises `ModelError` for a directory that is no model, is truncated, or has another schema version.
        """
        directory = Path(directory)
        description = read_description(directory)
        try:
            model = cls(
                Space.from_json(description["observation_space"]),
                Space.from_json(description["action_space"]),
                **description["arguments"],
            )
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise ModelError(f"{directory / 'config.json'} does not describe a model: {error}") from error
        try:
            model.load_state_dict(load_file(directory / "model.safetensors"))
        except (SafetensorError, OSError) as error:
            raise ModelError(f"{directory / 'model.safetensors'} is missing or truncated: {error}") from error
        except RuntimeError as error:
            raise ModelError(f"{directory / 'model.safetensors'} holds another model's weights: {error}") from error
        model.eval()
        return model

    @classmethod
    def from_pretrained(cls: type[M], name: str | Path, *, revision: str | None = None) -> M:
        """A model that comes with the package, lies in a directory, or in a repository `owner/name` of the Hub.

        They are looked for in this order (`tvae.pretrained.pretrained_directory`) and read as `load` does; a repository
        at its newest commit, or at `revision`, a branch, tag or commit. The styles are
        `tvae.Playstyles.from_pretrained(name)`. Raises `ModelError` for a name of nothing; the message says which names
        there are.

        >>> from tempfile import mkdtemp
        >>> from tvae.model.tvae import TrajectoryVAE
        >>> from tvae.spaces import Continuous, Space
        >>> directory = mkdtemp()
        >>> TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)), latent_features=3).save(directory)
        >>> TrajectoryVAE.from_pretrained(directory).latent_features
        3
        """
        return cls.load(pretrained_directory(name, revision))

    def push_to_hub(self, repo_id: str, *, card: str | None = None, private: bool = False) -> str:
        """Write the model to the repository `owner/name` of the Hugging Face Hub, and return its address.

        `card` becomes its README.md; without one, a card that is there stays. `tvae push` writes a whole run, with its
        styles and a card. The repository is made if there is none. Raises `HubError` (`tvae.hub`).

        >>> from tvae.model.tvae import TrajectoryVAE
        >>> from tvae.spaces import Continuous, Space
        >>> walks = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)))
        >>> walks.push_to_hub("walks")
        Traceback (most recent call last):
        tvae.hub.HubError: a repository is called owner/name, got 'walks'
        """
        with TemporaryDirectory() as directory:
            self.save(directory)
            if card is not None:
                (Path(directory) / CARD).write_text(card, encoding="utf-8")
            return upload(Path(directory), repo_id, private=private, message="A Trajectory VAE")


def write_tensors(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str] | None = None) -> None:
    """Write a safetensors file, whole or not at all; an older one is replaced.

    Raises `OSError` where it cannot be written, as on a full disk.
    """
    with appearing(path, overwrite=True) as partial:
        try:
            save_file(dict(tensors), partial, None if metadata is None else dict(metadata))
        except SafetensorError as error:
            raise OSError(f"{path} cannot be written: {error}") from error
