"""The command line as tests call it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tvae.cli import main


def call(*arguments: str | Path) -> None:
    """Run a command in this process."""
    main([str(argument) for argument in arguments])


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """What the command says when it refuses, on one line."""
    with pytest.raises(SystemExit) as stopped:
        call(*arguments)
    assert stopped.value.code == 2
    return capsys.readouterr().err
