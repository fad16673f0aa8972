"""What README and docs show works: every Python block runs, every command is one that there is."""

from __future__ import annotations

import doctest
import importlib.util
import re
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import tvae
from tvae import cli
from tvae.cli import main
from tvae.experiments.benchmark.table import COLUMNS

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_blocks_run(page: Path) -> None:
    namespace: dict[str, object] = {}
    for block in blocks(page, "python"):
        exec(compile(block, page.name, "exec"), namespace)
    assert len(namespace) > 1 or not blocks(page, "python")


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "pycon")], ids=lambda page: page.name)
def test_what_python_says_is_what_it_says(page: Path) -> None:
    said: list[str] = []
    examples = doctest.DocTestParser().get_doctest("\n".join(blocks(page, "pycon")), {}, page.name, str(page), 0)
    found = doctest.DocTestRunner(verbose=False).run(examples, out=said.append)
    assert found.attempted > 0
    assert found.failed == 0, "".join(said)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = "\n".join(blocks(page, "")).splitlines()
    for line in lines:
        words = line.split("#")[0].split()
        if words[:1] != ["tvae"]:
            continue
        verb = words[1:3] if words[1] == "data" else words[1:2]
        main([*verb, "--help"])
        said = capsys.readouterr().out
        for option in (word for word in words if word.startswith("--")):
            assert option in said, f"{page.name}: {line}"


def test_every_command_has_its_example_on_the_page() -> None:
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for group, verb, told, example in cli._VERBS:
        name = f"tvae data {verb}" if group is not cli.app else f"tvae {verb}"
        assert f"## {name}\n\n{told}\n\n```\n{example}\n```\n" in page


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_notebook_runs_from_top_to_bottom() -> None:
    stored = nbformat.read(ROOT / "examples" / "playstyles.ipynb", as_version=4)
    again = deepcopy(stored)
    NotebookClient(again, timeout=300, kernel_name="python3").execute()

    def pictures(notebook: nbformat.NotebookNode) -> list[int]:
        return [
            len(output.data["image/png"])
            for cell in notebook.cells
            for output in cell.get("outputs", ())
            if "image/png" in output.get("data", {})
        ]

    assert len(pictures(again)) == len(pictures(stored)) == 3
    assert max(pictures(stored)) < 60_000
    assert not [cell.id for cell in again.cells for output in cell.get("outputs", ()) if output.get("name") == "stderr"]


def test_api_pages_have_all_public_names() -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    for name in tvae._HOMES:
        public = getattr(tvae, name)
        assert f".. automodule:: {public.__module__}\n" in pages, name
        assert f"<{public.__module__}.{name}>" in pages, name


def test_metrics_of_the_benchmark_are_explained() -> None:
    page = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    for task, columns in COLUMNS.items():
        for _, number, _ in columns:
            name = number if number.startswith("at_will.") else re.sub(r"\..*", ".STYLE", number)
            assert f"`{name}`" in page, f"{task}: {number}"


def test_numbers_are_those_of_the_results() -> None:
    checked = subprocess.run(
        [sys.executable, ROOT / "scripts" / "fill_docs.py", "--check"], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_numbers_are_found_and_written_as_their_tags_say() -> None:
    spec = importlib.util.spec_from_file_location("fill_docs", ROOT / "scripts" / "fill_docs.py")
    assert spec is not None
    assert spec.loader is not None
    fill_docs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fill_docs)
    found = {"held_out": {"speed_0.4": {"avoid": [0.5, 0.25]}}}
    assert fill_docs.at(found, "held_out.speed_0.4.avoid.1") == 0.25
    share = {"mean": 0.003, "ci95": [-0.01, 1.2]}
    assert fill_docs.written(share, "%", alone=False) == "0.3 % [0.0, 100.0]"
    assert fill_docs.written(share, "2", alone=True) == "0.00"
    assert fill_docs.written(-0.001, "2", alone=True) == "0.00"
    assert fill_docs.written({"mean": -0.04, "ci95": [-0.0812, 0.0012]}, "p", alone=False) == "-4.0 [-8.1, 0.1]"
    failures: list[str] = []
    page = "<!--nowhere a.b 2-->1<!----> <!--zombie success.nobody %-->2<!----> <!--mistyped-->3<!---->"
    assert fill_docs.filled(page, failures.append) == page
    assert len(failures) == 3
