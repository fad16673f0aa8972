"""Episodes of a policy in any Gymnasium environment.

Whatever acts (a T-VAE bot, a scripted expert, a baseline) is a `Policy` of two methods. What comes out has the
type of the demonstrations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.errors import TvaeError
from tvae.gymnasium_spaces import flatten, spaces_of, unflatten
from tvae.spaces import FloatArray, IntArray, Space


class SpaceMismatchError(TvaeError):
    """A policy and an environment whose spaces differ; the message says how."""


@runtime_checkable
class Policy(Protocol):
    """Acts in many episodes at once, in rows: one column per signal of the space."""

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes; all randomness of theirs comes from `seed`."""
        ...

    def act(self, observations: FloatArray) -> FloatArray:
        """Actions (N, A) for the present observations (N, O) of the N episodes."""
        ...


def check_spaces(envs: VectorEnv[Any, Any, Any], observation_space: Space, action_space: Space) -> None:
    """Raise `SpaceMismatchError`, showing both sides, if the environment has other signals than expected."""
    compare_spaces((observation_space, action_space), spaces_of(envs), "environment")


def compare_spaces(mine: tuple[Space, Space], theirs: tuple[Space, Space], whose: str) -> None:
    """Raise `SpaceMismatchError`, showing both sides, if a model has other signals than `whose` are `theirs`."""
    for what, own, other in zip(("observations", "actions"), mine, theirs, strict=True):
        differences = own.differences(other)
        if differences:
            raise SpaceMismatchError(
                f"{what} differ between model and {whose}: " + "; ".join(differences) + ". "
                f"Model: {', '.join(own.names)}. {whose[0].upper()}{whose[1:]}: {', '.join(other.names)}."
            )


class _Borrowed(SyncVectorEnv):
    """Environments of somebody else, which stay open."""

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing to do."""


def as_vector(env: gymnasium.Env[Any, Any]) -> VectorEnv[Any, Any, Any]:
    """One environment as a vector environment of one copy; closing this leaves `env` open."""
    return _Borrowed([lambda: env])


def rollout(
    envs: VectorEnv[Any, Any, Any],
    policy: Policy,
    num_episodes: int,
    *,
    seed: int = 0,
    on_step: Callable[[int], None] = lambda finished: None,
) -> Demonstrations:
    """Run `num_episodes` episodes, `envs.num_envs` at a time, one in each copy.

    Recorded actions are those that the environment was given: within its bounds, angles in [-pi, pi).

    Step columns: `reward`, `terminated`, `truncated`, and `info.NAME` for every scalar that the environment
    reports at each step. `on_step` is told how many episodes have finished.

    >>> from tvae.envs.zombie import AttackExpert
    >>> envs = gymnasium.make_vec("tvae/ZombieAttack-v0", num_envs=4)
    >>> len(rollout(envs, AttackExpert(), num_episodes=10))
    10
    """
    if num_episodes < 1:
        raise ValueError(f"num_episodes must be at least 1, got {num_episodes}")
    mode = envs.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
    if mode != AutoresetMode.NEXT_STEP:
        raise ValueError(f"a vector environment needs the autoreset mode NEXT_STEP, got {mode}")
    observation_space, action_space = spaces_of(envs)

    def episodes() -> Iterator[Trajectory]:
        finished = 0

        def report(in_this_round: int) -> None:
            on_step(finished + in_this_round)

        seeds = np.random.SeedSequence(seed)
        while finished < num_episodes:
            wanted = min(envs.num_envs, num_episodes - finished)
            world_seed, policy_seed = (int(s.generate_state(1)[0] >> 1) for s in seeds.spawn(2))
            yield from _round(envs, policy, wanted, world_seed=world_seed, policy_seed=policy_seed, on_step=report)
            finished += wanted

    return Demonstrations.from_trajectories(episodes(), observation_space, action_space)


def _round(
    envs: VectorEnv[Any, Any, Any],
    policy: Policy,
    wanted: int,
    *,
    world_seed: int,
    policy_seed: int,
    on_step: Callable[[int], None],
) -> Iterator[Trajectory]:
    """One episode in each of the first `wanted` copies."""
    value, _ = envs.reset(seed=world_seed)
    policy.reset(envs.num_envs, policy_seed)
    observations = [flatten(envs.single_observation_space, value).copy()]
    actions: list[FloatArray] = []
    columns: dict[str, list[Any]] = {}
    lengths: IntArray = np.zeros(envs.num_envs, dtype=np.int64)
    while (lengths[:wanted] == 0).any():
        action = unflatten(envs.single_action_space, policy.act(observations[-1]))
        value, reward, terminated, truncated, info = envs.step(action)
        observations.append(flatten(envs.single_observation_space, value).copy())  # some reuse their arrays
        actions.append(flatten(envs.single_action_space, action))
        step = {"reward": reward, "terminated": terminated, "truncated": truncated, **_scalars(info, envs.num_envs)}
        if len(actions) == 1:
            columns = {name: [] for name in step}
        columns = {name: kept for name, kept in columns.items() if name in step}
        for name, kept in columns.items():
            kept.append(np.array(step[name]))
        lengths[(lengths == 0) & (terminated | truncated)] = len(actions)
        on_step(int((lengths[:wanted] > 0).sum()))
    all_observations, all_actions = np.stack(observations, axis=1), np.stack(actions, axis=1)
    stacked = {name: np.stack(kept, axis=1) for name, kept in columns.items()}
    for index in range(wanted):
        length = int(lengths[index])
        yield Trajectory(
            observations=all_observations[index, : length + 1],
            actions=all_actions[index, :length],
            steps={name: values[index, :length] for name, values in stacked.items()},
        )


def _scalars(info: dict[str, Any], num_envs: int) -> dict[str, Any]:
    """The entries of a vector environment's info that are one number a copy."""
    return {
        f"info.{name}": values
        for name, values in info.items()
        if not name.startswith("_")
        and isinstance(values, np.ndarray)
        and values.shape == (num_envs,)
        and values.dtype.kind in "fiub"
    }
