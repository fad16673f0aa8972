"""Behavior Transformer: which of K bins of actions comes next, and how far the action is off its middle.

Source: Shafiullah, Cui, Altanzaya, Pinto, "Behavior transformers: Cloning k modes with one stone" (NeurIPS 2022, arXiv
2206.11251). K-means of the demonstrated actions gives middles m_1 .. m_K. A causal transformer over the last h
observations gives weights p and an offset o_k for every bin. With k the bin of the demonstrated action a,

    L = - (1 - p_k)^gamma log p_k + offset_weight || a - (m_k + o_k) ||^2,  at each step that is seen.

Acting: k is drawn from p, and m_k + o_k is done. The bin is drawn anew in each step: no style can be asked for, and one
persists only as far as the last h observations show it. Actions are carried as numbers, an angle as (cos, sin)
(`tvae.baselines.stretching`). Deviations: an observation is seen with its last change, as by the other baselines; the
mean squared offset is of all features of an action; weights are chosen on held-out demonstrations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from sklearn.cluster import KMeans
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from tvae.baselines.chunks import ChunkData
from tvae.baselines.contract import Bots, Lesson
from tvae.baselines.descending import CPU, Descent, num_parameters
from tvae.baselines.policies import held_apart
from tvae.baselines.senses import Senses
from tvae.baselines.stretching import Stretched
from tvae.data.demonstrations import Demonstrations
from tvae.device import seeded
from tvae.spaces import FloatArray, IntArray

_MOST_ROWS = 20_000
"""Actions that k-means is shown."""


@dataclass(frozen=True, eq=False)
class Window:
    """B stretches of h steps each."""

    inputs: Float[Tensor, "B H X"]
    """x_t, the features of an observation with their last change."""
    actions: Float[Tensor, "B H A"]
    """Values of a_t."""
    valid: Bool[Tensor, "B H"]
    """Which steps there are: an episode may be shorter."""


class WindowData:
    """All windows of some demonstrations; of an episode that is shorter than a window there is one.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> demonstrations = zombie_demonstrations(2)
    >>> data = WindowData(demonstrations, Senses.fit(demonstrations), num_seen=4)
    >>> len(data) == int((demonstrations.lengths - 3).sum()), data.at(np.array([0])).actions.shape
    (True, torch.Size([1, 4, 2]))
    """

    def __init__(self, demonstrations: Demonstrations, senses: Senses, *, num_seen: int) -> None:
        lengths = demonstrations.lengths
        steps = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        self._left = np.repeat(lengths, lengths) - steps
        self._starts = np.flatnonzero((self._left >= num_seen) | (steps == 0))
        moments = ChunkData(demonstrations, senses, num_actions=1)
        every = moments.at(np.arange(len(moments)))
        self._inputs = every.inputs
        self.actions: Float[Tensor, "N A"] = every.actions[:, 0]
        """Values of all actions."""
        self._ahead = np.arange(num_seen)

    def __len__(self) -> int:
        return len(self._starts)

    def at(self, windows: IntArray) -> Window:
        """The windows at these positions."""
        starts = self._starts[windows, None]
        left = self._left[starts]
        index = starts + np.minimum(self._ahead, left - 1)
        return Window(self._inputs[index], self.actions[index], torch.from_numpy(self._ahead < left))

    def drawn(self, count: int) -> Window:
        """Windows at random, by torch's generator."""
        return self.at(torch.randint(len(self), (count,)).numpy())


def middles(actions: Float[Tensor, "N F"], num_bins: int, seed: int) -> Float[Tensor, "K F"]:
    """Middles of the K bins of actions, by k-means; fewer where there are fewer different actions.

    >>> middles(torch.tensor([[0.0], [0.0], [1.0]]), 8, seed=0).sort(0).values.flatten().tolist()
    [0.0, 1.0]
    """
    order = np.random.default_rng(seed).permutation(len(actions))[:_MOST_ROWS]
    rows = actions[order].double().numpy()
    count = min(num_bins, len(np.unique(rows, axis=0)))
    with threadpool_limits(1):  # the order of sums is then always the same
        found = KMeans(count, n_init=4, random_state=seed).fit(rows)
    return torch.from_numpy(found.cluster_centers_).float()


