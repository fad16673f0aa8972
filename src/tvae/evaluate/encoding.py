"""What the encoder says of every episode: the mean and the scale of q(z | tau)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.data.batches import batch_of, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import check_spaces
from tvae.model.inference import inferring
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Posteriors:
    """q(z | tau_i) = N(means_i, diag scales_i^2) of N episodes.

    Raises `ValueError` for shapes that differ, numbers that are not finite and scales that are not positive.

    >>> posteriors = Posteriors(means=np.zeros((3, 2)), scales=np.ones((3, 2)))
    >>> len(posteriors), posteriors.sample(np.random.default_rng(0)).shape
    (3, (3, 2))
    """

    means: FloatArray
    """(N, Z)"""
    scales: FloatArray
    """(N, Z) standard deviations"""

    def __post_init__(self) -> None:
        if self.means.ndim != 2 or self.means.shape != self.scales.shape or len(self.means) == 0:
            raise ValueError(
                "means and scales need one shape (episodes, latent features) with at least one episode, "
                f"got {self.means.shape} and {self.scales.shape}"
            )
        if not (np.isfinite(self.means).all() and np.isfinite(self.scales).all() and (self.scales > 0).all()):
            raise ValueError("means need finite numbers and scales finite numbers above 0")

    def __len__(self) -> int:
        return len(self.means)

    def select(self, episodes: IntArray) -> Posteriors:
        """Those of the episodes at these positions."""
        return Posteriors(self.means[episodes], self.scales[episodes])

    def sample(self, rng: np.random.Generator) -> FloatArray:
        """(N, Z) one draw z ~ q(z | tau_i) of each episode."""
        return self.means + self.scales * rng.standard_normal(self.means.shape)

    def draw(self, episodes: IntArray, rng: np.random.Generator) -> FloatArray:
        """(B, Z) one draw for each of the episodes at these positions (B,), which may come more than once."""
        return self.select(episodes).sample(rng)


def encode(model: TrajectoryVAE, demonstrations: Demonstrations, batch_size: int = 64) -> Posteriors:
    """The posterior of every episode, in the order of `demonstrations`, without dropout.

    Raises `DataError` for demonstrations of other signals than the model's.

    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Continuous, Space
    >>> x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> walks = [Trajectory(np.zeros((t + 1, 1)), np.ones((t, 1))) for t in (5, 3, 4)]
    >>> encode(TrajectoryVAE(x, dx), Demonstrations.from_trajectories(walks, x, dx)).means.shape
    (3, 2)
    """
    check_spaces(demonstrations, model.observation_space, model.action_space)
    means = np.empty((len(demonstrations), model.latent_features))
    scales = np.empty_like(means)
    with inferring(model):
        for episodes in ordered_batches(demonstrations, batch_size):
            posterior = model.posterior(batch_of(demonstrations, episodes, model.device))
            means[episodes] = posterior.mean.cpu().double().numpy()
            scales[episodes] = posterior.stddev.cpu().double().numpy()
    return Posteriors(means, scales)
