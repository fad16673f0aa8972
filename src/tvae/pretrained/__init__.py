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

ROOT = Path(str(files("tvae.pretrained")))


def pretrained_names() -> tuple[str, ...]:
    """The names of the shipped models, in order.

    >>> "chess" in pretrained_names()
    False
    """
    return tuple(sorted(path.parent.name for path in ROOT.glob("*/config.json")))


def pretrained_directory(name: str | Path) -> Path:
    """Where the files of a model are: the shipped one of this name, else the directory of this path.

    A shipped name means the shipped model wherever the program runs; a directory of the same name is `./name`.
    Raises `ModelError` for what is neither.

    >>> from tempfile import mkdtemp
    >>> directory = mkdtemp()
    >>> pretrained_directory(directory) == Path(directory)
    True
    """
    names = pretrained_names()
    if name in names:
        return ROOT / name
    if not Path(name).is_dir():
        raise ModelError(
            f"there is no model {str(name)!r}: it is no directory, and the models that come with tvae are "
            f"{', '.join(names) or 'none'}"
        )
    return Path(name)