class BinTransformer(nn.Module):
    """p(bin | x_t-h+1:t) and the offset of each bin."""

    bins: Tensor
    """(K, F) middles."""

    def __init__(
        self,
        senses: Senses,
        stretched: Stretched,
        bins: Float[Tensor, "K F"],
        *,
        num_seen: int,
        hidden_features: int,
        num_layers: int,
        num_heads: int,
        dropout: float,
    ) -> None:
        super().__init__()
        self.senses, self.stretched = senses, stretched
        self.num_seen = num_seen
        self.register_buffer("bins", bins)
        self.embedding = nn.Linear(2 * senses.num_features, hidden_features)
        self.place = nn.Parameter(0.02 * torch.randn(num_seen, hidden_features))
        layer = nn.TransformerEncoderLayer(
            hidden_features,
            num_heads,
            4 * hidden_features,
            dropout,
            activation="gelu",
            batch_first=True,
            norm_first=True,
        )
        self.transformer = nn.TransformerEncoder(
            layer, num_layers, norm=nn.LayerNorm(hidden_features), enable_nested_tensor=False
        )
        self.weights = nn.Linear(hidden_features, len(bins))
        self.offsets = nn.Linear(hidden_features, bins.numel())

    def forward(self, inputs: Float[Tensor, "B H X"]) -> tuple[Float[Tensor, "B H K"], Float[Tensor, "B H K F"]]:
        """Logits of the bins and their offsets at each step, which sees the steps before it."""
        length = inputs.shape[1]
        later = torch.ones(length, length, dtype=torch.bool, device=inputs.device).triu(1)
        seen = self.embedding(inputs) + self.place[:length]
        features = self.transformer(seen, mask=later, is_causal=True)
        return self.weights(features), self.offsets(features).unflatten(-1, tuple(self.bins.shape))

    def nearest(self, targets: Float[Tensor, "*batch F"]) -> Int[Tensor, "*batch"]:
        """The bin of each stretched action."""
        return torch.cdist(targets.flatten(0, -2), self.bins).argmin(-1).reshape(targets.shape[:-1])

    def loss(self, window: Window, focus: float, offset_weight: float) -> Float[Tensor, ""]:
        """L, the mean over steps; gamma is `focus`."""
        targets = self.stretched(window.actions)
        which = self.nearest(targets)
        logits, offsets = self(window.inputs)
        told = logits.log_softmax(-1).gather(-1, which[..., None])[..., 0]
        focal = -(1 - told.exp()).clamp_min(1e-6).pow(focus) * told
        own = offsets.gather(-2, which[..., None, None].expand(*which.shape, 1, offsets.shape[-1]))[..., 0, :]
        off = (targets - self.bins[which] - own).square().mean(-1)
        return ((focal + offset_weight * off) * window.valid).sum() / window.valid.sum()

    def sample(self, inputs: Float[Tensor, "N H X"]) -> Float[Tensor, "N A"]:
        """Values of an action at the last step: a bin at random, with its offset."""
        logits, offsets = self(inputs)
        which = torch.multinomial(logits[:, -1].softmax(-1), 1)[:, 0]
        return self.stretched.values(self.bins[which] + offsets[torch.arange(len(which)), -1, which])


class WindowPolicy:
    """A `Policy`: the transformer sees the last h observations of each episode."""

    def __init__(self, network: BinTransformer) -> None:
        self.network = network

    def reset(self, num_episodes: int, seed: int) -> None:
        """Begin `num_episodes` new episodes."""
        self._random = np.random.default_rng(seed)
        self._last: Tensor | None = None
        self._seen: list[Tensor] = []

    @torch.inference_mode()
    def act(self, observations: FloatArray) -> FloatArray:
        """(N, A) actions."""
        senses = self.network.senses
        features = senses(torch.from_numpy(observations).float())
        changes = senses.changes(features, features if self._last is None else self._last)
        self._last = features
        self._seen = [*self._seen, torch.cat([features, changes], dim=-1)][-self.network.num_seen :]
        with seeded(int(self._random.integers(2**62)), CPU):
            values = self.network.sample(torch.stack(self._seen, dim=1))
        return senses.actions.raw(values).double().numpy()


@dataclass(frozen=True)
class BehaviorTransformer:
    """BeT."""

    num_bins: int = 32
    """K"""
    num_seen: int = 10
    """h"""
    focus: float = 2.0
    """gamma"""
    offset_weight: float = 10.0
    hidden_features: int = 64
    num_layers: int = 2
    num_heads: int = 4
    dropout: float = 0.1
    batch_size: int = 64
    """Windows in a gradient step."""
    num_steps: int = 4_000
    learning_rate: float = 1e-3

    def learn(self, lesson: Lesson) -> Bots:
        """One bot, without a style to be asked for."""
        senses = Senses.fit(lesson.demonstrations)
        stretched = Stretched.fit(lesson.demonstrations, senses)
        training, judged = (
            WindowData(lesson.demonstrations.select(part), senses, num_seen=self.num_seen)
            for part in held_apart(lesson.demonstrations, 0.1, lesson.seed)
        )
        bins = middles(stretched(training.actions), self.num_bins, lesson.seed)
        with seeded(lesson.seed, CPU):
            network = BinTransformer(
                senses,
                stretched,
                bins,
                num_seen=self.num_seen,
                hidden_features=self.hidden_features,
                num_layers=self.num_layers,
                num_heads=self.num_heads,
                dropout=self.dropout,
            )
        with seeded(lesson.seed, CPU):
            some = judged.drawn(min(len(judged), 2_000))
        descent = Descent(lesson.limited(self.num_steps), self.learning_rate)
        descent.run(
            network,
            lambda step: network.loss(training.drawn(self.batch_size), self.focus, self.offset_weight),
            seed=lesson.seed,
            judge=lambda: float(network.loss(some, self.focus, self.offset_weight)),
        )
        facts = {"gradient_steps": descent.num_steps, "num_parameters": num_parameters(network), "bins": len(bins)}
        return Bots(WindowPolicy(network), facts=facts)
