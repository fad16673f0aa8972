"""The Hugging Face Hub, through the library `huggingface_hub` (extra `hub`).

Only the files below are ever read from a repository or written to one: JSON, safetensors and the card. Nothing that
comes from there is executed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from tvae.errors import ModelError

FILES = ("config.json", "model.safetensors", "playstyles.json")
CARD = "README.md"
TAGS = ("tvae", "imitation-learning", "variational-autoencoder", "playstyles")
_TASK = "reinforcement-learning"
"""The nearest of the tasks that the Hub knows."""
_REPOSITORY = re.compile(r"\w[\w.-]*/\w[\w.-]*", re.ASCII)


class HubError(ModelError):
    """What the Hub does not give or take; the message says why."""


@dataclass(frozen=True)
class Result:
    """A measured number, as the Hub lists it."""

    metric: str
    """Such as `success`."""
    name: str
    """For people, such as `success, attack`."""
    value: float
    data: str
    """What it was measured on."""


def is_repository(name: str) -> bool:
    """Whether it looks like the name of a repository.

    >>> is_repository("owner/name"), is_repository("name"), is_repository("../name"), is_repository("owner/name/file")
    (True, False, False, False)
    """
    return _REPOSITORY.fullmatch(name) is not None


def check_repository(repo_id: str) -> None:
    """Raise `HubError` for what cannot be the name of a repository."""
    if not is_repository(repo_id):
        raise HubError(f"a repository is called owner/name, got {repo_id!r}")


def download(repo_id: str, revision: str | None = None) -> Path:
    """A directory with the `FILES` that a repository has, from the cache where they are there already.

    `revision` is a branch, tag or commit; by default the newest commit. Raises `HubError`.
    """
    with _library(f"there is no directory {repo_id!r}, and it cannot be read from the Hugging Face Hub") as hub:
        return Path(hub.snapshot_download(repo_id, revision=revision, allow_patterns=list(FILES)))


def upload(directory: Path, repo_id: str, *, private: bool, message: str) -> str:
    """Write the `FILES` and the card of a directory to a repository; returns its address.

    The repository is made if there is none. Those of the `FILES` that the directory lacks are taken from it, so that
    no model stands beside another one's styles. Raises `HubError`, also for a public one that is asked to be private.
    """
    check_repository(repo_id)
    with _library(f"{repo_id} cannot be written to the Hugging Face Hub") as hub:
        api = hub.HfApi()
        address = str(api.create_repo(repo_id, private=private or None, exist_ok=True))
        is_private = bool(api.model_info(repo_id).private)
        if is_private or not private:
            api.upload_folder(
                repo_id=repo_id,
                folder_path=directory,
                commit_message=message,
                allow_patterns=[*FILES, CARD],
                delete_patterns=list(FILES),
            )
            return address
    raise HubError(f"{address} is public already; make it private there first, or choose another name")


def model_card(body: str, *, name: str, license: str | None, results: Sequence[Result] = ()) -> str:
    """A model card: the Hub's metadata as YAML, then `body` in Markdown. Raises `HubError` without the library.

    >>> print(model_card("# Walks", name="walks", license="mit"))
    ---
    library_name: tvae
    license: mit
    pipeline_tag: reinforcement-learning
    tags:
    - tvae
    - imitation-learning
    - variational-autoencoder
    - playstyles
    ---
    # Walks
    """
    with _library("a model card cannot be written") as hub:
        found = [
            hub.EvalResult(
                task_type=_TASK,
                task_name="imitation learning",
                dataset_type=result.data,
                dataset_name=result.data,
                metric_type=result.metric,
                metric_name=result.name,
                metric_value=result.value,
            )
            for result in results
        ]
        data = hub.ModelCardData(
            library_name="tvae",
            license=license,
            pipeline_tag=_TASK,
            tags=list(TAGS),
            model_name=name if found else None,
            eval_results=found or None,
        )
        return str(hub.ModelCard(f"---\n{data.to_yaml()}\n---\n{body}"))


@contextmanager
def _library(failure: str) -> Iterator[Any]:
    """The library; its errors, those of the network and its absence become `HubError`, which begins with `failure`."""
    try:
        hub = import_module("huggingface_hub")
        http_error = import_module("huggingface_hub.errors").HfHubHTTPError
    except ImportError:
        raise HubError(f"{failure} without the package huggingface_hub: pip install 'tvae[hub]'") from None
    try:
        yield hub
    except (*http_error.__bases__, ValueError) as error:  # all errors of its HTTP client, and OSError
        raise HubError(f"{failure}: {' '.join(str(error).split())}") from error
