"""Episodes of several players at once, in a parallel environment of PettingZoo.

Each player has a `Policy` of its own. What comes out is a data set for each player, of the type of the demonstrations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.errors import TvaeError
from tvae.gymnasium_spaces import flatten, named_spaces, unflatten
from tvae.rollouts import Policy, compare_spaces
from tvae.spaces import FloatArray, Space

if TYPE_CHECKING:
    from pettingzoo import ParallelEnv

    Parallel: TypeAlias = ParallelEnv[str, Any, Any]
else:
    Parallel = Any  # PettingZoo is an extra, and whoever has such an environment has it


class PlayersError(TvaeError):
    """Players and policies that do not fit together, or an environment in which nobody can play so."""


def spaces_of_player(env: Parallel, player: str) -> tuple[Space, Space]:
    """Observation and action space of a player.

    `env.metadata["signal_names"]` names the signals of all players as in `tvae.gymnasium_spaces`, or holds such a
    mapping for each player.
    """
    names = env.metadata.get("signal_names", {})
    if not {"observation", "action"} & set(names):
        names = names.get(player, {})
    return named_spaces(env.observation_space(player), env.action_space(player), names)


def check_players(env: Parallel, spaces: Mapping[str, tuple[Space, Space]]) -> None:
    """Raise unless there are observation and action space for each player, and the environment's are the same.

    Raises `PlayersError` for an environment that is not parallel and for other players than the environment's, and
    `SpaceMismatchError`, showing both sides.
    """
    if not hasattr(env, "possible_agents") or hasattr(env, "agent_iter"):
        raise PlayersError(
            f"several players need a parallel environment of PettingZoo, got {env}; "
            "pettingzoo.utils.aec_to_parallel makes one of an environment in which they take turns"
        )
    there, given = set(env.possible_agents), set(spaces)
    if there != given:
        raise PlayersError(
            f"each player of the environment needs one who plays it. Players: {', '.join(sorted(there))}. "
            f"Without one: {', '.join(sorted(there - given)) or 'none'}. "
            f"Not in the environment: {', '.join(sorted(given - there)) or 'none'}."
        )
    for player, mine in spaces.items():
        compare_spaces(mine, spaces_of_player(env, player), f"player {player!r}")


def rollout(
    env: Parallel,
    policies: Mapping[str, Policy],
    num_episodes: int,
    *,
    seed: int = 0,
    on_step: Callable[[int], None] = lambda finished: None,
) -> dict[str, Demonstrations]:
    """Run `num_episodes` episodes, one after another, and return those of each player.

    A player may come late and leave early, and then has fewer steps; an episode in which it never acts is missing. The
    attribute `episode` counts them, so that the same number is the same episode for all. Step columns are those of
    `tvae.rollouts.rollout`, as far as each episode has them. `on_step` is told how many episodes have finished.

    Raises `PlayersError` for a player who never acts, and for one who comes back in an episode that it has left.
    """
    if num_episodes < 1:
        raise ValueError(f"num_episodes must be at least 1, got {num_episodes}")
    played: dict[str, list[Trajectory]] = {player: [] for player in env.possible_agents}
    seeds = np.random.SeedSequence(seed)
    for episode in range(num_episodes):
        world_seed, *policy_seeds = (int(s.generate_state(1)[0] >> 1) for s in seeds.spawn(1 + len(played)))
        for player, policy_seed in zip(played, policy_seeds, strict=True):
            policies[player].reset(1, policy_seed)
        for player, record in _episode(env, policies, world_seed).items():
            played[player].append(record.trajectory(episode))
        on_step(episode + 1)
    idle = [player for player, trajectories in played.items() if not trajectories]
    if idle:
        raise PlayersError(f"{', '.join(idle)} never acted in {num_episodes} episodes")
    return {
        player: Demonstrations.from_trajectories(_with_same_steps(trajectories), *spaces_of_player(env, player))
        for player, trajectories in played.items()
    }


@dataclass
class _Record:
    """What a player saw and did."""

    observations: list[FloatArray]
    actions: list[FloatArray] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)

    def trajectory(self, episode: int) -> Trajectory:
        common = set.intersection(*(set(step) for step in self.steps))
        return Trajectory(
            observations=np.stack(self.observations),
            actions=np.stack(self.actions),
            steps={name: np.array([s[name] for s in self.steps]) for name in self.steps[0] if name in common},
            attributes={"episode": episode},
        )


def _episode(env: Parallel, policies: Mapping[str, Policy], world_seed: int) -> dict[str, _Record]:
    observations, _ = env.reset(seed=world_seed)
    records: dict[str, _Record] = {}
    present = set(env.agents)
    while env.agents:
        actions: dict[str, Any] = {}
        for player in env.agents:
            if player not in records:
                records[player] = _Record([_row(env, player, observations)])
            elif player not in present:
                raise PlayersError(f"{player} comes back in an episode that it has left, which cannot be recorded")
            row = policies[player].act(records[player].observations[-1][None])[0]
            actions[player] = unflatten(env.action_space(player), row)
        present = set(actions)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        for player, action in actions.items():
            record = records[player]
            record.observations.append(_row(env, player, observations))
            record.actions.append(flatten(env.action_space(player), action))
            record.steps.append(
                {
                    "reward": float(rewards[player]),
                    "terminated": bool(terminated[player]),
                    "truncated": bool(truncated[player]),
                    **_scalars(infos.get(player, {})),
                }
            )
    return records


def _row(env: Parallel, player: str, observations: Mapping[str, Any]) -> FloatArray:
    """(O,) what a player sees."""
    if player not in observations:
        raise PlayersError(f"{player} acts, and the environment gives it no observation")
    return flatten(env.observation_space(player), observations[player]).copy()


def _scalars(info: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a player's info that are one number."""
    arrays = {name: np.asarray(value) for name, value in info.items() if isinstance(value, int | float | np.generic)}
    return {f"info.{name}": array for name, array in arrays.items() if array.dtype.kind in "fiub"}


def _with_same_steps(trajectories: Sequence[Trajectory]) -> list[Trajectory]:
    """The trajectories with the step columns that all of them have."""
    common = set.intersection(*(set(trajectory.steps) for trajectory in trajectories))
    return [
        Trajectory(t.observations, t.actions, {n: v for n, v in t.steps.items() if n in common}, t.attributes)
        for t in trajectories
    ]
