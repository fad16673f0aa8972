"""Training the policy decoder further and alone, on what its bots will see."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from tvae.data.batches import batch_of, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.device import reseed, seeded
from tvae.model.decoding import latent_of
from tvae.model.elbo import policy_log_likelihood, policy_terms
from tvae.model.inference import inferring, learning
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import drawn, policy_windows
from tvae.spaces import FloatArray
from tvae.train.checkpoint import copy_of_weights
from tvae.train.latents import EpisodeLatents
from tvae.train.loop import TrainingError
from tvae.train.memory import candidates

_EVALUATIONS = 10
_JUDGED_AT_ONCE = 32
_MOMENTS = 16
"""Of each trajectory that a step draws."""
_LONGER = 0.5
"""Share of the steps whose window is any of those that a bot may be given, so that none of them is unlearnt."""


@dataclass(frozen=True, eq=False)
class Lessons:
    """Demonstrations, and what the policy is told of each."""

    demonstrations: Demonstrations
    latents: EpisodeLatents

    def __post_init__(self) -> None:
        if len(self.latents) != len(self.demonstrations):
            raise ValueError(f"{len(self.demonstrations)} episodes need as many latents, got {len(self.latents)}")


def train_policy(
    model: TrajectoryVAE,
    lessons: Lessons,
    held_out: Lessons | None = None,
    *,
    num_steps: int,
    batch_size: int = 1_024,
    learning_rate: float = 5e-3,
    weight_decay: float = 1e-2,
    seed: int = 0,
    on_step: Callable[[int, float], None] = lambda step, nats: None,
) -> None:
    """Train the policy decoder of `model` in place, and nothing else of it.

        max E_tau E_z [ sum_t log pi(a_t | s_1:t, z) ]

    The policy's term of the evidence lower bound, where encoder and state decoder stay as they are: with
    z ~ q(z | tau) (`tvae.evaluate.encoding.Posteriors`) the bound only rises by it. Beside the others the policy learns
    in few, long steps, half of them without a past; alone it can be made sharp. Or z is of the style of tau
    (`tvae.train.latents.OfStyles`), as it is for a bot: what z tells beyond the style then no longer divides the
    demonstrations among many, and all episodes of a style teach each of its bots.

    Each step takes `batch_size` moments, 16 of each trajectory that it draws and evenly from all steps of the
    demonstrations, each with the window of the past that a bot would see there (half of the steps, all with another
    window of those that a bot may be given). Of a model without windows a step takes whole trajectories, each as often
    as another, that have about as many moments together. What a trajectory says of its events, log p(E | z), counts as
    much as the share of its moments that a step takes. AdamW's learning rate falls to nothing along half a cosine. The
    randomness of a step depends on `seed` and the step alone. `on_step` is told each step and the mean log-likelihood
    of an action, in nats.

    With `held_out`, its mean log-likelihood of an action is measured before, and ten times on the way, and the weights
    with the best one are kept, those before among them. Without, `num_steps` says how near the policy comes to its
    demonstrations, by heart in the end.

    Raises `TrainingError` where a log-likelihood is not finite, and `ValueError` for numbers that are not positive.

    >>> from tvae.data.arrays import from_arrays
    >>> from tvae.model.decoding import Fixed
    >>> from tvae.train.latents import OfStyles
    >>> walks = from_arrays([np.zeros((9, 1)), np.zeros((9, 1))], [np.full((8, 1), -1.0), np.full((8, 1), 1.0)])
    >>> model = TrajectoryVAE(walks.observation_space, walks.action_space, latent_features=1, hidden_features=8)
    >>> model.calibrate(walks)
    >>> ways = OfStyles([Fixed(np.array([-1.0])), Fixed(np.array([1.0]))], np.array([0, 1]))
    >>> nats = {}
    >>> train_policy(model, Lessons(walks, ways), num_steps=100, learning_rate=0.03, on_step=nats.__setitem__)
    >>> nats[1] < -1 and nats[100] > 1
    True
    """
    for name, number in (("num_steps", num_steps), ("batch_size", batch_size)):
        if number < 1:
            raise ValueError(f"{name} must be at least 1, got {number}")
    decoders = nn.ModuleList([model.policy_decoder, model.events])
    optimizer = torch.optim.AdamW(decoders.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True)
    demonstrations = lessons.demonstrations
    shares = None if model.bot_window is None else demonstrations.lengths / demonstrations.num_steps
    lengths = candidates(model.window, model.bot_window or 1)
    size = math.ceil(batch_size / (demonstrations.lengths.mean() if model.bot_window is None else _MOMENTS))
    best = None if held_out is None else _Best(model, decoders, held_out, seed)
    with seeded(seed, model.device), learning(decoders):
        for step in range(num_steps):
            sequence = np.random.SeedSequence((seed, step))
            reseed(sequence.generate_state(1, np.uint64).item(), model.device)
            random = np.random.default_rng(sequence)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate * 0.5 * (1 + math.cos(math.pi * step / num_steps))
            episodes = random.choice(len(demonstrations), size=size, p=shares)
            batch = batch_of(demonstrations, episodes, model.device)
            window = lengths[random.integers(len(lengths))] if random.random() < _LONGER else model.bot_window
            windows = drawn(batch, window, _MOMENTS)
            z = latent_of(model, lessons.latents.draw(episodes, random), size)
            actions, events = policy_terms(model, batch, z, windows)
            moments = windows.counted[0].bincount(minlength=size)
            nats = (actions + moments / batch.lengths * events).sum() / moments.sum()
            if not nats.isfinite():
                raise TrainingError(
                    f"step {step + 1} of the policy: the log-likelihood of an action is {nats.item()}. "
                    "Lower its learning rate, or look for extreme values in the demonstrations."
                )
            optimizer.zero_grad()
            (-nats).backward()
            optimizer.step()
            on_step(step + 1, nats.item())
            if best is not None and (step + 1) * _EVALUATIONS // num_steps > step * _EVALUATIONS // num_steps:
                best.consider()
    if best is not None:
        decoders.load_state_dict(best.weights)


def log_likelihoods(model: TrajectoryVAE, lessons: Lessons, *, seed: int = 0) -> FloatArray:
    """(E,) sum_t log pi(a_t | s_1:t, z) of each episode, in nats, as a bot sees it, at one z that it draws with `seed`.

    The law of which events occur is among it (`tvae.model.events`), as in the bound.
    """
    found = np.zeros(len(lessons.demonstrations))
    z = lessons.latents.draw(np.arange(len(found)), np.random.default_rng(seed))
    with inferring(model):
        for episodes in ordered_batches(lessons.demonstrations, _JUDGED_AT_ONCE):
            batch = batch_of(lessons.demonstrations, episodes, model.device)
            told = latent_of(model, z[episodes], len(episodes))
            nats = policy_log_likelihood(model, batch, told, policy_windows(model, batch))
            found[episodes] = nats.cpu().double().numpy()
    return found


class _Best:
    """The weights under which held-out actions were most likely, of those considered."""

    def __init__(self, model: TrajectoryVAE, decoders: nn.Module, held_out: Lessons, seed: int) -> None:
        self._model, self._decoders, self._held_out, self._seed = model, decoders, held_out, seed
        self._nats, self.weights = self._judged(), copy_of_weights(decoders)

    def consider(self) -> None:
        """Keep the present weights if they are better than those kept."""
        nats = self._judged()
        if nats > self._nats:
            self._nats, self.weights = nats, copy_of_weights(self._decoders)

    def _judged(self) -> float:
        nats = log_likelihoods(self._model, self._held_out, seed=self._seed)
        if not np.isfinite(nats).all():
            raise TrainingError(
                f"the log-likelihood of a held-out episode's actions is {nats[~np.isfinite(nats)][0]}: "
                "look for extreme values in the demonstrations."
            )
        return float(nats.mean())
