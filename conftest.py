"""What tests and the examples of docstrings and pages write without saying where goes where pytest keeps such files."""

import tempfile
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="session")
def _temporary_files(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        directory = str(tmp_path_factory.mktemp("temporary"))
        patch.setattr(tempfile, "tempdir", directory)
        patch.setenv("TMPDIR", directory)  # of other processes
        yield
