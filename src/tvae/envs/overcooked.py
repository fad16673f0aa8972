"""Overcooked: two cooks in one kitchen, and recorded games of real people in it.

Both players' moves are one joint action, so that a trajectory is a whole game and its style is how the pair works
together. The dynamics are those of 2019, in which three onions in a pot start to cook by themselves, for 20 steps;
a delivered soup is worth 20. Nothing in a game is random.

The simulator is the package `overcooked` (MIT), the recorded games are those of Carroll et al. 2019, "On the
utility of learning about humans for human-AI coordination" (arXiv 1910.05789).
"""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces as gym
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError, Trajectory
from tvae.envs.overcooked_features import LAYOUTS, Features, signals
from tvae.gymnasium_spaces import flatten, wrap
from tvae.spaces import Categorical, FloatArray, IntArray, Space

try:
    import pygame
    from overcooked.mdp import Action, OvercookedGridworld, OvercookedState
    from overcooked.visualization import StateVisualizer
except ImportError as error:
    raise ImportError(f"Overcooked needs its simulator: pip install 'tvae[overcooked]' ({error})") from error

ACTIONS = ("north", "south", "east", "west", "stay", "interact")
PLAYERS = ("player_0", "player_1")
SOUP_REWARD = 20.0
STEPS_PER_SECOND = 6.7
"""How fast the recorded people played."""
_STARTS = {"counter_circuit_o_1order": ((6, 3), (1, 3))}
"""Where the recorded people began, if that is not where the simulator's layout says."""
_POINTS_PER_SOUP = 5
"""What the recorded games' own score counts."""


