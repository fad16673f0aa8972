"""What a method is given, and what it must give back.

| name     | what                                                                                              |
|----------|---------------------------------------------------------------------------------------------------|
| `Lesson` | all that a method may learn from: demonstrations, the world they come from, a seed, a budget      |
| `Method` | hyperparameters as the fields of a frozen dataclass, and `learn(lesson) -> Bots`                   |
| `Bots`   | a `Policy` that acts in whatever style comes, and one for each style that can be asked for         |

Methods share helpers by composition and know nothing of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from gymnasium.vector import VectorEnv

from tvae.baselines.counting import StepCounter
from tvae.data.demonstrations import Demonstrations
from tvae.rollouts import Policy
from tvae.spaces import FloatArray, IntArray

Envs: TypeAlias = VectorEnv[Any, Any, Any]


@dataclass(frozen=True)
class World:
    """Where demonstrations come from, for the methods that need more than those."""

    envs: Callable[[int], Envs]
    """So many copies of the environment."""
    demonstrators: Mapping[str, Callable[[], Policy]]
    """Who demonstrated each style, by label."""
    lessons: Callable[[str, int, int], tuple[Envs, Policy]]
    """Of a label, a number of copies and a seed: copies of the environment, and the policy that says what the
    demonstrator of this label would do there, whoever acts."""


@dataclass(frozen=True, eq=False)
class Lesson:
    """All that a method may learn from."""

    demonstrations: Demonstrations
    """Their attribute `label` is for methods that say so, and for naming what was found."""
    world: World
    """For methods that need it. Whatever steps in it is counted by `steps`."""
    seed: int = 0
    """All randomness of the training."""
    most_steps: int | None = None
    """Gradient steps beyond which no method goes; None leaves each its own budget."""
    one_in: int = 1
    """Of the gradient steps that it would take a method takes one in so many."""
    steps: StepCounter = field(default_factory=StepCounter)
    """Environment steps taken so far."""

    def limited(self, num_steps: int) -> int:
        """The part that is asked for of a method's own number of gradient steps, or of the most that are allowed.

        >>> from tvae.envs.zombie import zombie_demonstrations
        >>> world = World(lambda count: None, {}, lambda label, count, seed: None)
        >>> Lesson(zombie_demonstrations(2), world, one_in=4).limited(2_000)
        500
        """
        whole = num_steps if self.most_steps is None else min(num_steps, self.most_steps)
        return max(1, whole // self.one_in)

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels of the demonstrations, sorted; none where they carry no label."""
        if "label" not in self.demonstrations.attributes:
            return ()
        return tuple(np.unique(self.demonstrations.attribute("label")).tolist())

    @property
    def label_index(self) -> IntArray:
        """(E,) which of `labels` each demonstration carries."""
        return np.unique(self.demonstrations.attribute("label"), return_inverse=True)[1].astype(np.int64)


@dataclass(frozen=True, eq=False)
class Bots:
    """What a method has learnt."""

    at_will: Policy
    """Acts in each episode in the style that the method gives it, as often as it will."""
    by_style: Mapping[str, Policy] = field(default_factory=dict)
    """By label, for methods that can be asked for a style."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What is worth keeping of the training, such as `gradient_steps` and `num_parameters`: plain data."""


@runtime_checkable
class Method(Protocol):
    """A way to learn; its fields are its hyperparameters, plain data."""

    def learn(self, lesson: Lesson) -> Bots:
        """The bots of this lesson; the same lesson gives the same bots."""
        ...


@runtime_checkable
class Codes(Protocol):
    """Where an episode's code comes from: a label, a latent, or nothing."""

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        ...


class NoCode:
    """The code of a method that has none.

    >>> NoCode().sample(3, np.random.default_rng(0)).shape
    (3, 0)
    """

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, 0)"""
        return np.zeros((count, 0))


@dataclass(frozen=True, eq=False)
class AnyOf:
    """One of these codes, drawn with equal probability for each episode.

    >>> AnyOf(np.eye(2)).sample(5, np.random.default_rng(0)).sum(1).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0]
    """

    codes: FloatArray
    """(R, Z)"""

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, Z)"""
        return self.codes[rng.integers(len(self.codes), size=count)]


def by_label(codes: FloatArray, lesson: Lesson) -> dict[str, AnyOf]:
    """For each label, the codes (E, Z) of the demonstrations that carry it."""
    return {label: AnyOf(codes[lesson.label_index == index]) for index, label in enumerate(lesson.labels)}
