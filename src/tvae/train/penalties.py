"""Remedies on the latent's side: what is taken off the bound so that z holds the style and nothing of the world.

A penalty is an object that gives nats per trajectory; those of a training are added up:

    bound(tau) - sum_p penalty_p(tau).

- `StartIndependence`: a price for what z tells of the trajectory's first state;
- `SwappedStart`: z must be told again from what its bot does in another trajectory's world.

What z may hold in all has a price too, `beta`, or a budget (`tvae.train.schedules`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from tvae.data.batches import TrajectoryBatch
from tvae.model.decoding import sampled
from tvae.model.imagination import Imagination
from tvae.model.tvae import TrajectoryVAE
from tvae.train.independence import start_nats

_FARTHEST = 10.0
"""Standard deviations from the mean beyond which an imagined state counts as so far."""


@runtime_checkable
class Penalty(Protocol):
    """What a latent is charged with. A checkpoint knows it again by its `str`."""

    def __call__(
        self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Float[Tensor, "B Z"]
    ) -> Float[Tensor, " B"]:
        """Nats of each trajectory; `z` is the draw from `posterior`, q(z | tau), that the bound is estimated at."""
        ...


@dataclass(frozen=True)
class StartIndependence:
    """`weight` times the nats that z ~ q(z | tau) tells of s_1, within a component of the prior.

    The model says that p(z) knows nothing of s_1, and z of a bot comes from another trajectory; the bound pays for a
    z that foretells the start all the same. `tvae.train.independence` has the estimate, -1/2 log(1 - rho) of a
    kernel correlation rho over the batch (Gretton et al. 2005). It is taken within the region of z that belongs to one
    Gaussian of the prior: demonstrators may well choose their style by what they see at the start, and a distance
    between styles would hide what is told within one. Under N(0, I) it is taken over all of z.

    The same number for every trajectory of the batch. Its gradient reaches the encoder alone. Nothing is drawn.
    Raises `ValueError` for a weight below 0 or that is no number.

    >>> import numpy as np
    >>> from tvae.data.batches import batch_of
    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(32)
    >>> batch = batch_of(demonstrations, np.arange(32))
    >>> model = TrajectoryVAE(demonstrations.observation_space, demonstrations.action_space)
    >>> posterior = model.posterior(batch)
    >>> StartIndependence(weight=10.0)(model, batch, posterior, posterior.rsample()).shape
    torch.Size([32])
    """

    weight: float

    def __post_init__(self) -> None:
        _check_weight(self)

    def __call__(
        self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Float[Tensor, "B Z"]
    ) -> Float[Tensor, " B"]:
        normalizer = model.observation_normalizer
        start = normalizer.features(normalizer.values(batch.observations[:, 0]))
        with torch.no_grad():
            component = model.prior.component(z)
        return (self.weight * start_nats(z, start, component)).expand(len(batch))


@dataclass(frozen=True)
class SwappedStart:
    """`weight` KL(q(z | tau) || q(z | tau')), where tau' is what both decoders make of z from another one's start.

    tau' begins in the first state of another trajectory of the batch, a random rotation of it; the policy decoder acts
    on what the state decoder imagines, both by draws and under their windows, until the end that the model draws for
    it, or for as long as tau where it has no stop term. What in z was the world of tau cannot be told from tau', so
    that it costs; what shows in how z acts anywhere does not. That is the mean over z ~ q(z | tau) of
    log q(z | tau) - log q(z | tau'), which does not change with the scale of z.

    tau' counts as data: the gradient reaches the encoder alone, through both posteriors. Through the decoders it would
    have taught them to show in tau' whatever z holds, the world of tau included. Nothing is charged in a batch of
    one trajectory. An imagined state more than 10 standard deviations off the mean counts as so far.
    With a weight of 1 two of five trainings of the zombie task lost z (`docs/latent.md`): look at what it holds.

    Raises `ValueError` for a weight below 0 or that is no number.

    >>> import numpy as np
    >>> from tvae.data.batches import batch_of
    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(8)
    >>> batch = batch_of(demonstrations, np.arange(8))
    >>> model = TrajectoryVAE(demonstrations.observation_space, demonstrations.action_space)
    >>> posterior = model.posterior(batch)
    >>> bool((SwappedStart(weight=1.0)(model, batch, posterior, posterior.rsample()) >= 0).all())
    True
    """

    weight: float

    def __post_init__(self) -> None:
        _check_weight(self)

    def __call__(
        self, model: TrajectoryVAE, batch: TrajectoryBatch, posterior: Normal, z: Float[Tensor, "B Z"]
    ) -> Float[Tensor, " B"]:
        if len(batch) == 1:
            return z.new_zeros(1)
        again = model.posterior(with_swapped_starts(model, batch, z))
        return self.weight * kl_divergence(posterior, again).sum(-1)


@torch.no_grad()
def with_swapped_starts(model: TrajectoryVAE, batch: TrajectoryBatch, z: Float[Tensor, "B Z"]) -> TrajectoryBatch:
    """What the decoders make of each `z` from the start of another trajectory of the batch, which holds two or more."""
    others = batch.observations[:, 0].roll(1 + int(torch.randint(len(batch) - 1, ())), dims=0)
    normalizer, continuous = model.observation_normalizer, model.observation_space.continuous
    values = normalizer.values(others)
    longest = batch.actions.shape[1]
    lengths = torch.full_like(batch.lengths, longest) if model.stop else batch.lengths
    imagination = Imagination(model, z, sampled)
    observations, actions = [others], []
    for step in range(1, longest + 1):
        imagined = imagination.step(values)
        values = imagined.following.clone()
        values[:, continuous] = values[:, continuous].clamp(-_FARTHEST, _FARTHEST)
        observations.append(normalizer.raw(values))
        actions.append(model.action_normalizer.raw(imagined.actions))
        lengths = torch.where(imagined.ends, lengths.clamp(max=step), lengths)
        if int(lengths.max()) <= step:
            break
    within = torch.arange(len(actions), device=lengths.device) < lengths[:, None]
    rows = torch.stack(observations, dim=1)
    return TrajectoryBatch(
        observations=rows[:, :-1] * within[..., None],
        next_observations=rows[:, 1:] * within[..., None],
        actions=torch.stack(actions, dim=1) * within[..., None],
        lengths=lengths,
        next_known=within,
    )


def _check_weight(penalty: StartIndependence | SwappedStart) -> None:
    if not 0 <= penalty.weight < math.inf:
        raise ValueError(f"{type(penalty).__name__} needs a weight of at least 0, got {penalty.weight}")
