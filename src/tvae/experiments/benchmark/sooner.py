"""How soon a method is nearly as good as in the end.

Rates fall towards the end of a training, so that a training cut short is worse than a short one. Each method therefore
learns anew with an eighth, a quarter and half of its gradient steps, and its bots are measured as always:

    q_p = quality with one in p of the steps, p = 8, 4, 2, 1
    enough is 1 / p*, p* the largest p with q_p' >= 0.9 q_1 for p' = 1 .. p

Quality is the worst success over styles, and of a method that cannot be asked for one the number that its task names.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tvae.experiments.benchmark.measures import flat
from tvae.experiments.benchmark.tasks import TASKS

PARTS = (2, 4, 8)
"""Of its gradient steps a method takes one in so many."""
NEARLY = 0.9


def sooner(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """`quality` and `train_seconds` by share of the steps; `share_to_most` and `train_seconds_to_most` of the shortest
    training that is enough. Nothing where there are no shorter trainings, and not the last two where the quality is 0,
    which is reached at once.

    >>> def cell(one_in, success, seconds):
    ...     asked = {"task": "zombie", "one_in": one_in}
    ...     return {"cell": asked, "asked": 1, "worst_success": success, "train_seconds": seconds}
    >>> shorter = [cell(2, 0.97, 40.0), cell(4, 0.9, 20.0), cell(8, 0.3, 10.0)]
    >>> found = sooner({**cell(1, 0.98, 80.0), "shorter": shorter})
    >>> found["quality"], found["share_to_most"], found["train_seconds_to_most"]
    ({'1': 0.98, '1/2': 0.97, '1/4': 0.9, '1/8': 0.3}, 0.25, 20.0)
    >>> sooner(cell(1, 0.98, 80.0))
    {}
    """
    if not numbers.get("shorter"):
        return {}
    by_part = {int(cell["cell"].get("one_in", 1)): cell for cell in (numbers, *numbers["shorter"])}
    quality = {part: _quality(cell) for part, cell in sorted(by_part.items())}
    seconds = {part: float(by_part[part]["train_seconds"]) for part in quality}
    found: dict[str, Any] = {
        "quality": {_share(part): value for part, value in quality.items()},
        "train_seconds": {_share(part): value for part, value in seconds.items()},
    }
    if quality[1] > 0:
        enough = 1
        for part, value in quality.items():
            if value < NEARLY * quality[1]:
                break
            enough = part
        found |= {"share_to_most": 1 / enough, "train_seconds_to_most": seconds[enough]}
    return found


def _quality(numbers: Mapping[str, Any]) -> float:
    found = flat(numbers)
    return found["worst_success" if found.get("asked") else TASKS[numbers["cell"]["task"]].quality]


def _share(part: int) -> str:
    return "1" if part == 1 else f"1/{part}"
