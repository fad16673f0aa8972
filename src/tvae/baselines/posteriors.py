"""Models with a posterior q(z | trajectory): how they are trained, and the codes that they give to demonstrations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Normal

from tvae.baselines.contract import Lesson
from tvae.baselines.descending import Descent
from tvae.baselines.policies import held_apart
from tvae.data.batches import BucketedSampler, TrajectoryBatch, batch_of, ordered_batches, suitable_batch_size
from tvae.data.demonstrations import Demonstrations
from tvae.spaces import FloatArray

_AT_ONCE = 64
"""Trajectories that are looked at together."""


def learn_trajectories(
    model: nn.Module,
    loss: Callable[[TrajectoryBatch, float], Tensor],
    lesson: Lesson,
    descent: Descent,
    *,
    warm_up: float,
) -> None:
    """Train on whole trajectories; of the evaluated weights those best on a held-out tenth are kept.

    `loss` is told the weight of its KL term, which rises from 0 to 1 along a straight line over the share `warm_up` of
    the steps (Bowman et al. 2016); weights are judged with 1.
    """
    demonstrations = lesson.demonstrations
    training, judged = held_apart(demonstrations, 0.1, lesson.seed)
    sampler = BucketedSampler(
        demonstrations.lengths[training], suitable_batch_size(demonstrations.lengths), lesson.seed
    )
    held_out = demonstrations.select(judged)
    parts = list(ordered_batches(held_out, _AT_ONCE))
    warm = warm_up * descent.num_steps
    descent.run(
        model,
        lambda step: loss(
            batch_of(demonstrations, training[sampler.episodes(step)]), min(1.0, step / warm) if warm else 1.0
        ),
        seed=lesson.seed,
        judge=lambda: float(np.mean([float(loss(batch_of(held_out, part), 1.0)) for part in parts])),
    )


@torch.no_grad()
def posterior_means(posterior: Callable[[TrajectoryBatch], Normal], demonstrations: Demonstrations) -> FloatArray:
    """(E, Z) the mean of each demonstration's posterior."""
    order = list(ordered_batches(demonstrations, _AT_ONCE))
    means = [posterior(batch_of(demonstrations, part)).mean.double().numpy() for part in order]
    found: FloatArray = np.empty((len(demonstrations), means[0].shape[1]))
    found[np.concatenate(order)] = np.concatenate(means)
    return found
