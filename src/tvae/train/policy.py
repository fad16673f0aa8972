"""Training the policy decoder further and alone, for what bots are asked: a z of a style, not of an episode."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from tvae.data.batches import batch_of
from tvae.data.demonstrations import Demonstrations
from tvae.device import reseed, seeded
from tvae.model.decoding import LatentSource, latent_of
from tvae.model.elbo import policy_log_likelihood
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import drawn
from tvae.spaces import IntArray
from tvae.train.loop import TrainingError


def train_policy(
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    styles: Sequence[LatentSource],
    assignment: IntArray,
    *,
    num_steps: int,
    batch_size: int = 256,
    learning_rate: float = 3e-3,
    weight_decay: float = 1e-2,
    seed: int = 0,
    on_step: Callable[[int, float], None] = lambda step, nats: None,
) -> None:
    """Train the policy decoder of `model` in place, and nothing else of it.

        max E_tau E_{z ~ q_k} [ sum_t log pi(a_t | s_1:t, z) ],   q_k(z) = 1/N_k sum_i q(z | tau_i),

    where k is the style of tau, `assignment` (E,), and `styles[k]` samples q_k. Under the evidence lower bound the
    policy reads a z of the very episode that it imitates; a bot's z is that of any episode of its style. What z tells
    beyond the style so divides the demonstrations among many. Here z is drawn for training as it is for a bot, and all
    episodes of a style teach each of its bots.

    Each step takes `batch_size` moments, evenly from all steps of the demonstrations, each with the window of the past
    that a bot would see there, and one step of AdamW, its learning rate falling to nothing along half a cosine. Nothing
    is held out: `num_steps` says how near the policy comes to its demonstrations. The randomness of a step depends on
    `seed` and the step alone. `on_step` is told each step and the mean log-likelihood of an action, in nats.

    Raises `TrainingError` where the log-likelihood is not finite, and `ValueError` for numbers that are not positive or
    an assignment of another length.

    >>> from tvae.data.arrays import from_arrays
    >>> from tvae.model.decoding import Fixed
    >>> walks = from_arrays([np.zeros((9, 1)), np.zeros((9, 1))], [np.full((8, 1), -1.0), np.full((8, 1), 1.0)])
    >>> model = TrajectoryVAE(walks.observation_space, walks.action_space, latent_features=1, hidden_features=8)
    >>> model.calibrate(walks)
    >>> ways, nats = [Fixed(np.array([-1.0])), Fixed(np.array([1.0]))], {}
    >>> train_policy(model, walks, ways, np.array([0, 1]), num_steps=100, learning_rate=0.03, on_step=nats.__setitem__)
    >>> nats[1] < -1 and nats[100] > 1
    True
    """
    for name, number in (("num_steps", num_steps), ("batch_size", batch_size)):
        if number < 1:
            raise ValueError(f"{name} must be at least 1, got {number}")
    if len(assignment) != len(demonstrations):
        raise ValueError(f"{len(demonstrations)} episodes need as many styles, got {len(assignment)}")
    decoders = nn.ModuleList([model.policy_decoder, model.events])
    optimizer = torch.optim.AdamW(decoders.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True)
    shares = demonstrations.lengths / demonstrations.num_steps
    decoders.train()
    with seeded(seed, model.device):
        for step in range(num_steps):
            sequence = np.random.SeedSequence((seed, step))
            reseed(sequence.generate_state(1, np.uint64).item(), model.device)
            random = np.random.default_rng(sequence)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate * 0.5 * (1 + math.cos(math.pi * step / num_steps))
            episodes = random.choice(len(demonstrations), size=batch_size, p=shares)
            batch = batch_of(demonstrations, episodes, model.device)
            windows = drawn(batch, model.bot_window)
            z = _latents(model, styles, assignment[episodes], random)
            nats = policy_log_likelihood(model, batch, z, windows).sum() / windows.valid.sum()
            if not nats.isfinite():
                raise TrainingError(
                    f"step {step + 1} of the policy: the log-likelihood of an action is {nats.item()}. "
                    "Lower its learning rate, or look for extreme values in the demonstrations."
                )
            optimizer.zero_grad()
            (-nats).backward()
            optimizer.step()
            on_step(step + 1, nats.item())
    decoders.eval()


def _latents(model: TrajectoryVAE, styles: Sequence[LatentSource], of: IntArray, random: np.random.Generator) -> Tensor:
    """(B, Z): for each episode a draw from its style."""
    z = np.zeros((len(of), model.latent_features))
    for style in np.unique(of):
        z[of == style] = styles[style].sample(int((of == style).sum()), random)
    return latent_of(model, z, len(of))
