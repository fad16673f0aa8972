"""The two tasks with real people as a benchmark sees them. Their simulators are extras, loaded when they are used.

| task       | an episode shows                                                     | it succeeds in a style        |
|------------|----------------------------------------------------------------------|-------------------------------|
| pusht      | no style that has a name                                             | coverage of the goal above 0.95 |
| overcooked | `clockwise` or `counter-clockwise`: at least 1 net lap in 100 steps; else `none` | it shows the style |

Seed k of PushT holds out 31 of the 206 demonstrations, drawn with k. Nobody has named what they differ in: which way
the block is turned follows from where it lies at first (in 98 % the shorter way), and how far the disc goes round it
spreads from one lap to the other without a gap. The state behind the last action of a demonstration was not recorded,
so that this action is left out; its outcomes are those of a replay of all its actions.

Seed k of Overcooked holds out 4 of the 16 pairs in the ring, drawn with k, but never pair 19: it alone goes round
counter-clockwise, and without it nobody could be asked for that. What is learnt from are the segments of `tvae demo
overcooked`, with the style that they show as their label; those held out do not overlap. Whoever judges itself by a
part of what it learns from holds back whole groups: pairs, among which pair 19 is dealt out, so that it is never lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tvae.baselines.contract import Envs, World
from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.data.segments import segment
from tvae.data.trajectory import Trajectory
from tvae.errors import TvaeError
from tvae.experiments.arenas import column_per_episode
from tvae.experiments.benchmark.task import Task
from tvae.experiments.tasks import (
    OVERCOOKED_CONFIG,
    OVERCOOKED_DATA,
    PUSHT_DATA,
    recordings,
    simulated,
)
from tvae.spaces import FloatArray, IntArray

RING = "coordination_ring"
ALONE = "19"
"""The only pair that goes round counter-clockwise."""
_HELD_OUT, _COVERED = 0.15, 0.95
_HELD_OUT_PAIRS = 4
_GAME, _SEGMENT, _STRIDE, _SHORTEST = 400, 200, 50, 100
_LAPS = 1 / 100
"""Net laps a step from which on a pair goes round."""
_LABELS = ("clockwise", "none", "counter-clockwise")
_OVERCOOKED_ENV = {"layout": RING, "horizon": _GAME}


def _nobody(label: str, count: int, seed: int) -> NoReturn:
    raise TvaeError("people cannot be asked what they would do; there are only their recordings")


def _world(env: str, **options: Any) -> World:
    def envs(count: int) -> Envs:
        return gymnasium.make_vec(env, num_envs=count, **options)

    return World(envs, {}, _nobody)


# PushT


@cache
def _pushes(path: Path) -> Demonstrations:
    """All demonstrations without their last actions; attributes `best_coverage` and `final_coverage`."""
    module = simulated("tvae.envs.pusht", "pusht")
    found: Demonstrations = module.pusht_demonstrations(path)
    env = module.PushTEnv()
    played = [module.replay(demonstration, env) for demonstration in found]
    return replace(
        found,
        lengths=found.lengths - 1,
        final_observed=np.ones(len(found), dtype=np.bool_),
        attributes={
            **found.attributes,
            "best_coverage": np.array([outcome.best_coverage for outcome in played]),
            "final_coverage": np.array([outcome.final_coverage for outcome in played]),
        },
    )


def _pusht_part(part: int) -> Callable[[Path, int], Demonstrations]:
    def found(data: Path, seed: int) -> Demonstrations:
        return _pushes(recordings(data / PUSHT_DATA.name)).split(_HELD_OUT, seed=seed)[part]

    return found


def _coverage(episodes: Demonstrations, which: str) -> FloatArray:
    """(E,) `best` or `final` coverage of each episode: of its replay where it was recorded."""
    if f"{which}_coverage" in episodes.attributes:
        known: FloatArray = episodes.attributes[f"{which}_coverage"]
        return known
    return column_per_episode(episodes, "info.coverage", np.max if which == "best" else lambda values: values[-1])


def _as_long_as_people(episodes: Demonstrations, test: Demonstrations) -> Demonstrations:
    """Whoever is still at it when time is up is cut to the length of one of the people held out, in turn."""
    if "truncated" not in episodes.steps:
        return episodes
    late = column_per_episode(episodes, "truncated", lambda values: values[-1]) > 0
    most = np.minimum(episodes.lengths, np.resize(test.lengths, len(episodes)))
    return Demonstrations.from_trajectories(
        (
            Trajectory(episode.observations[: steps + 1], episode.actions[:steps])
            for episode, steps in zip(episodes, np.where(late, most, episodes.lengths).tolist(), strict=True)
        ),
        episodes.observation_space,
        episodes.action_space,
    )


PUSHT = Task(
    env="tvae/PushT-v0",
    episodes=200,
    labels=(),
    world=_world("tvae/PushT-v0"),
    demonstrations=_pusht_part(0),
    test=_pusht_part(1),
    config=RunConfig(),
    shown=lambda episodes: np.zeros(len(episodes), dtype=np.int64),
    succeeded=lambda episodes: _coverage(episodes, "best")[:, None] > _COVERED,
    overall=lambda episodes: {
        "best_coverage": float(_coverage(episodes, "best").mean()),
        "final_coverage": float(_coverage(episodes, "final").mean()),
    },
    quality="at_will.best_coverage",
    as_demonstrated=_as_long_as_people,
)


# Overcooked


@cache
def _games(path: Path) -> Demonstrations:
    """All games in the ring, from both seats."""
    module = simulated("tvae.envs.overcooked", "overcooked")
    found: Demonstrations = module.with_seats_exchanged(module.overcooked_demonstrations(path, [RING]))
    return found


def held_out_pairs(pairs: list[str], seed: int) -> list[str]:
    """Four of these pairs, or half of them where there are few, drawn with the seed; `ALONE` is never among them.

    >>> held_out_pairs(["1", "2", "19"], 0)
    ['2']
    """
    others = sorted(set(pairs) - {ALONE}, key=int)
    count = min(_HELD_OUT_PAIRS, len(others) // 2)
    drawn: list[str] = np.random.default_rng(seed).choice(others, count, replace=False).tolist()
    return sorted(drawn, key=int)


def _of_pairs(data: Path, seed: int, *, held_out: bool) -> Demonstrations:
    games = _games(recordings(data / OVERCOOKED_DATA.name))
    pairs = games.attribute("pair").astype(str)
    theirs = np.isin(pairs, held_out_pairs(pairs.tolist(), seed))
    return games.select(np.flatnonzero(theirs == held_out))


def _segments(data: Path, seed: int) -> Demonstrations:
    games = _of_pairs(data, seed, held_out=False)
    segments = segment(games, _SEGMENT, stride=_STRIDE, minimum=_SHORTEST)
    groups = dealt_out(segments.attribute("pair").astype(str))
    return segments.with_attributes({"label": np.array(_LABELS)[_goes(segments)], "group": groups})


def dealt_out(pairs: NDArray[Any]) -> NDArray[Any]:
    """The pair of each segment, but those of `ALONE` in equal parts with each of the others.

    Whatever part of these groups a method holds back to judge itself by, most of `ALONE` is learnt from.

    >>> dealt_out(np.array(["3", "19", "19", "19", "19", "7"])).tolist()
    ['3', '3', '3', '7', '7', '7']
    """
    groups, others = pairs.copy(), np.unique(pairs[pairs != ALONE])
    for name, part in zip(others, np.array_split(np.flatnonzero(pairs == ALONE), len(others)), strict=True):
        groups[part] = name
    return groups


def _laps(episodes: Demonstrations) -> FloatArray:
    laps: FloatArray = simulated("tvae.envs.overcooked", "overcooked").net_laps(episodes)
    return laps


def _goes(episodes: Demonstrations) -> IntArray:
    """(E,) which of the labels each episode shows."""
    laps = _laps(episodes)
    return np.where(np.abs(laps) < _LAPS * episodes.lengths, 1, np.where(laps > 0, 0, 2)).astype(np.int64)


def _cooked(episodes: Demonstrations) -> dict[str, float]:
    """Soups delivered and net laps, in as many steps as a bot's game has."""
    soup: float = simulated("tvae.envs.overcooked", "overcooked").SOUP_REWARD
    soups = column_per_episode(episodes, "reward", np.sum).sum() / soup
    share = _GAME / episodes.num_steps
    return {"soups": float(soups * share), "laps": float(_laps(episodes).sum() * share)}


def _in_segments(episodes: Demonstrations, test: Demonstrations) -> Demonstrations:
    return segment(replace(episodes, attributes={}), _SEGMENT, minimum=_SHORTEST)


OVERCOOKED = Task(
    env="tvae/Overcooked-v0",
    options=_OVERCOOKED_ENV,
    episodes=100,
    labels=_LABELS,
    world=_world("tvae/Overcooked-v0", **_OVERCOOKED_ENV),
    demonstrations=_segments,
    test=lambda data, seed: segment(_of_pairs(data, seed, held_out=True), _SEGMENT, minimum=_SHORTEST),
    config=replace(OVERCOOKED_CONFIG, group="group"),
    shown=_goes,
    succeeded=lambda episodes: np.eye(len(_LABELS), dtype=np.bool_)[_goes(episodes)],
    numbers=lambda episodes, label: _cooked(episodes),
    overall=_cooked,
    quality="at_will.soups",
    as_demonstrated=_in_segments,
    apart=lambda segments: segments.select(np.flatnonzero(segments.attribute("segment") % (_SEGMENT // _STRIDE) == 0)),
)
