"""Which methods play which tasks, and why not."""

from __future__ import annotations

from collections.abc import Sequence

from tvae.experiments.benchmark.methods import METHODS, Need
from tvae.experiments.benchmark.tasks import TASKS

_SAID = {Need.DEMONSTRATORS: "demonstrators that can be asked", Need.NUMBER: "a number of styles"}


def obstacle(method: str, task: str) -> str | None:
    """Why a method cannot play a task; None where it can.

    >>> obstacle("dagger", "pusht"), obstacle("walk", "circle"), obstacle("flow", "pusht")
    ('needs labels, demonstrators that can be asked', 'is made for zombie', None)
    """
    entry, found = METHODS[method], TASKS[task]
    if task not in entry.tasks:
        return f"is made for {', '.join(entry.tasks)}"
    absent = set() if found.world.demonstrators else {Need.DEMONSTRATORS}
    if not found.labels:
        absent |= {Need.LABELS, Need.NUMBER}
    lacking = [_SAID.get(need, need.value) for need in entry.needs if need in absent]
    return f"needs {', '.join(lacking)}" if lacking else None


def left_out(methods: Sequence[str], tasks: Sequence[str]) -> list[str]:
    """A sentence for each method and reason.

    >>> left_out(["demonstrators", "flow"], ["zombie", "pusht", "overcooked"])
    ['left out: demonstrators in pusht, overcooked (needs demonstrators that can be asked)']
    """
    reasons: dict[tuple[str, str], list[str]] = {}
    for method in methods:
        for task in tasks:
            reason = obstacle(method, task)
            if reason is not None:
                reasons.setdefault((method, reason), []).append(task)
    return [f"left out: {method} in {', '.join(where)} ({why})" for (method, why), where in reasons.items()]
