"""Bring the numbers in README.md and docs/ up to date with results/: python scripts/fill_docs.py [--check].

A number stands between two comments, which say where it comes from and how it is written:

    <!--zombie success.avoid %-->99.5 % [98.8, 100.0]<!---->

`zombie` is results/zombie/metrics.json, `success.avoid` a path in it, and the format is `%` for a share, or a number of
decimals; `%m` and `2m` leave the interval out.
"""

import json
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TAGGED = re.compile(r"(<!--(\S+) (\S+) (%|\d)(m?)-->)[^<]*(<!---->)")


@cache
def results(name: str) -> Any:
    """`NAME/metrics.json`, or the file itself where a name ends with .json."""
    path = ROOT / "results" / (name if name.endswith(".json") else f"{name}/metrics.json")
    return json.loads(path.read_text(encoding="utf-8"))


def number(name: str, path: str) -> Any:
    """What stands at a path; a step of it may have a dot in its name, as `held_out.speed_0.4`."""
    found, steps = results(name), path.split(".")
    while steps:
        for length in range(1, len(steps) + 1):
            step = ".".join(steps[:length])
            if isinstance(found, list) or step in found:
                found, steps = found[int(step) if isinstance(found, list) else step], steps[length:]
                break
        else:
            raise KeyError(f"results/{name} has no {path}")
    return found


def written(found: Any, style: str, *, alone: bool) -> str:
    """A number, or a mean over seeds with its interval, in words."""
    scale, decimals, unit = (100, 1, " %") if style == "%" else (1, int(style), "")
    mean, interval = (found["mean"], found["ci95"]) if isinstance(found, dict) else (found, None)

    def said(value: float) -> str:
        return f"{scale * (min(value, 1.0) if style == '%' else value):.{decimals}f}"

    ends = "" if alone or interval is None else f" [{', '.join(map(said, interval))}]"
    return said(mean) + unit + ends


def filled(text: str) -> str:
    """A page with its numbers as they are now."""
    return TAGGED.sub(lambda m: m[1] + written(number(m[2], m[3]), m[4], alone=bool(m[5])) + m[6], text)


if __name__ == "__main__":
    stale = [page for page in PAGES if filled(page.read_text(encoding="utf-8")) != page.read_text(encoding="utf-8")]
    for page in stale:
        print(page.relative_to(ROOT), "has numbers that are not those of results/")
        if "--check" not in sys.argv:
            page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
    sys.exit(bool(stale) and "--check" in sys.argv)
