"""Bots at work: test episodes of each style in an environment, z drawn afresh for each episode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from rich.console import Console
from scipy.stats import binomtest

from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import save_demonstrations
from tvae.errors import TvaeError
from tvae.evaluate.keeping import style_consistency
from tvae.evaluate.likelihood import mean_interval
from tvae.experiments.arenas import Arena, knowledge_of
from tvae.experiments.findings import Findings
from tvae.experiments.fitting import update_metrics
from tvae.experiments.parallel import is_parallel, opened, played
from tvae.experiments.progress import counting
from tvae.experiments.run_directory import RunDirectory
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import most_likely, sampled
from tvae.model.tvae import TrajectoryVAE
from tvae.rollouts import Policy, check_spaces, rollout
from tvae.spaces import Space

_MOST_COPIES = 1000
_COPIES_OF_SLOW_ENVIRONMENTS = 20


def vector_env(arena: Arena) -> VectorEnv[Any, Any, Any]:
    """Copies of an environment: a thousand where it steps them together, else a handful one after another.

    Raises `TvaeError` where a module before the colon is not there.
    """
    module, _, name = arena.env.rpartition(":")
    if module:
        try:
            import_module(module)
        except ModuleNotFoundError as error:
            raise TvaeError(f"the environment {arena.env} needs the module {module}: {error}") from error
    spec = gymnasium.spec(name)
    copies = _MOST_COPIES if spec.vector_entry_point is not None else _COPIES_OF_SLOW_ENVIRONMENTS
    return gymnasium.make_vec(name, num_envs=min(copies, arena.episodes), **arena.options)


def check_arena(arena: Arena, observation_space: Space, action_space: Space) -> None:
    """Raise `TvaeError` if the environment's signals are not supported, or are other ones than these."""
    if is_parallel(arena.env):
        with opened(arena, observation_space, action_space):
            return
    envs = vector_env(replace(arena, episodes=1))
    try:
        check_spaces(envs, observation_space, action_space)
    finally:
        envs.close()


def bot_episodes(
    model: TrajectoryVAE,
    bot: Callable[[], Policy],
    arena: Arena,
    *,
    seed: int,
    on_step: Callable[[int], None],
) -> Demonstrations:
    """Episodes of a bot of `model`; where there are several players, of each of them, with a bot of its own.

    Raises `SpaceMismatchError` if the environment has other signals than the model.
    """
    if is_parallel(arena.env):
        return played(arena, model.observation_space, model.action_space, bot, seed=seed, on_step=on_step)
    envs = vector_env(arena)
    try:
        check_spaces(envs, model.observation_space, model.action_space)
        return rollout(envs, bot(), arena.episodes, seed=seed, on_step=on_step)
    finally:
        envs.close()


def try_bots(
    run: RunDirectory,
    model: TrajectoryVAE,
    findings: Findings,
    arena: Arena,
    *,
    seed: int,
    console: Console,
) -> dict[str, Any]:
    """Play `arena.episodes` with the bot of each style, sampled and most likely actions; keep the former.

    Adds to `metrics.json` for each style, under its label or name: `success` and `success_most_likely` where the
    environment knows success, its measures, `episode_length` and `return`, each measure with a 95 % interval, and
    `style_consistency`, the share of its episodes that the encoder tells as its style. `test_environment` and
    `test_episodes` say where.
    """
    knowledge = knowledge_of(arena.env)
    found: dict[str, dict[str, Any]] = {}
    intervals: dict[str, dict[str, Any]] = {}
    for style in findings.playstyles.styles:
        name, shown = findings.key(style), findings.name(style)
        for choice, suffix in ((sampled, ""), (most_likely, "_most_likely")):
            with counting(f"{shown}: test episodes{suffix.replace('_', ' ')}", arena.episodes, console) as done:
                bot = partial(LatentPolicy, model, style, choice=choice)
                episodes = bot_episodes(model, bot, arena, seed=seed, on_step=done)
            outcomes = knowledge.success(episodes)
            reached = outcomes.get(name, outcomes.get("all"))
            if reached is not None:
                found.setdefault(f"success{suffix}", {})[name] = float(reached.mean())
                intervals.setdefault(f"success{suffix}", {})[name] = _wilson(float(reached.mean()), len(reached))
            if choice is most_likely:
                continue
            save_demonstrations(episodes, run.rollouts(style.index), overwrite=True)
            kept = style_consistency(model, findings.playstyles, style, episodes)
            found.setdefault("style_consistency", {})[name] = kept
            intervals.setdefault("style_consistency", {})[name] = _wilson(kept, len(episodes))
            returns = np.add.reduceat(episodes.steps["reward"], episodes.action_starts)
            measures = {**knowledge.measures(episodes), "episode_length": episodes.lengths, "return": returns}
            for measure, values in measures.items():
                found.setdefault(measure, {})[name] = float(np.mean(values))
                intervals.setdefault(measure, {})[name] = list(mean_interval(np.asarray(values, dtype=np.float64)))
    where = {"test_environment": arena.env, "test_episodes": arena.episodes}
    return update_metrics(run, {**found, "ci95": intervals, **where})


def _wilson(share: float, count: int) -> list[float]:
    """The 95 % interval of a share of `count` episodes."""
    interval = binomtest(round(share * count), count).proportion_ci(method="wilson")
    return [float(interval.low), float(interval.high)]