class OvercookedEnv(gymnasium.Env[IntArray, IntArray]):
    """A game of two players for `horizon` steps, then truncated.

    Action: one of `ACTIONS` for each player, `MultiDiscrete([6, 6])`. Observation: see
    `tvae.envs.overcooked_features`; with `surroundings` also what follows from the state. Reward: 20 a soup
    delivered. Info: `soups` delivered so far, and the players' positions `x_0`, `y_0`, `x_1`, `y_1` in cells from
    the top left corner. Every episode starts in the same state.

    >>> env = OvercookedEnv("coordination_ring", horizon=2)
    >>> observation, info = env.reset()
    >>> east, stay = ACTIONS.index("east"), ACTIONS.index("stay")
    >>> observation, reward, terminated, truncated, info = env.step(np.array([east, stay]))
    >>> info
    {'soups': 0, 'x_0': 3, 'y_0': 1, 'x_1': 1, 'y_1': 2}
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": STEPS_PER_SECOND,
    }

    def __init__(
        self,
        layout: str = "coordination_ring",
        horizon: int = 400,
        *,
        surroundings: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if layout not in LAYOUTS:
            raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 step, got {horizon}")
        self.render_mode = render_mode
        self.horizon = horizon
        self._rules = OvercookedGridworld.from_layout_name(layout, old_dynamics=True)
        self.terrain = tuple("".join(row) for row in self._rules.terrain_mtx)
        self._features = Features(layout, self.terrain, surroundings=surroundings)
        self._start = OvercookedState.from_player_positions(
            _STARTS.get(layout, self._rules.start_player_positions), all_orders=self._rules.start_all_orders
        )
        self._state: Any = None
        self._soups = 0
        self.observation_space = self._features.space
        self.action_space = gym.MultiDiscrete([len(ACTIONS)] * 2)
        names = {"observation": self._features.names, "action": PLAYERS}
        self.metadata = {**self.metadata, "signal_names": names}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[IntArray, dict[str, Any]]:
        """Both players at their places, empty pots. Nothing is random, so `seed` changes nothing."""
        super().reset(seed=seed)
        self._state, self._soups = self._start, 0
        return self._features.observe(self._state), self._info()

    def step(self, action: IntArray) -> tuple[IntArray, float, bool, bool, dict[str, Any]]:
        """Both players act at once."""
        if self._state is None:
            raise ResetNeeded("an environment must be reset before its first step")
        if not self.action_space.contains(action):
            raise ValueError(f"an action needs two numbers from 0 to {len(ACTIONS) - 1}, got {action}")
        moves = [Action.INDEX_TO_ACTION[int(index)] for index in action]
        self._state, outcome = self._rules.get_state_transition(self._state, moves)
        reward = float(sum(outcome["sparse_reward_by_agent"]))
        self._soups += round(reward / SOUP_REWARD)
        truncated = self._state.timestep >= self.horizon
        return self._features.observe(self._state), reward, False, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        (x_0, y_0), (x_1, y_1) = self._state.player_positions
        return {"soups": self._soups, "x_0": x_0, "y_0": y_0, "x_1": x_1, "y_1": y_1}

    def render(self) -> NDArray[np.uint8]:
        """The kitchen as an RGB picture, 75 pixels a cell."""
        os.environ.setdefault("SDL_AUDIODRIVER", "dummy")  # pygame complains where there is no sound card
        surface = StateVisualizer().render_state(self._state, grid=self.terrain)
        picture: NDArray[np.uint8] = pygame.surfarray.array3d(surface).transpose(1, 0, 2)
        return picture


def overcooked_demonstrations(
    path: Path, layouts: Sequence[str] | None = None, *, surroundings: bool = False
) -> Demonstrations:
    """The recorded games of real people in `layouts` (all five by default), replayed in the simulator.

    Only starts and joint actions are recorded; the replay gives every state, and the number of soups is checked
    against the recorded score. Step columns as `tvae.rollouts.rollout` gives them. Attributes: `episode` (place in
    the file), `pair` and `group` (who played; hold out whole pairs), `layout`, `round` (0 is a pair's first game),
    `split` (`train` or `test` in the recordings).

    Raises `ValueError` for an unknown layout and `DataError` where a replay is not the recorded game.
    """
    wanted = LAYOUTS if layouts is None else tuple(layouts)
    unknown = sorted(set(wanted) - set(LAYOUTS))
    if unknown or not wanted:
        raise ValueError(f"layouts must be some of {', '.join(LAYOUTS)}, got {', '.join(unknown) or 'none'}")
    with gzip.open(path, "rt", encoding="utf-8") as file:
        games = json.load(file)["trials"]
    return Demonstrations.from_trajectories(
        (_replay(game, episode, surroundings) for episode, game in enumerate(games) if game["layout"] in wanted),
        Space(tuple(signals(surroundings=surroundings))),
        Space(tuple(Categorical(name, ACTIONS) for name in PLAYERS)),
    )


def _replay(game: dict[str, Any], episode: int, surroundings: bool) -> Trajectory:
    actions = np.array(game["joint_actions"], dtype=np.int64)
    env = OvercookedEnv(game["layout"], horizon=len(actions), surroundings=surroundings)
    first, info = env.reset()
    recorded = [coordinate for player in game["start"] for coordinate in player["position"]]
    if recorded != [info["x_0"], info["y_0"], info["x_1"], info["y_1"]]:
        raise DataError(f"episode {episode}: a game in {game['layout']} must start at {info}, got {recorded}")
    outcomes = [env.step(action) for action in actions]
    soups = outcomes[-1][-1]["soups"]
    if soups * _POINTS_PER_SOUP != game["score_2019"]:
        raise DataError(
            f"episode {episode}: the recorded score of {game['score_2019']:g} needs "
            f"{game['score_2019'] / _POINTS_PER_SOUP:g} soups, the replay delivered {soups}"
        )
    return Trajectory(
        observations=flatten(env.observation_space, np.stack([first, *(outcome[0] for outcome in outcomes)])),
        actions=flatten(env.action_space, actions),
        steps={
            "reward": np.array([reward for _, reward, _, _, _ in outcomes]),
            "terminated": np.array([terminated for _, _, terminated, _, _ in outcomes]),
            "truncated": np.array([truncated for _, _, _, truncated, _ in outcomes]),
            **{f"info.{name}": np.array([outcome[-1][name] for outcome in outcomes]) for name in info},
        },
        attributes={
            "episode": episode,
            "pair": game["pair"],
            "group": game["pair"],
            "layout": game["layout"],
            "round": game["round"],
            "split": game["split"],
        },
    )


def with_seats_exchanged(games: Demonstrations) -> Demonstrations:
    """All games twice, the second time with the two players exchanged: who is called player 0 means nothing.

    Exchanged are all signals whose names end in `_0` and `_1` but the pots', in observations and actions. A further
    attribute `exchanged` says which games are; those have the attribute `episode` of the game that they come from.

    >>> from tvae.spaces import Space
    >>> space = Space((Categorical("x_0", (1, 2, 3)), Categorical("x_1", (1, 2, 3))))
    >>> moves = Space(tuple(Categorical(name, ACTIONS) for name in PLAYERS))
    >>> walk = Trajectory(np.array([[0.0, 2.0]] * 2), np.array([[4.0, 5.0]]))
    >>> both = with_seats_exchanged(Demonstrations.from_trajectories([walk], space, moves))
    >>> both[1].observations[0].tolist(), both[1].actions[0].tolist(), both.attributes["exchanged"].tolist()
    ([2.0, 0.0], [5.0, 4.0], [False, True])
    """
    seen, done = (_other_seats(space) for space in (games.observation_space, games.action_space))
    recorded = list(games)
    return Demonstrations.from_trajectories(
        [
            *(replace(game, attributes={**game.attributes, "exchanged": False}) for game in recorded),
            *(
                replace(
                    game,
                    observations=game.observations[:, seen],
                    actions=game.actions[:, done],
                    attributes={**game.attributes, "exchanged": True},
                )
                for game in recorded
            ),
        ],
        games.observation_space,
        games.action_space,
    )


def _other_seats(space: Space) -> list[int]:
    """For each column the one that is the other player's."""
    others = {"0": "1", "1": "0"}
    return [
        space.column(name[:-1] + others[name[-1]]) if name[-2:] in {"_0", "_1"} and name[:-2] != "pot" else column
        for column, name in enumerate(space.names)
    ]


def net_laps(demonstrations: Demonstrations, centre: tuple[float, float] = (2.0, 2.0)) -> FloatArray:
    """(E,) laps that the pair went round `centre`; positive is clockwise as seen on the screen.

    For each player the winding angle around `centre` (in cells, y down; the default is the counter in the middle
    of `coordination_ring`), sum_t wrap(angle_{t+1} - angle_t), divided by 2 pi; then the mean of both players.
    """
    space = demonstrations.observation_space
    return np.array([_laps(space, episode.observations, centre) for episode in demonstrations])


def _laps(space: Space, observations: FloatArray, centre: tuple[float, float]) -> float:
    laps = []
    for player in range(2):
        east = _raw(space, observations, f"x_{player}") - centre[0]
        south = _raw(space, observations, f"y_{player}") - centre[1]
        laps.append(wrap(np.diff(np.arctan2(south, east))).sum() / (2 * np.pi))
    return float(np.mean(laps))


def _raw(space: Space, rows: FloatArray, name: str) -> FloatArray:
    """A column of category indices as the numbers that they stand for."""
    column = space.column(name)
    signal = space.signals[column]
    if not isinstance(signal, Categorical):
        raise ValueError(f"signal {name!r} must be categorical, got {signal}")
    return np.asarray(signal.categories, dtype=np.float64)[rows[:, column].astype(np.int64)]
