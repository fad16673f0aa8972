"""Numbers written down once: whoever changes them changes what the model means, and should know it.

Neither data nor weights depend on a generator of random numbers.
"""

import numpy as np
import pytest
import torch

from toys import ACTIONS, OBSERVATIONS
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.model.elbo import log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import Windows, cut, whole
from tvae.spaces import Space


def waves(space: Space, count: int, phase: float) -> np.ndarray:
    """Rows of a space that go up and down."""
    wave = np.sin(phase + np.arange(count * space.num_columns).reshape(count, -1) * 0.7)
    rows = 2 * wave + 0.1 * np.arange(count)[:, None]
    rows[:, space.binary] = wave[:, space.binary] > 0
    for column, number in zip(space.categorical, space.num_categories, strict=True):
        rows[:, column] = np.floor((wave[:, column] + 1) / 2 * (number - 0.01))
    return rows


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    episodes = [
        Trajectory(waves(OBSERVATIONS, length + final, 1.0 + length), waves(ACTIONS, length, 2.0 + length))
        for length, final in ((5, True), (3, False), (8, True), (1, True))
    ]
    return Demonstrations.from_trajectories(episodes, OBSERVATIONS, ACTIONS)


def fixed_model(demonstrations: Demonstrations, **arguments: object) -> TrajectoryVAE:
    model = TrajectoryVAE(OBSERVATIONS, ACTIONS, hidden_features=6, **arguments)
    model.calibrate(demonstrations)
    with torch.no_grad():
        for index, (_, parameter) in enumerate(sorted(model.named_parameters())):
            wave = torch.sin(index + 1.3 * torch.arange(parameter.numel(), dtype=torch.float64))
            parameter.copy_(0.5 * wave.reshape(parameter.shape))
    return model.eval()


def case(demonstrations: Demonstrations, name: str) -> tuple[TrajectoryVAE, Demonstrations, Windows | None]:
    """The arguments of `terms`."""
    if name == "paper":
        return fixed_model(demonstrations, stop=False, reactive=False, events=False), demonstrations, None
    model = fixed_model(
        demonstrations,
        latent_features=3,
        stop=True,
        action_components=3,
        state_components=2,
        prior_components=2,
        state_floor=0.3,
    )
    return model, demonstrations, cut(torch.from_numpy(demonstrations.lengths), 3, 1)


def terms(model: TrajectoryVAE, demonstrations: Demonstrations, windows: Windows | None) -> dict[str, list[float]]:
    batch = batch_of(demonstrations, np.arange(len(demonstrations)))
    with torch.no_grad():
        posterior = model.posterior(batch)
        z = posterior.mean + 0.5 * posterior.stddev
        policy, state, stop = log_likelihood(model, batch, z, whole(batch) if windows is None else windows)
        kl = model.prior.kl(posterior, z)
    return {"policy": policy.tolist(), "state": state.tolist(), "stop": stop.tolist(), "kl": kl.tolist()}


GOLDEN = {
    "paper": {
        "policy": [-38.53708, -17.05121, -58.55544, -8.678452],
        "state": [-46.14223, -19.35054, -72.97777, -9.481805],
        "stop": [0.0, 0.0, 0.0, 0.0],
        "kl": [0.7271922, 0.4946395, 0.7215216, 0.2816763],
    },
    "everything": {
        "policy": [-30.55591, -22.30153, -54.88025, -6.862975],
        "state": [-48.29427, -17.98767, -77.30372, -8.560003],
        "stop": [-3.504382, -3.026242, -4.819819, -0.7823615],
        "kl": [0.7939792, 0.6291108, 0.7900589, 0.5259328],
    },
}


@pytest.mark.parametrize("name", ["paper", "everything"])
def test_terms_of_the_bound(demonstrations: Demonstrations, name: str):
    found = terms(*case(demonstrations, name))
    for term, expected in GOLDEN[name].items():
        assert found[term] == pytest.approx(expected, rel=1e-4, abs=1e-4), term
