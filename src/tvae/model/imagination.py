"""Both decoders together, each on what the other gives: imagined trajectories, step by step.

    a_t ~ pi(. | s_1:t, z),    s_t+1 ~ p(. | s_1:t, z)  (given a_1:t too, for a model with `dynamics`)
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.distributions import Bernoulli

from tvae.distributions import Columns, Joint
from tvae.model.decoding import Choice, EventMemory, Recurrence, narrower
from tvae.model.tvae import TrajectoryVAE


@dataclass(frozen=True, eq=False)
class Imagined:
    """One step of each of N imagined trajectories."""

    actions: Float[Tensor, "N A"]
    """What the policy decoder does; standardised."""
    following: Float[Tensor, "N O"]
    """The next state that the state decoder gives; standardised, angles within [-pi, pi)."""
    ends: Bool[Tensor, " N"]
    """Whether the episode ends with this step; never, for a model without the stop term."""


class Imagination:
    """N trajectories that begin wherever `step` is first told, each with a z of its own.

    Without a `window` either decoder sees as much of the past as it was trained for, the policy its `bot_window`.

    >>> from tvae.model.decoding import most_likely
    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)))
    >>> with torch.no_grad():
    ...     Imagination(model, torch.zeros(3, 2), most_likely).step(torch.zeros(3, 1)).following.shape
    torch.Size([3, 1])
    """

    def __init__(
        self, model: TrajectoryVAE, z: Float[Tensor, "N Z"], choice: Choice, *, window: int | None = None
    ) -> None:
        self._model = model
        self._choice = choice
        seen = model.bot_window if window is None else narrower(model.window, window)
        self._state_memory = Recurrence(model.state_decoder.trunk, z, narrower(model.window, window))
        self._policy_memory = Recurrence(model.policy_decoder.trunk, z, seen)
        self._events = EventMemory(model, z, choice)
        self._num_steps = 0

    def step(self, values: Float[Tensor, "N O"]) -> Imagined:
        """What follows the present states, standardised rows; `ValueError` where that is no finite number."""
        self._num_steps += 1
        model, normalizer = self._model, self._model.observation_normalizer
        features = normalizer.features(values)
        inputs = model.policy_decoder_inputs(normalizer.raw(values), self._events.done)
        law = self._events.law(model.policy_decoder.law(self._policy_memory.step(inputs)))
        actions = self._choice(law)
        self._events.note(law, actions)
        remembered = self._state_memory.step(model.state_decoder_inputs(features, actions))
        following = self._choice(model.state_decoder.head(remembered, values))
        if not following.isfinite().all():
            raise ValueError(f"imagined states grow beyond all numbers at step {self._num_steps}; imagine fewer steps")
        angular = model.observation_space.angular
        following[:, angular] = torch.remainder(following[:, angular] + torch.pi, 2 * torch.pi) - torch.pi
        return Imagined(actions, following, self._ends(remembered))

    def _ends(self, remembered: Float[Tensor, "N H"]) -> Bool[Tensor, " N"]:
        if not self._model.stop:
            return torch.zeros(len(remembered), dtype=torch.bool, device=remembered.device)
        column = torch.zeros(1, dtype=torch.int64, device=remembered.device)
        log_odds = self._model.state_decoder.stop(remembered)
        law = Joint(1, (Columns(column, Bernoulli(logits=log_odds, validate_args=False)),))
        return self._choice(law)[:, 0] > 0
