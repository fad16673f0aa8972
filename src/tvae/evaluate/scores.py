"""How likely a model finds every step of every episode, and which signal of it surprises.

At the posterior mean z of an episode, in nats (densities of standardised values and of radians):

    action_t = log pi(a_t | s_1:t, z)        the whole action, and each signal of it
    state_t  = log p(s_t+1 | s_1:t, z)       the whole next state, and each signal of it
    end_t    = log p(end_t | s_1:t, z)       0 for a model without the stop term
    event_n  = log p(E_n | z)                one for an episode: whether event n occurs in it (`tvae.model.events`)

The policy term of the bound is sum_t action_t + sum_n event_n, its state term sum_t state_t, its stop term sum_t
end_t. Decoders see the past in the windows in which they were trained, and the policy what a bot sees.

A signal's own term is its marginal, log p(x_c | s_1:t, z), with the other signals of the row summed out. Where a row
has one joint law its signals are independent and their terms add up to the row's. Where it has a mixture of K > 1 they
are tied to each other by the component, and the row's term is more than the sum of theirs by what one signal tells of
another, log p(x) - sum_c log p(x_c): a turn to the left may be as usual as a button, and both at once never seen.

A binary action that is an event has its term in a step given E: the hazard at which it comes where it comes, and 0 in
every step of an episode in which it never does. Whether it comes at all is told once, by `event_n`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from tvae.data.batches import TrajectoryBatch, batch_of, ordered_batches
from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import ranges
from tvae.data.sources import check_spaces
from tvae.model.elbo import Predicted, predicted_actions, predicted_states, used_events
from tvae.model.inference import inferring
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import Windows, policy_windows, state_windows
from tvae.spaces import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Scores:
    """Log-densities of N episodes with S steps together, in nats; steps of one episode after another."""

    lengths: IntArray
    """(N,) steps of each episode"""
    action: FloatArray
    """(S,) log pi(a_t | s_1:t, z) of whole actions"""
    action_signals: FloatArray
    """(S, A) the marginal of each signal"""
    state: FloatArray
    """(S,) log p(s_t+1 | s_1:t, z) of whole next states; NaN where the next state was not recorded"""
    observation_signals: FloatArray
    """(S, O) the marginal of each signal; NaN likewise"""
    end: FloatArray
    """(S,) log p(end_t | s_1:t, z)"""
    events: FloatArray
    """(N, number of events) log p(E_n | z)"""

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def steps(self) -> FloatArray:
        """(S,) all that a step is worth: action, next state where it was recorded, end."""
        return self.action + np.nan_to_num(self.state, nan=0.0) + self.end

    @property
    def signals(self) -> FloatArray:
        """(S, A + O + 1) the terms of single signals: actions, observations, end."""
        return np.concatenate([self.action_signals, self.observation_signals, self.end[:, None]], axis=1)

    @property
    def policy_term(self) -> FloatArray:
        """(N,) sum_t action_t + sum_n event_n, the policy term of the bound at the posterior mean."""
        return self._per_episode(self.action) + self.events.sum(1)

    @property
    def state_term(self) -> FloatArray:
        """(N,) sum_t state_t over recorded next states, the state term of the bound at the posterior mean."""
        return self._per_episode(np.nan_to_num(self.state, nan=0.0))

    @property
    def stop_term(self) -> FloatArray:
        """(N,) sum_t end_t, the stop term of the bound at the posterior mean."""
        return self._per_episode(self.end)

    @property
    def per_step(self) -> FloatArray:
        """(N,) log p(tau | s_1, z) / T: all terms of an episode, by its number of steps."""
        return (self.policy_term + self.state_term + self.stop_term) / self.lengths

    @property
    def starts(self) -> IntArray:
        """(N,) the first row of each episode."""
        return np.cumsum(self.lengths) - self.lengths

    def _per_episode(self, terms: FloatArray) -> FloatArray:
        episodes = np.repeat(np.arange(len(self)), self.lengths)
        return np.bincount(episodes, weights=terms, minlength=len(self)).astype(np.float64)


def score(
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    *,
    batch_size: int = 64,
    on_episodes: Callable[[int], None] = lambda done: None,
) -> Scores:
    """Score every step of every episode at its posterior mean, in the order of `demonstrations`, without dropout.

    `on_episodes` is told how many are done. Raises `DataError` for demonstrations of other signals than the model's.

    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Continuous, Space
    >>> x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> walks = [Trajectory(np.zeros((t + 1, 1)), np.ones((t, 1))) for t in (5, 3, 4)]
    >>> scores = score(TrajectoryVAE(x, dx), Demonstrations.from_trajectories(walks, x, dx))
    >>> scores.action.shape, scores.action_signals.shape, scores.per_step.shape
    ((12,), (12, 1), (3,))
    >>> bool(np.isclose(scores.policy_term[1], scores.action[5:8].sum()))  # the second walk; it has no events
    True
    """
    check_spaces(demonstrations, model.observation_space, model.action_space)
    lengths = np.array(demonstrations.lengths)
    starts, total = np.cumsum(lengths) - lengths, int(lengths.sum())
    action, state, end = np.empty(total), np.empty(total), np.empty(total)
    action_signals = np.empty((total, model.action_space.num_columns))
    observation_signals = np.empty((total, model.observation_space.num_columns))
    events, finished = np.empty((len(lengths), model.events.num_events)), 0
    with inferring(model):
        for episodes in ordered_batches(demonstrations, batch_size):
            batch = batch_of(demonstrations, episodes, model.device)
            z = model.posterior(batch).mean
            rows = ranges(starts[episodes], lengths[episodes])
            at = policy_windows(model, batch)
            actions = predicted_actions(model, batch, z, at)
            action[rows], action_signals[rows] = _terms(actions, at, batch)
            at = state_windows(model, batch)
            states = predicted_states(model, batch, z, at)
            state[rows], observation_signals[rows] = _terms(states.following, at, batch)
            end[rows] = _steps(states.ends[:, None], at, batch)[:, 0]
            occurrence = model.events.occurrence(z).log_prob_by_column(used_events(model, batch).to(z.dtype))
            events[episodes] = occurrence.cpu().double().numpy()
            finished += len(episodes)
            on_episodes(finished)
    return Scores(lengths, action, action_signals, state, observation_signals, end, events)


def _terms(predicted: Predicted, windows: Windows, batch: TrajectoryBatch) -> tuple[FloatArray, FloatArray]:
    """The term of each row of a batch, (steps,), and of each of its signals, (steps, C)."""
    terms = torch.column_stack(
        [predicted.law.log_prob(predicted.values), predicted.law.log_prob_by_column(predicted.values)]
    )
    found = _steps(terms.masked_fill(~predicted.known[:, None], torch.nan), windows, batch)
    return found[:, 0], found[:, 1:]


def _steps(terms: Float[Tensor, "N C"], windows: Windows, batch: TrajectoryBatch) -> FloatArray:
    """(steps of the batch, C) one trajectory after another."""
    placed = terms.new_empty((*batch.actions.shape[:2], terms.shape[-1]))
    placed[windows.counted] = terms
    result: FloatArray = placed[batch.mask].cpu().double().numpy()
    return result


def share_as_unlikely(values: FloatArray, reference: FloatArray) -> FloatArray:
    """p = (1 + #{reference <= value}) / (1 + #reference) of each value (n,), against a reference (m,).

    If a value came from where the reference came from, p would be at most q with a probability of at most q: a small p
    says that it came from elsewhere.

    >>> share_as_unlikely(np.array([-9.0, 0.0, 9.0]), np.array([-1.0, 0.0, 1.0])).tolist()
    [0.25, 0.75, 1.0]
    """
    below = np.searchsorted(np.sort(reference), values, side="right")
    shares: FloatArray = (1 + below) / (1 + len(reference))
    return shares
