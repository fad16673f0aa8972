"""What is measured of a method's bots, the same for all methods.

Bots *at will* are not told which style to show. With p_k the share of their episodes that show style k, q_k the same
among the demonstrations, and n_k the number of their episodes that show style k and succeed in it:

| number            | formula                                                                                    |
|-------------------|--------------------------------------------------------------------------------------------|
| `at_will.success` | share of episodes that succeed in the style that they show                                 |
| `frequency`       | p_k                                                                                        |
| `calibration`     | 1/2 sum_k abs(p_k - q_k), the total variation distance: 0 is best                          |
| `coverage`        | - sum_k r_k log_K r_k, r_k = n_k / sum n, the behaviour entropy of D3IL: 1 is best         |
| `modes_recovered` | number of styles with n_k at least 1 in 20 episodes                                        |
| `trajectory_fit`  | mean over statistics of W1(bots, held-out demonstrations) / std of both together: 0 is best |
| `ms_per_action`   | mean processor time of one action, one episode at a time, ms; planning ahead is shared out |

Bots that are *asked* for a style: `success.STYLE` is the share of their episodes that succeed in it, and
`controllability.STYLE` the share that shows it. A method that cannot be asked acts at will whatever one asks for, and
these are the shares of its episodes at will: of K styles, they add up to 1 at most. `asked` says which it was, 1 or 0.
The task's further numbers are of the episodes that were asked for a style, or else of those at will that show it; where
there is none, there is no number. `worst_...` is over styles, and only there where each of them has a number.

Where styles have no names there is of all this only success at will, the task's further numbers of episodes at will
(`at_will.NAME`), the fit and the time of an action; people who are measured in their recordings take no time.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from tvae.baselines.contract import Bots
from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.paths import earth_mover
from tvae.evaluate.statistics import EpisodeStatistics
from tvae.experiments.benchmark.people import Recorded
from tvae.experiments.benchmark.task import Task
from tvae.experiments.reproduction.subject import WORLDS
from tvae.rollouts import Policy, rollout
from tvae.spaces import FloatArray, IntArray

MEASURES = 1
"""Raised when a number comes to mean something else: cells of before are then not mixed with those of after."""
_LEFT_OUT = (".net turn", ".positive")
"""Statistics that are not part of the fit: they are younger than most of the cells that are stored."""
_MOST_COPIES = 1000
_RECOVERED = 1 / 20
_TIMED, _WARMING = 200, 20
_WORST = {
    "success": min,
    "controllability": min,
    "radial_error": max,
    "turn_completed": min,
    "end_distance": max,
    "soups": min,
}


def measure(bots: Bots, task: Task, test: Demonstrations, *, episodes: int, seed: int) -> dict[str, Any]:
    """All numbers of the table above; worlds depend on `seed` alone, so that all methods meet the same ones."""
    will = play(bots.at_will, task, episodes, seed)
    shown = task.shown(will)
    own = task.succeeded(will)[np.arange(len(will)), shown]
    return {
        **(_asked(bots, task, will, episodes, seed) if task.labels else {}),
        "at_will": {"success": float(own.mean()), **task.overall(will)},
        **(_variety(task, shown, shown[own], task.shown(test)) if task.labels else {}),
        "trajectory_fit": trajectory_fit(task.as_demonstrated(will, test), test),
        **({} if isinstance(bots.at_will, Recorded) else {"ms_per_action": milliseconds(bots.at_will, test)}),
    }


def _asked(bots: Bots, task: Task, will: Demonstrations, episodes: int, seed: int) -> dict[str, Any]:
    """What comes of asking for each style; `will` are the episodes of whom one cannot ask."""
    found: dict[str, Any] = {"asked": int(bool(bots.by_style))}
    for index, label in enumerate(task.labels):
        asked = play(bots.by_style[label], task, episodes, seed) if bots.by_style else will
        shows = task.shown(asked) == index
        _put(found, "controllability", label, float(shows.mean()))
        _put(found, "success", label, float(task.succeeded(asked)[:, index].mean()))
        theirs = asked if bots.by_style else will.select(np.flatnonzero(shows))
        for name, value in (task.numbers(theirs, label) if len(theirs) else {}).items():
            _put(found, name, label, value)
    for name, worst in _WORST.items():
        if set(found.get(name, ())) == set(task.labels):
            found[f"worst_{name}"] = worst(found[name].values())
    return found


def _variety(task: Task, shown: IntArray, succeeded_in: IntArray, demonstrated: IntArray) -> dict[str, Any]:
    """How styles are spread: those shown in episodes at will, those of them that succeeded, those held out."""
    count = len(task.labels)
    frequency = np.bincount(shown, minlength=count) / len(shown)
    wanted = np.bincount(demonstrated, minlength=count) / len(demonstrated)
    successes = np.bincount(succeeded_in, minlength=count)
    return {
        "frequency": dict(zip(task.labels, frequency.tolist(), strict=True)),
        "calibration": float(0.5 * np.abs(frequency - wanted).sum()),
        "coverage": entropy(successes.astype(np.float64)),
        "modes_recovered": int((successes / len(shown) >= _RECOVERED).sum()),
    }


def _put(found: dict[str, Any], name: str, label: str, value: float) -> None:
    found.setdefault(name, {})[label] = value


def play(policy: Policy, task: Task, episodes: int, seed: int) -> Demonstrations:
    """Fresh episodes of a policy, in the worlds of this seed; of people, their recordings."""
    if isinstance(policy, Recorded):
        return policy.episodes
    envs = task.envs(min(_MOST_COPIES, episodes))
    try:
        return rollout(envs, policy, episodes, seed=WORLDS + seed)
    finally:
        envs.close()


def entropy(counts: FloatArray) -> float:
    """- sum_k r_k log_K r_k of the shares r of K counts; 0 where nothing was counted.

    >>> entropy(np.array([5.0, 5.0])), entropy(np.array([7.0, 0.0])), entropy(np.zeros(2))
    (1.0, 0.0, 0.0)
    """
    if counts.sum() == 0:
        return 0.0
    shares = counts[counts > 0] / counts.sum()
    return max(0.0, float(-(shares * np.log(shares)).sum() / np.log(len(counts))))


def trajectory_fit(episodes: Demonstrations, demonstrations: Demonstrations) -> float:
    """Mean over statistics (`tvae.evaluate.statistics`) of W1 / std; outcomes and sides of directions are left out.

    std is that of the equal mixture of both sets, so that each distance is at most 2, and a statistic that hardly
    differs among demonstrations cannot drown the others. One that is constant in both sets fits.
    """
    theirs, wanted = EpisodeStatistics.of(episodes), EpisodeStatistics.of(demonstrations)
    distances = []
    for statistic in wanted.statistics:
        if statistic.is_outcome or statistic.name.endswith(_LEFT_OUT) or statistic.name not in theirs.names:
            continue
        did, told = theirs[statistic.name], wanted[statistic.name]
        std = float(np.sqrt((did.var() + told.var()) / 2 + (did.mean() - told.mean()) ** 2 / 4))
        distances.append(earth_mover(did, told) / std if std > 1e-9 * max(1.0, float(np.abs(told).max())) else 0.0)
    return float(np.mean(distances))


def milliseconds(policy: Policy, test: Demonstrations) -> float:
    """Mean processor time of `act` in one episode at a time, on observations of the test demonstrations, in order."""
    seconds: list[float] = []
    index = 0
    while len(seconds) < _TIMED + _WARMING:
        policy.reset(1, index)
        for row in test[index % len(test)].observations:
            began = time.process_time()
            policy.act(row[None])
            seconds.append(time.process_time() - began)
        index += 1
    return 1000 * float(np.mean(seconds[_WARMING:]))


def flat(found: Mapping[str, Any], path: str = "") -> dict[str, float]:
    """Every number of nested measures, by its dotted name.

    >>> flat({"success": {"attack": 1.0}, "asked": 1, "note": "x"})
    {'success.attack': 1.0, 'asked': 1.0}
    """
    numbers: dict[str, float] = {}
    for name, value in found.items():
        if isinstance(value, Mapping):
            numbers |= flat(value, f"{path}{name}.")
        elif isinstance(value, int | float):
            numbers[f"{path}{name}"] = float(value)
    return numbers
