"""Files and directories that appear only when they are whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def appearing(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary name beside `path`; what is written under it takes the name `path` if all goes well.

    It may be a file or a directory. If the block raises, nothing is left behind and an older `path` stays.

    Raises `FileExistsError` where `path` exists and `overwrite` is False, also where another process made it in the
    meantime, and where it is a directory and a file should replace it, or the other way round: what lies in a directory
    is never lost to a file.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "numbers.txt"
    >>> with appearing(target) as partial:
    ...     _ = partial.write_text("1 2 3")
    >>> target.read_text(), partial.exists()
    ('1 2 3', False)
    """
    _check_absent(path, overwrite=overwrite)
    if not path.name:
        raise FileExistsError(f"{path} is a directory; a name in it is needed")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    _remove(partial)
    try:
        yield partial
        if partial.is_file():
            partial.chmod(_usual_mode())  # some writers make files that only their owner can read
        _check_absent(path, overwrite=overwrite)
        if path.exists() and path.is_dir() != partial.is_dir():
            kinds = ("a directory", "a file") if path.is_dir() else ("a file", "a directory")
            raise FileExistsError(f"{path} is {kinds[0]}, and {kinds[1]} cannot take its place; choose another name")
        if path.is_dir():
            older = path.with_name(f".{path.name}.{os.getpid()}.older")
            _remove(older)
            path.rename(older)
            partial.rename(path)
            _remove(older)
        else:
            partial.replace(path)
    finally:
        _remove(partial)


def _check_absent(path: Path, *, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already")


def _usual_mode() -> int:
    """Permissions of a new file, as the user's umask says."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
