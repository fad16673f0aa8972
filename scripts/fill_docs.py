"""Bring the numbers in README.md and docs/ up to date with results/: python scripts/fill_docs.py [--check].

A number stands between two comments, which say where it comes from and how it is written:

    <!--zombie success.avoid %-->99.5 % [98.8, 100.0]<!---->

`zombie` is results/zombie/metrics.json, `success.avoid` a path in it, and the format is `%` for a share, `p` for a
difference of shares in points, or a number of decimals; `%m` and `2m` leave the interval out. With --check nothing is
written. The exit code is 1 where a tag cannot be filled, and with --check where a number is not that of results/.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TAGGED = re.compile(r"(<!--(\S+) (\S+) (%|p|\d)(m?)-->)[^<]*(<!---->)")
LIKE_A_TAG = re.compile(r"<!--(?!-->)")


@cache
def results(name: str) -> Any:
    """`NAME/metrics.json`, or the file itself where a name ends with .json."""
    path = ROOT / "results" / (name if name.endswith(".json") else f"{name}/metrics.json")
    return json.loads(path.read_text(encoding="utf-8"))


def at(found: Any, path: str) -> Any:
    """What stands at a path; a step of it may have a dot in its name, as `held_out.speed_0.4`."""
    if isinstance(found, list):
        step, _, rest = path.partition(".")
        found, path = found[int(step)], rest
        return at(found, path) if path else found
    if isinstance(found, dict):
        for name in found:
            if path == name:
                return found[name]
            if path.startswith(f"{name}."):
                return at(found[name], path.removeprefix(f"{name}."))
    raise KeyError(path)


def written(found: Any, style: str, *, alone: bool) -> str:
    """A number, or a mean over seeds with its interval, in words."""
    scale, decimals, unit = {"%": (100, 1, " %"), "p": (100, 1, "")}.get(style) or (1, int(style), "")
    mean, interval = (found["mean"], found["ci95"]) if isinstance(found, dict) else (found, None)

    def said(value: float) -> str:
        within = min(max(value, 0.0), 1.0) if style == "%" else value
        return f"{round(scale * within, decimals) + 0.0:.{decimals}f}"

    ends = "" if alone or interval is None else f" [{', '.join(map(said, interval))}]"
    return said(mean) + unit + ends


def filled(text: str, failed: Callable[[str], None]) -> str:
    """A page with its numbers as they are now; `failed` hears of each tag that cannot be filled."""

    def fill(tag: re.Match[str]) -> str:
        try:
            return tag[1] + written(at(results(tag[2]), tag[3]), tag[4], alone=bool(tag[5])) + tag[6]
        except (OSError, KeyError, IndexError, TypeError, ValueError) as error:
            failed(f"{tag[1]}: {type(error).__name__}: {error}")
            return tag[0]

    if len(LIKE_A_TAG.findall(text)) != len(TAGGED.findall(text)):
        failed("a comment looks like a tag, and is none")
    return TAGGED.sub(fill, text)


def main(*, check: bool) -> int:
    """Fill or check all pages; returns the exit code."""
    code = 0
    for page in PAGES:
        before = page.read_text(encoding="utf-8")
        failures: list[str] = []
        after = filled(before, failures.append)
        for failure in failures:
            print(f"{page.name}: {failure}")
        if after != before:
            print(f"{page.name} has numbers that are not those of results/")
            if not check:
                page.write_text(after, encoding="utf-8")
        if failures or (check and after != before):
            code = 1
    return code


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing, and say where a number is another one")
    sys.exit(main(check=parser.parse_args().check))
