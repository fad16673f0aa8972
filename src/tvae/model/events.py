"""Sparse events: a binary action that is due at one moment, and only in some styles.

An attack, a jump, a button press: a binary action is taken for an event. With E = 1 where it occurs anywhere in the
trajectory, and D_t = 1 where it has occurred before step t,

    p(e_1:T | s_1:T, z) = p(E | z) prod_t p(e_t | s_1:t, D_t, E, z),        p(e_t = 1 | E = 0) = 0.

- `p(E | z)` says whether a style uses the event at all. A Bernoulli in every step cannot: a bot of a style that never
  attacks meets states which that style never met, and there the probability is whatever the other styles left behind.
- `p(e_t = 1 | D_t, E = 1)` is a hazard, the rate at which what has not happened yet happens now. A policy that sees
  D_t knows what it did without having to read it off what the world did in return.

When a bot acts, E is drawn once for an episode, and D becomes 1 as soon as the event has occurred at a moment at which
it was due with a probability of at least `SURE`, which the hazards of those moments tell: an event at a moment at which
it was hardly due may have missed, and is tried again.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.distributions import Bernoulli

from tvae.distributions import Columns, Joint, Mixture, RowDistribution
from tvae.spaces import IntArray

SURE = 0.9
"""Probability of having occurred when it was due from which on an event of a bot counts as done."""
NEVER = -60.0
"""Log-odds of an event that cannot occur; finite, so that its log-probability is."""


class Events(nn.Module):
    """What a model knows about the N events among its actions, at these `columns`; there may be none.

    >>> from tvae.spaces import Angular, Binary, Space
    >>> space = Space((Angular("heading"), Binary("attack")))
    >>> events = Events(space.binary, latent_features=2, hidden_features=8)
    >>> actions = torch.tensor([[[0.3, 0.0], [0.1, 1.0], [0.2, 0.0]]])
    >>> events.done(actions).flatten().tolist(), events.used(actions).tolist()
    ([0.0, 0.0, 1.0], [[True]])
    >>> events.occurrence(torch.zeros(5, 2)).sample().shape
    torch.Size([5, 1])
    """

    columns: Tensor

    def __init__(self, columns: IntArray, latent_features: int, hidden_features: int) -> None:
        super().__init__()
        self.num_events = len(columns)
        self.register_buffer("columns", torch.from_numpy(columns), persistent=False)
        self.share = nn.Parameter(torch.zeros(self.num_events)) if self.num_events else None
        self.by_style = (
            nn.Sequential(
                nn.Linear(latent_features, hidden_features), nn.SiLU(), nn.Linear(hidden_features, self.num_events)
            )
            if latent_features and self.num_events
            else None
        )

    def of(self, actions: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch N"]:
        """e_t: the events among the actions."""
        return actions.index_select(-1, self.columns)

    def done(self, actions: Float[Tensor, "B T A"]) -> Float[Tensor, "B T N"]:
        """D_t: 1 where an event has occurred before a step."""
        occurred = self.of(actions).cumsum(1).clamp(max=1)
        return torch.cat([torch.zeros_like(occurred[:, :1]), occurred[:, :-1]], dim=1)

    def used(self, actions: Float[Tensor, "B T A"]) -> Bool[Tensor, "B N"]:
        """E: whether an event occurs in a trajectory."""
        return self.of(actions).amax(1) > 0.5

    def occurrence(self, z: Float[Tensor, "B Z"]) -> Joint:
        """p(E | z), a law of rows (B, N)."""
        columns = torch.arange(self.num_events, device=z.device)
        return Joint(self.num_events, (Columns(columns, self._occurrence(z)),))

    def probability(self, z: Float[Tensor, "B Z"]) -> Float[Tensor, "B N"]:
        """p(E = 1 | z) of each event."""
        probability: Tensor = self._occurrence(z).probs
        return probability

    def log_prob(self, z: Float[Tensor, "B Z"], used: Bool[Tensor, "B N"]) -> Float[Tensor, " B"]:
        """log p(E | z), in nats."""
        return self._occurrence(z).log_prob(used.to(z.dtype)).sum(-1)

    def _occurrence(self, z: Tensor) -> Bernoulli:
        log_odds = z.new_zeros(z.shape[0], 0) if self.share is None else self.share.expand(z.shape[0], -1)
        if self.by_style is not None:
            log_odds = log_odds + self.by_style(z)
        return Bernoulli(logits=log_odds, validate_args=False)

    def given(self, law: RowDistribution, used: Bool[Tensor, "*batch N"]) -> RowDistribution:
        """A law of actions once it is known which events occur in the episode: the others have probability 0."""
        if self.num_events == 0:
            return law
        match law:
            case Joint():
                return _only_where(used, law)
            case Mixture():
                return Mixture(law.weights, _only_where(used.unsqueeze(-2), law.components))
            case _:
                raise TypeError(f"events need a joint law or a mixture of them, got {type(law).__name__}")

    def hazard(self, law: RowDistribution) -> Float[Tensor, "*batch N"]:
        """The probability of each event under a law of actions."""
        match law:
            case Joint():
                return _probability(law)
            case Mixture():
                return (law.weights.probs.unsqueeze(-1) * _probability(law.components)).sum(-2)
            case _:
                raise TypeError(f"events need a joint law or a mixture of them, got {type(law).__name__}")


def _only_where(used: Bool[Tensor, "*batch N"], law: Joint) -> Joint:
    parts = []
    for part in law.parts:
        if isinstance(part.law, Bernoulli):
            log_odds = torch.where(used, part.law.logits, torch.full_like(part.law.logits, NEVER))
            parts.append(Columns(part.columns, Bernoulli(logits=log_odds, validate_args=False)))
        else:
            parts.append(part)
    return Joint(law.num_columns, tuple(parts))


def _probability(law: Joint) -> Tensor:
    return next(part.law.probs for part in law.parts if isinstance(part.law, Bernoulli))
