"""A run as pure data: what `config.json` holds and the command line changes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, TypeVar, cast

T = TypeVar("T")


@dataclass(frozen=True)
class ModelConfig:
    """The arguments of `tvae.TrajectoryVAE`."""

    latent_features: int = 2
    """Size of z. 0 gives the same model without a latent."""
    hidden_features: int = 64
    """Size of every recurrent net."""
    policy_features: int | None = None
    """Size of the policy decoder's, where it is to be another."""
    dropout: float = 0.0
    """Probability with which a feature inside a network is dropped in training."""
    window: int | None = 4
    """The most past states that a decoder sees; a bot sees the fewest that lose nothing. None for all of them."""
    stop: bool = True
    """Model the end of an episode. Turn it off for segments of long recordings, whose ends mean nothing."""
    action_components: int = 2
    """Laws in the mixture of each action: left or right around an obstacle, but never straight into it."""
    state_components: int = 1
    """Laws in the mixture of each next state; more for worlds that mostly rest and then leap."""
    prior_components: int = 4
    """Gaussians in the prior of z. With several, styles can lie apart at no cost, and none bleeds into another."""
    state_floor: float = 0.1
    """Smallest standard deviation of a next state, in typical one-step changes."""
    action_floor: float = 0.02
    """Smallest standard deviation of an action, in its own standard deviations (angles: radians)."""
    encode_actions: bool = True
    """Let the encoder read the actions beside the states."""
    reactive: bool = True
    """Let the decoders' heads see the present state and its last change beside what the LSTM remembers."""
    horizon: int = 1
    """Steps ahead for which the state decoder says what will be, beside the next; z then holds where one is going."""
    dynamics: bool = False
    """Let the state decoder read the actions beside the states, so that it says what each leads to."""
    events: bool = True
    """Take binary actions for events: a style uses one or not, and what was done is remembered."""


@dataclass(frozen=True)
class TrainingConfig:
    """The arguments of `tvae.train.loop.train`."""

    num_steps: int | None = None
    """Most steps of gradient descent; None for 60 passes over the demonstrations, at least 2,200 and at most 6,000."""
    batch_size: int | None = None
    """Trajectories in a step; None for 32 to 64 of them, fewer where they are long."""
    learning_rate: float = 1e-2
    """Of Adam, at the start."""
    clip: float = 1.0
    """Largest gradient norm of each of encoder, prior and decoders."""
    state_weight: float = 1.0
    """Weight of the state term; 0 trains as if next states were not told."""
    shortest_window: int = 1
    """The least past states that a bot is to see, where fewer would do."""
    kl_points: tuple[tuple[float, float], ...] = ((0.0, 1.0), (0.4, 1.0), (0.5, 1.5))
    """Weight of the KL term: straight lines between (progress, weight)."""
    kl_budget: float | None = None
    """Nats that z may hold: the weight of the KL term is steered towards it, in place of `kl_points`."""
    start_independence: float = 0.0
    """Price of each nat that z tells of an episode's first state, beside that of the KL term."""
    swapped_start: float = 0.0
    """Weight of telling z again from what its bot does, as imagined, from another episode's start."""
    evaluate_every: int = 100
    """Steps between evaluations on held-out demonstrations, which are also when a checkpoint is written."""
    patience: int = 10
    """Evaluations without improvement after which training ends."""
    held_out: float = 0.1
    """Share of the demonstrations that is held out."""


@dataclass(frozen=True)
class PolicyConfig:
    """How the policy learns further, alone (`tvae.train.policy.train_policy`)."""

    num_steps: int | None = None
    """Steps in which the policy alone learns further; None for as many as the training before, at most 2,500."""
    batch_size: int = 1_024
    """Moments in a step."""
    learning_rate: float = 5e-3
    """Of AdamW, at the start."""


_AT_LEAST = {
    0: ("seed", "model.latent_features", "training.state_weight", "policy.num_steps"),
    1: (
        "model.hidden_features",
        "model.policy_features",
        "model.window",
        "model.action_components",
        "model.state_components",
        "model.prior_components",
        "model.horizon",
        "training.num_steps",
        "training.batch_size",
        "training.shortest_window",
        "training.evaluate_every",
        "training.patience",
        "policy.batch_size",
    ),
}
_POSITIVE = (
    "model.state_floor",
    "model.action_floor",
    "training.learning_rate",
    "training.clip",
    "policy.learning_rate",
)


@dataclass(frozen=True)
class RunConfig:
    """A whole run."""

    model: ModelConfig = field(default_factory=ModelConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    seed: int = 0
    group: str | None = None
    """Attribute whose groups stay whole when demonstrations are split, such as a pair of players."""

    def check(self) -> None:
        """Raise `ValueError` for a number that is not in its range.

        >>> RunConfig(training=TrainingConfig(patience=0)).check()
        Traceback (most recent call last):
        ValueError: training.patience must be at least 1, got 0
        """
        values = {"seed": self.seed} | {
            f"{part}.{name}": value
            for part, settings in (("model", self.model), ("training", self.training), ("policy", self.policy))
            for name, value in asdict(settings).items()
        }
        for least, names in _AT_LEAST.items():
            for name in names:
                if values[name] is not None and not least <= values[name] < math.inf:
                    raise ValueError(f"{name} must be at least {least}, got {values[name]}")
        for name in _POSITIVE:
            if not 0 < values[name] < math.inf:
                raise ValueError(f"{name} must be above 0, got {values[name]}")
        if not 0 <= self.model.dropout < 1:
            raise ValueError(f"model.dropout must be at least 0 and below 1, got {self.model.dropout}")
        if not 0 < self.training.held_out < 1:
            raise ValueError(f"training.held_out must lie between 0 and 1, got {self.training.held_out}")

    def to_json(self) -> dict[str, Any]:
        """Plain data for a JSON file."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> RunConfig:
        """The configuration that `to_json` wrote.

        >>> config = RunConfig(seed=3)
        >>> RunConfig.from_json(config.to_json()) == config
        True
        """
        return cls(
            model=_read(ModelConfig, data["model"]),
            training=_read(
                TrainingConfig,
                {**data["training"], "kl_points": tuple(tuple(p) for p in data["training"]["kl_points"])},
            ),
            policy=_read(PolicyConfig, data.get("policy", asdict(_WITHOUT))),
            seed=int(data["seed"]),
            group=data["group"],
        )

    @classmethod
    def completed(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """What `to_json` wrote, as a JSON file gives it back, where settings that came later are as they then were.

        So are those of a policy that does not learn alone. What else stands in `data` stays; what is no such
        configuration is given back as it is.

        >>> stored = RunConfig(seed=3).to_json()
        >>> del stored["policy"]
        >>> RunConfig.completed(stored)["policy"]["num_steps"], RunConfig.completed({"task": "chess"})
        (0, {'task': 'chess'})
        """
        try:
            config = cls.from_json(data)
        except (KeyError, TypeError, ValueError):
            return dict(data)
        if config.policy.num_steps == 0:
            config = replace(config, policy=_WITHOUT)
        return {**data, **json.loads(json.dumps(config.to_json()))}


_WITHOUT = PolicyConfig(num_steps=0)
"""Before there was any, no policy learnt alone."""


def _read(cls: type[T], data: Mapping[str, Any]) -> T:
    known = {f.name for f in fields(cast("Any", cls))}
    unknown = sorted(set(data) - known)
    if unknown:
        raise ValueError(f"unknown {cls.__name__} {', '.join(unknown)}; there are {', '.join(sorted(known))}")
    return cls(**data)
