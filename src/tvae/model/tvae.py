"""The Trajectory VAE: an encoder, a prior, a state decoder and a policy decoder over one latent z."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.distributions import Normal

from tvae.data.batches import TrajectoryBatch
from tvae.data.demonstrations import Demonstrations
from tvae.data.normalizer import Normalizer
from tvae.model.arguments import counted
from tvae.model.calibration import some_rows, typical_changes
from tvae.model.decoders import PolicyDecoder, StateDecoder
from tvae.model.encoder import Encoder, NoEncoder
from tvae.model.events import Events
from tvae.model.latent import GaussianMixture, Prior, StandardNormal
from tvae.model.perception import NoPerception, Perception
from tvae.model.ranks import Ranks
from tvae.model.saving import Saved
from tvae.model.schema import SCHEMA_VERSION
from tvae.model.trunks import PlainTrunk, ReactiveTrunk
from tvae.spaces import Space


class TrajectoryVAE(Saved):
    """One latent z for a whole state-action trajectory, and two decoders that read it.

    | law                       | module           |
    |---------------------------|------------------|
    | q(z given tau)            | `encoder`        |
    | p(z)                      | `prior`          |
    | p(s_t+1 given s_1:t, z)   | `state_decoder`  |
    | pi(a_t given s_1:t, z)    | `policy_decoder`, and `events` for binary actions |

    The constructor's arguments are plain data; a saved model holds them and nothing else beside its weights.

    Args:
        observation_space, action_space: what rows are made of.
        latent_features: Z; 0 gives the same model without a latent.
        hidden_features: H of every recurrent net.
        policy_features: H of the policy decoder, where it is to be another.
        dropout: probability with which a feature inside a network is dropped in training.
        window: the most past states that a decoder sees; None for all of them.
        stop: whether the end of an episode is modelled, p(end_t | s_1:t, z).
        action_components: K > 1 gives actions a mixture of K laws.
        state_components: K > 1 gives next states a mixture of K laws, for worlds that mostly rest and then leap.
        prior_components: K > 1 gives z a learned mixture of K Gaussians as its prior.
        state_floor: smallest standard deviation of a next state, in typical one-step changes.
        action_floor: smallest standard deviation of an action, in its own standard deviations (angles: radians).
        encode_actions: whether the encoder reads the actions; without them it is q(z | s_1:T).
        reactive: whether the decoders' heads see the present state and its last change beside what the LSTM
            remembers (`ReactiveTrunk`), and the policy's proportions and relative directions too (`Perception`);
            without it they see the LSTM's output alone, as in the paper (`PlainTrunk`).
        events: whether binary actions are sparse events (`tvae.model.events`); without it they are a Bernoulli in
            every step.
        horizon: how many steps ahead the state decoder says where things are, beside the next; 1 for the next alone.
        dynamics: whether the state decoder reads the actions, p(s_t+1 | s_1:t, a_1:t, z), and says what an action
            leads to; without them it says what happens for that z, whatever is done.

    Raises `ValueError` for a number that cannot be; NumPy's are kept as Python's.

    >>> from tvae.spaces import Angular, Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"), Continuous("y"))), Space((Angular("heading"),)))
    >>> sum(p.numel() for p in model.parameters()) > 10_000
    True
    """

    prior: Prior
    _bot_window: Tensor

    def __init__(
        self,
        observation_space: Space,
        action_space: Space,
        *,
        latent_features: int = 2,
        hidden_features: int = 64,
        policy_features: int | None = None,
        dropout: float = 0.0,
        window: int | None = None,
        stop: bool = True,
        action_components: int = 1,
        state_components: int = 1,
        prior_components: int = 1,
        state_floor: float = 0.1,
        action_floor: float = 0.02,
        encode_actions: bool = True,
        reactive: bool = True,
        horizon: int = 1,
        dynamics: bool = False,
        events: bool = True,
    ) -> None:
        super().__init__()
        latent_features = counted("latent_features", latent_features, 0)
        hidden_features = counted("hidden_features", hidden_features)
        policy_features = None if policy_features is None else counted("policy_features", policy_features)
        window = None if window is None else counted("window", window, unit=" step")
        action_components = counted("action_components", action_components)
        state_components = counted("state_components", state_components)
        prior_components = counted("prior_components", prior_components)
        horizon = counted("horizon", horizon, unit=" step")
        stop, encode_actions, reactive, dynamics, events = map(bool, (stop, encode_actions, reactive, dynamics, events))
        dropout, state_floor, action_floor = map(float, (dropout, state_floor, action_floor))
        self.observation_space = observation_space
        self.action_space = action_space
        self.latent_features = latent_features
        self.window = window
        self.stop = stop
        self.encode_actions = encode_actions
        self.dynamics = dynamics
        self.arguments = {
            "latent_features": latent_features,
            "hidden_features": hidden_features,
            "policy_features": policy_features,
            "dropout": dropout,
            "window": window,
            "stop": stop,
            "action_components": action_components,
            "state_components": state_components,
            "prior_components": prior_components,
            "state_floor": state_floor,
            "action_floor": action_floor,
            "encode_actions": encode_actions,
            "reactive": reactive,
            "horizon": horizon,
            "dynamics": dynamics,
            "events": events,
        }
        self.register_buffer("_bot_window", torch.tensor(0 if window is None else window))
        self.observation_normalizer = Normalizer(observation_space)
        self.action_normalizer = Normalizer(action_space)
        states, actions = observation_space.num_features, action_space.num_features
        self.ranks = Ranks(observation_space)
        self.encoder = (
            Encoder(
                states + self.ranks.num_features + (actions if encode_actions else 0),
                latent_features,
                hidden_features,
                dropout,
                summary_features=self.ranks.num_areas,
            )
            if latent_features
            else NoEncoder()
        )
        self.prior = (
            StandardNormal(latent_features)
            if prior_components == 1 or latent_features == 0
            else GaussianMixture(latent_features, prior_components)
        )
        no_columns = np.zeros(0, dtype=np.int64)
        self.events = Events(action_space.binary if events else no_columns, latent_features, hidden_features // 2)
        self.perception = Perception(observation_space) if reactive else NoPerception()
        trunk = ReactiveTrunk if reactive else PlainTrunk
        policy_trunk = partial(ReactiveTrunk, num_done=self.events.num_events) if reactive else PlainTrunk
        self.state_decoder = StateDecoder(
            observation_space,
            trunk(states + (actions if dynamics else 0), latent_features, hidden_features, dropout),
            floor=state_floor,
            stop=stop,
            num_components=state_components,
            horizon=horizon,
        )
        self.policy_decoder = PolicyDecoder(
            action_space,
            policy_trunk(
                states + self.perception.num_features + self.events.num_events,
                latent_features,
                hidden_features if policy_features is None else policy_features,
                dropout,
            ),
            floor=action_floor,
            num_components=action_components,
        )

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return self.observation_normalizer.mean.device

    @property
    def bot_window(self) -> int | None:
        """The past states that the policy needs (`tvae.train.memory`), at most `window`; None for all of them."""
        return int(self._bot_window) or None

    @bot_window.setter
    def bot_window(self, window: int | None) -> None:
        self._bot_window.fill_(0 if window is None else window)

    def calibrate(self, demonstrations: Demonstrations) -> None:
        """Fit what is measured rather than learned, on training data only: normalisers and typical changes.

        Of more than a million steps, those of evenly spaced episodes are used.
        """
        observations, actions = some_rows(demonstrations)
        for normalizer, rows in ((self.observation_normalizer, observations), (self.action_normalizer, actions)):
            normalizer.load_state_dict(Normalizer.fit(normalizer.space, rows).state_dict())
        self.perception.fit(observations)
        self.ranks.fit(demonstrations)
        of_values, of_features = typical_changes(self.observation_normalizer, demonstrations)
        self.state_decoder.head.unit.copy_(of_values)
        if self.state_decoder.ahead is not None:
            further, _ = typical_changes(self.observation_normalizer, demonstrations, self.state_decoder.horizon)
            self.state_decoder.ahead.unit.copy_(further)
        for decoder in (self.state_decoder, self.policy_decoder):
            decoder.trunk.unit[: len(of_features)].copy_(of_features)

    def posterior(self, batch: TrajectoryBatch) -> Normal:
        """q(z | tau) of each trajectory of the batch, batch shape (B, Z)."""
        return self.encoder(*self.encoder_inputs(batch))

    def encoder_inputs(
        self, batch: TrajectoryBatch
    ) -> tuple[Float[Tensor, "B T F"], Int[Tensor, " B"], Float[Tensor, "B S"] | None]:
        """What the encoder reads: features of states, ranks and actions at each step, lengths, areas."""
        read = [self.observation_normalizer.features(self.observation_normalizer.values(batch.observations))]
        areas = None
        if self.ranks.num_features:
            read.append(self.ranks(batch.observations))
            areas = self.ranks.areas(read[-1], batch.mask)
        if self.encode_actions:
            read.append(self.action_normalizer.features(self.action_normalizer.values(batch.actions)))
        return torch.cat(read, dim=-1), batch.lengths, areas

    def policy_decoder_inputs(
        self, observations: Float[Tensor, "*batch O"], done: Float[Tensor, "*batch N"]
    ) -> Float[Tensor, "*batch F"]:
        """What the policy decoder reads at each step: the state's features, what is perceived beside, events done.

        `observations` are raw rows.
        """
        observations = self.perception.within(observations)
        states = self.observation_normalizer.features(self.observation_normalizer.values(observations))
        return torch.cat([states, self.perception(observations), done], dim=-1)

    def state_decoder_inputs(
        self, states: Float[Tensor, "*batch S"], actions: Float[Tensor, "*batch A"]
    ) -> Float[Tensor, "*batch F"]:
        """What the state decoder reads at each step: the features `states`, with `dynamics` the action's beside them.

        `actions` are standardised rows.
        """
        return torch.cat([states, self.action_normalizer.features(actions)], dim=-1) if self.dynamics else states

    def description(self) -> dict[str, Any]:
        """All but the weights, as plain data: format, schema version, spaces, constructor arguments."""
        return {
            "format": "tvae-model",
            "schema_version": SCHEMA_VERSION,
            "observation_space": self.observation_space.to_json(),
            "action_space": self.action_space.to_json(),
            "arguments": self.arguments,
        }
