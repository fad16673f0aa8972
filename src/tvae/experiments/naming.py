"""Names that a user gives to the styles of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tvae.errors import TvaeError
from tvae.experiments.findings import Findings
from tvae.experiments.run_directory import read_json, write_json
from tvae.experiments.using import FinishedRun


def names_in(given: Sequence[str], findings: Findings) -> dict[int, str]:
    """Names by the number of their style, from such as `0=campers`; `TvaeError` for what is not so.

    The style may also be told by the name that it has.
    """
    names: dict[int, str] = {}
    for one in given:
        style, equals, name = one.partition("=")
        if not equals:
            raise TvaeError(f"--rename needs STYLE=NAME, such as 0=campers, got {one!r}")
        index = findings.style(style.strip()).index
        if index in names:
            raise TvaeError(f"--rename names style {index} twice: {names[index]!r} and {name.strip()!r}")
        names[index] = name.strip()
    return names


def rename(run: FinishedRun, given: Sequence[str]) -> FinishedRun:
    """The run with names of its styles, written to its `playstyles.json`, whole or not at all; see `names_in`."""
    findings = run.findings.renamed(names_in(given, run.findings))
    kept = read_json(run.directory.playstyles)
    write_json(run.directory.playstyles, kept | {"names": findings.to_json()["names"]})
    return replace(run, findings=findings)
