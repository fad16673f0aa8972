"""Rolling windows, and the shortest one that a bot needs."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from toys import noise, untrained
from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.fitting.fit import fit
from tvae.model.decoding import EventMemory, Recurrence, most_likely
from tvae.model.elbo import log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import rolling
from tvae.spaces import Binary, Continuous, Space
from tvae.train.memory import shortest_sufficient_window

ONE, BIT = Space((Continuous("x"),)), Space((Continuous("dx"),))


@pytest.mark.parametrize("window", [1, 2, 3, 9])
def test_a_rolling_window_is_what_a_bot_sees(window: int):
    """Log-likelihood under `rolling` equals that of the laws which a bot has, step by step."""
    demonstrations = noise([5, 2, 7], observation_space=ONE, action_space=BIT)
    model = untrained(demonstrations, window=9)
    batch, z = batch_of(demonstrations, np.arange(3)), torch.tensor([[0.1, 0.2], [1.0, -1.0], [0.0, 2.0]])
    with torch.no_grad():
        found, _, _ = log_likelihood(model, batch, z, rolling(batch.lengths, window))
        for index, episode in enumerate(demonstrations):
            latent = z[index : index + 1]
            recurrence, done = (
                Recurrence(model.policy_decoder.trunk, latent, window),
                EventMemory(model, latent, most_likely).done,
            )
            expected = 0.0
            for observation, action in zip(episode.observations, episode.actions, strict=False):
                inputs = model.policy_decoder_inputs(torch.from_numpy(observation[None]).float(), done)
                law = model.policy_decoder.law(recurrence.step(inputs))
                expected += law.log_prob(model.action_normalizer.values(torch.from_numpy(action[None]).float())).item()
            assert found[index].item() == pytest.approx(expected, abs=1e-4)


def test_every_step_counts_once():
    windows = rolling(torch.tensor([4, 1, 6]), 3)
    counted = [
        (episode, step)
        for episode, steps, valid in zip(windows.trajectory.tolist(), windows.steps, windows.valid, strict=True)
        for step in steps[valid].tolist()
    ]
    assert sorted(counted) == [(e, s) for e, length in enumerate((4, 1, 6)) for s in range(length)]


def walks(memory: int) -> Demonstrations:
    """The action is the state of `memory` steps ago, which is noise."""
    random = np.random.default_rng(0)

    def walk() -> Trajectory:
        x = random.normal(size=(13, 1))
        before = np.concatenate([np.zeros((memory, 1)), x])[: len(x)]
        return Trajectory(x, before[:-1] + 0.05 * random.normal(size=(12, 1)))

    return Demonstrations.from_trajectories((walk() for _ in range(60)), ONE, BIT)


@pytest.mark.parametrize(("memory", "shortest", "needed"), [(0, 1, 1), (1, 1, 2), (0, 2, 2), (0, 4, 4)])
def test_a_bot_sees_what_it_needs(memory: int, shortest: int, needed: int):
    model = fit(
        walks(memory), num_steps=400, batch_size=16, hidden_features=16, evaluate_every=100, window=4, device="cpu",
        stop=False, action_components=1, latent_features=0,
        shortest_window=shortest,
    )  # fmt: skip
    assert model.bot_window == needed
    reloaded = TrajectoryVAE(ONE, BIT, **model.arguments)
    reloaded.load_state_dict(model.state_dict())
    assert reloaded.bot_window == needed


def test_whole_trajectories_leave_a_bot_its_memory():
    demonstrations = noise([5, 4], observation_space=ONE, action_space=Space((Binary("press"),)))
    model = untrained(demonstrations)
    assert model.bot_window is None
    assert shortest_sufficient_window(model, demonstrations) is None
