"""The models that come with the package, a directory each.

| file                | what                                                         |
|---------------------|--------------------------------------------------------------|
| `config.json`       | the model but for its weights                                |
| `model.safetensors` | its weights                                                  |
| `playstyles.json`   | the styles that were found with it, their labels and words   |
| `README.md`         | the model card: data, training, what it is for, measurements |
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from tvae.errors import ModelError
from tvae.hub import download, is_repository

ROOT = Path(str(files("tvae.pretrained")))


def pretrained_names() -> tuple[str, ...]:
    """The names of the shipped models, in order.

    >>> "chess" in pretrained_names()
    False
    """
    return tuple(sorted(path.parent.name for path in ROOT.glob("*/config.json")))


def pretrained_directory(name: str | Path, revision: str | None = None) -> Path:
    """Where the files of a model are: the shipped one, else the directory, else the repository of the Hub of this name.

    A shipped name means the shipped model wherever the program runs; a directory of the same name is `./name`. What is
    called `owner/name` and is no directory is read from the Hugging Face Hub (`tvae.hub.download`), at `revision`; a
    `Path` never is. Raises `ModelError` for what is none of them, and for a revision of what is no repository.

    >>> from tempfile import mkdtemp
    >>> directory = mkdtemp()
    >>> pretrained_directory(directory) == Path(directory)
    True
    """
    names = pretrained_names()
    here = ROOT / name if name in names else Path(name)
    if here.is_dir():
        if revision is not None:
            raise ModelError(f"only a repository of the Hugging Face Hub has revisions, and {str(name)!r} is {here}")
        return here
    if isinstance(name, str) and is_repository(name):
        return download(name, revision)
    raise ModelError(
        f"there is no model {str(name)!r}: it is no directory and no repository owner/name, and the models that come "
        f"with tvae are {', '.join(names) or 'none'}"
    )
