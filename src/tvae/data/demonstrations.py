"""A set of episodes, kept as flat arrays with offsets, in memory or memory-mapped."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from tvae.data.checks import attribute_values, check
from tvae.data.growing import GrowingRows
from tvae.data.packing import write_rows
from tvae.data.ragged import blocks, ranges
from tvae.data.trajectory import Attribute, DataError, Trajectory
from tvae.files import appearing
from tvae.spaces import FloatArray, IntArray, Space

FORMAT_VERSION = 1
HEADER_NAME = "demonstrations.json"
_BLOCK_ROWS = 1 << 20


@dataclass(frozen=True, eq=False)
class Demonstrations(Sequence[Trajectory]):
    """Episodes of one observation space and one action space.

    Recorded and generated behaviour have this same type. Selecting and splitting copy no steps.

    >>> import numpy as np
    >>> from tvae.spaces import Continuous, Space
    >>> episodes = [Trajectory(np.zeros((t + 1, 1)), np.ones((t, 1))) for t in (3, 5)]
    >>> observation_space, action_space = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> demos = Demonstrations.from_trajectories(episodes, observation_space, action_space)
    >>> len(demos), demos.num_steps, demos.lengths.tolist(), len(demos[1])
    (2, 8, [3, 5], 5)
    >>> demos
    <Demonstrations: 2 episodes, 8 steps; observations: x; actions: dx>
    """

    observation_space: Space
    action_space: Space
    observations: FloatArray
    """(sum of observations, O), all episodes one after another."""
    actions: FloatArray
    """(sum of actions, A), likewise."""
    observation_starts: IntArray
    """(E,) first row of each episode in `observations`."""
    action_starts: IntArray
    """(E,) first row of each episode in `actions`."""
    lengths: IntArray
    """(E,) number of actions T of each episode."""
    final_observed: NDArray[np.bool_]
    """(E,) whether the observation after the last action was recorded."""
    steps: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Further columns, a value an action, in the order of `actions`."""
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Facts about episodes: (E,) each."""

    def __repr__(self) -> str:
        parts = zip(("observations", "actions"), (self.observation_space.names, self.action_space.names), strict=True)
        listed = (f"{what}: {', '.join(names[:8])}{', ...' if names[8:] else ''}" for what, names in parts)
        return f"<Demonstrations: {len(self):,} episodes, {self.num_steps:,} steps; {'; '.join(listed)}>"

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def num_steps(self) -> int:
        """Number of actions of all episodes together."""
        return int(self.lengths.sum())

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> Demonstrations: ...
    def __getitem__(self, index: int | slice) -> Trajectory | Demonstrations:
        if isinstance(index, slice):
            return self.select(np.arange(len(self))[index])
        if not -len(self) <= index < len(self):
            raise IndexError(f"episode {index} of {len(self)}")
        length = int(self.lengths[index])
        first = int(self.observation_starts[index])
        rows = slice(int(self.action_starts[index]), int(self.action_starts[index]) + length)
        return Trajectory(
            observations=self.observations[first : first + length + int(self.final_observed[index])],
            actions=self.actions[rows],
            steps={name: values[rows] for name, values in self.steps.items()},
            attributes={name: values[index].item() for name, values in self.attributes.items()},
        )

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[index] for index in range(len(self)))

    def select(self, episodes: IntArray | Sequence[int]) -> Demonstrations:
        """The episodes at these positions, in this order."""
        at = np.asarray(episodes, dtype=np.int64)
        return Demonstrations(
            self.observation_space,
            self.action_space,
            self.observations,
            self.actions,
            self.observation_starts[at],
            self.action_starts[at],
            self.lengths[at],
            self.final_observed[at],
            self.steps,
            {name: values[at] for name, values in self.attributes.items()},
        )

    def with_attributes(self, attributes: Mapping[str, NDArray[Any]]) -> Demonstrations:
        """The same episodes with these facts, (E,) each, added or replaced."""
        for name, values in attributes.items():
            if len(values) != len(self):
                raise DataError(f"attribute {name!r} needs {len(self)} values, got {len(values)}")
        return Demonstrations(
            self.observation_space,
            self.action_space,
            self.observations,
            self.actions,
            self.observation_starts,
            self.action_starts,
            self.lengths,
            self.final_observed,
            self.steps,
            {**self.attributes, **attributes},
        )

    def split(
        self, fraction: float, *, seed: int = 0, group: str | None = None
    ) -> tuple[Demonstrations, Demonstrations]:
        """Two disjoint parts; the second holds about `fraction` of the episodes, at least one.

        With `group`, the name of an attribute, episodes of one group stay together.

        Raises `DataError` where there are too few episodes or groups to split.
        """
        if not 0 < fraction < 1:
            raise ValueError(f"fraction must lie between 0 and 1, got {fraction}")
        if group is None:
            keys: NDArray[Any] = np.arange(len(self))
        else:
            keys = self.attribute(group)
        unique, member = np.unique(keys, return_inverse=True)
        if len(unique) < 2:
            what = "episodes" if group is None else f"groups of {group!r}"
            raise DataError(f"a split needs at least 2 {what}, got {len(unique)}")
        order = np.random.default_rng(seed).permutation(len(unique))
        cumulative = np.cumsum(np.bincount(member)[order])
        taken = int(np.searchsorted(cumulative, fraction * len(self))) + 1
        held_out = np.isin(member, order[: min(taken, len(unique) - 1)])
        return self.select(np.flatnonzero(~held_out)), self.select(np.flatnonzero(held_out))

    def attribute(self, name: str) -> NDArray[Any]:
        """(E,) an attribute by name; `DataError` says which there are if it is missing."""
        if name not in self.attributes:
            there = ", ".join(sorted(self.attributes)) or "none"
            raise DataError(f"episodes have no attribute {name!r}; there are: {there}")
        return self.attributes[name]

    @classmethod
    def from_trajectories(
        cls, trajectories: Iterable[Trajectory], observation_space: Space, action_space: Space
    ) -> Demonstrations:
        """Episodes from an iterable, checked one by one; beyond 1 GiB they are kept on disk, memory-mapped.

        Raises `DataError` with episode, step and column at the first value that its space does not allow.
        """
        observations = GrowingRows(observation_space.num_columns)
        actions = GrowingRows(action_space.num_columns)
        lengths: list[int] = []
        final: list[bool] = []
        steps: dict[str, list[NDArray[Any]]] = {}
        attributes: dict[str, list[Attribute]] = {}
        for index, trajectory in enumerate(trajectories):
            name = trajectory.attributes.get("episode", index)
            check(trajectory, observation_space, action_space, name)
            if index == 0:
                steps = {key: [] for key in trajectory.steps}
                attributes = {key: [] for key in trajectory.attributes}
            for kept, given, what in (
                (steps, trajectory.steps, "step columns"),
                (attributes, trajectory.attributes, "attributes"),
            ):
                if kept.keys() != given.keys():
                    raise DataError(
                        f"episode {name}: every episode needs the same {what}: the first has "
                        f"{sorted(kept) or 'none'}, this one {sorted(given) or 'none'}"
                    )
            observations.append(trajectory.observations)
            actions.append(trajectory.actions)
            lengths.append(len(trajectory))
            final.append(trajectory.has_final_observation)
            for key, values in trajectory.steps.items():
                steps[key].append(np.asarray(values))
            for key, value in trajectory.attributes.items():
                attributes[key].append(value)
        if not lengths:
            raise DataError("demonstrations need at least one episode, got none")
        counts = np.array(lengths, dtype=np.int64)
        observed = counts + np.array(final)
        return cls(
            observation_space,
            action_space,
            observations.finish(),
            actions.finish(),
            np.cumsum(observed) - observed,
            np.cumsum(counts) - counts,
            counts,
            np.array(final),
            {key: np.concatenate(parts) for key, parts in steps.items()},
            {key: attribute_values(key, values) for key, values in attributes.items()},
        )

    def write(self, directory: Path, *, overwrite: bool = False) -> None:
        """Write the flat arrays to a directory that `open` maps into memory, few rows at a time.

        It appears only when whole. Raises `DataError` as `from_trajectories` does, and `FileExistsError` where it
        exists and `overwrite` is False, or holds something else.
        """
        if overwrite and directory.exists() and not (directory / HEADER_NAME).is_file():
            raise FileExistsError(f"{directory} exists already and holds no demonstrations")
        if len(self) == 0:
            raise DataError("demonstrations need at least one episode, got none")
        self._check()
        observed = self.lengths + self.final_observed
        of_steps = {"actions": self.actions, **{f"step_{i}": values for i, values in enumerate(self.steps.values())}}
        whole = {
            "observation_starts": np.cumsum(observed) - observed,
            "action_starts": np.cumsum(self.lengths) - self.lengths,
            "lengths": self.lengths,
            "final_observed": self.final_observed,
            **{f"attribute_{index}": values for index, values in enumerate(self.attributes.values())},
        }
        header = {
            "format": "tvae-demonstrations",
            "version": FORMAT_VERSION,
            "observation_space": self.observation_space.to_json(),
            "action_space": self.action_space.to_json(),
            "steps": list(self.steps),
            "attributes": list(self.attributes),
        }
        with appearing(directory, overwrite=overwrite) as partial:
            partial.mkdir()
            for name, values in whole.items():
                np.save(partial / f"{name}.npy", values, allow_pickle=False)
            write_rows(partial / "observations.npy", self.observations, self.observation_starts, observed)
            for name, values in of_steps.items():
                write_rows(partial / f"{name}.npy", values, self.action_starts, self.lengths)
            (partial / HEADER_NAME).write_text(json.dumps(header, indent=2), encoding="utf-8")

    def _check(self) -> None:
        """Raise `DataError` as `check` does, for the first episode of all."""
        observed = self.lengths + self.final_observed
        for part in blocks(observed, _BLOCK_ROWS):
            seen = self.observations[ranges(self.observation_starts[part], observed[part])]
            done = self.actions[ranges(self.action_starts[part], self.lengths[part])]
            if self.observation_space.first_problem(seen) or self.action_space.first_problem(done):
                for index in range(part.start, part.stop):
                    episode = self[index]
                    name = episode.attributes.get("episode", index)
                    check(episode, self.observation_space, self.action_space, name)

    @classmethod
    def open(cls, directory: Path) -> Demonstrations:
        """What `write` wrote, memory-mapped: nothing is read before it is used.

        Raises `DataError` if the directory holds something else or a part is missing or damaged.
        """

        def mapped(name: str) -> NDArray[Any]:
            values: NDArray[Any] = np.load(directory / f"{name}.npy", mmap_mode="r", allow_pickle=False)
            return values

        try:
            header = json.loads((directory / HEADER_NAME).read_text(encoding="utf-8"))
            if header.get("format") != "tvae-demonstrations" or header.get("version") != FORMAT_VERSION:
                raise DataError(
                    f"{directory}: needs format tvae-demonstrations, version {FORMAT_VERSION}, "
                    f"got {header.get('format')!r}, version {header.get('version')!r}"
                )
            return cls(
                Space.from_json(header["observation_space"]),
                Space.from_json(header["action_space"]),
                mapped("observations"),
                mapped("actions"),
                mapped("observation_starts"),
                mapped("action_starts"),
                mapped("lengths"),
                mapped("final_observed"),
                {name: mapped(f"step_{index}") for index, name in enumerate(header["steps"])},
                {name: mapped(f"attribute_{index}") for index, name in enumerate(header["attributes"])},
            )
        except DataError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError) as error:
            raise DataError(f"{directory}: no whole set of demonstrations: {error}") from error
