"""Parallel environments of PettingZoo by their import path: every player is a bot of the same style.

| `--env`                     | the environment                                                         |
|-----------------------------|-------------------------------------------------------------------------|
| `mpe2:simple_spread_v3`     | `parallel_env()` of the module `mpe2.simple_spread_v3`, as PettingZoo's |
| `my_game:Arena`             | what the class or function `Arena` of the module `my_game` gives        |
| `my_game:Arena-v0`          | none: a Gymnasium id, whose module is imported first                    |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from typing import Any

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.errors import TvaeError
from tvae.experiments.arenas import Arena
from tvae.multiplayer import Parallel, check_players, rollout
from tvae.rollouts import Policy
from tvae.spaces import Space

_PATH = re.compile(r"(?P<module>[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")
"""An import path; a Gymnasium id ends with its version, `-v0`."""


def is_parallel(env: str) -> bool:
    """Whether this is the import path of a parallel environment, and no Gymnasium id.

    >>> is_parallel("mpe2:simple_spread_v3"), is_parallel("my_game:Arena-v0"), is_parallel("CartPole-v1")
    (True, False, False)
    """
    return _PATH.fullmatch(env) is not None


def named_again(stored: Arena, env: str | None) -> Arena:
    """The environment that a run directory names, where that imports no module by name or `env` says the same.

    What is before a colon is imported, and a run directory may come from anyone: what it says must not decide what code
    runs. `TvaeError` otherwise.

    >>> named_again(Arena("CartPole-v1"), None).env
    'CartPole-v1'
    >>> try:
    ...     named_again(Arena("my_game:Arena"), None)
    ... except TvaeError as error:
    ...     print(error)
    the run's environment my_game:Arena is code of its own; say that it may run: --env my_game:Arena
    """
    if ":" in stored.env and env != stored.env:
        raise TvaeError(
            f"the run's environment {stored.env} is code of its own; say that it may run: --env {stored.env}"
        )
    return stored


@contextmanager
def opened(arena: Arena, observation_space: Space, action_space: Space) -> Iterator[Parallel]:
    """The environment, in which each player has these signals; it is closed afterwards.

    Raises `TvaeError` for a path that leads nowhere, `PlayersError` for what is no parallel environment and
    `SpaceMismatchError`, with both sides, where a player has other signals.
    """
    env = _maker(arena.env)()
    try:
        players = getattr(env, "possible_agents", ())
        check_players(env, dict.fromkeys(players, (observation_space, action_space)))
        yield env
    finally:
        if hasattr(env, "close"):  # what is no environment was refused above
            env.close()


def played(
    arena: Arena,
    observation_space: Space,
    action_space: Space,
    policy: Callable[[], Policy],
    *,
    seed: int,
    on_step: Callable[[int], None],
) -> Demonstrations:
    """The episodes of all players, each with a `policy` of its own, in `arena.episodes` games.

    An episode is one player in one game: the attribute `episode` is GAME/PLAYER, `session` the game, `player` the
    player. Step columns are those that all players have.
    """
    with opened(arena, observation_space, action_space) as env:
        policies = {player: policy() for player in env.possible_agents}
        of_players = rollout(env, policies, arena.episodes, seed=seed, on_step=on_step)
    common = set.intersection(*(set(one.steps) for one in of_players.values()))

    def episodes() -> Iterator[Trajectory]:
        for player, games in of_players.items():
            for one in games:
                game = one.attributes["episode"]
                facts = {"episode": f"{game}/{player}", "session": game, "player": player}
                steps = {name: values for name, values in one.steps.items() if name in common}
                yield replace(one, steps=steps, attributes=facts)

    return Demonstrations.from_trajectories(episodes(), observation_space, action_space)


def _maker(path: str) -> Callable[..., Parallel]:
    """What makes the environment at an import path."""
    found = _PATH.fullmatch(path)
    assert found is not None
    module, name = found["module"], found["name"]
    try:
        maker: Any = getattr(import_module(module), name, None)
        if maker is None:
            maker = import_module(f"{module}.{name}")
    except ImportError as error:
        raise TvaeError(
            f"{path}: cannot be imported: {error}. A parallel environment needs MODULE:NAME of a module that is "
            "installed or in PYTHONPATH, such as mpe2:simple_spread_v3; a Gymnasium id ends with its version"
        ) from error
    maker = getattr(maker, "parallel_env", maker)
    if not callable(maker):
        raise TvaeError(f"{path}: needs a class, a function or a module with parallel_env, got {maker!r}")
    return maker
