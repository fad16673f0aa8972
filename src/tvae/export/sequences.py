"""The encoder and the state decoder, over whole sequences of any length."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from tvae.data.batches import TrajectoryBatch
from tvae.export.arranged import Arranged
from tvae.export.heads import choice, law_of
from tvae.export.laws import choose, law_ports, law_tensors, noise_names
from tvae.export.layers import areas_of, changes_of_ranks, features, linear, over_time, values
from tvae.export.ports import BATCH, TIME, Graph, Port
from tvae.export.recurrence import read
from tvae.export.sheet import Value, as_rows
from tvae.export.uniform import numbers_of
from tvae.model.encoder import LOG_VARIANCE_RANGE, Encoder
from tvae.model.tvae import TrajectoryVAE

END = "end"


def _sequence(name: str, columns: int, meaning: str) -> Port:
    return Port(name, (BATCH, TIME, columns), meaning)


class EncoderGraph(Graph):
    """q(z | tau) = N(mean, diag deviation^2) of whole trajectories.

    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)), encode_actions=False).eval()
    >>> [port.name for port in EncoderGraph(model).inputs]
    ['observations', 'lengths']
    """

    name = "encoder"

    def __init__(self, model: TrajectoryVAE) -> None:
        super().__init__()
        self.model = model
        states, actions = model.observation_space.num_columns, model.action_space.num_columns
        observed = "the states that were acted on, in raw units; anything valid behind a trajectory's end"
        self.inputs = (
            _sequence("observations", states, observed),
            *([_sequence("actions", actions, "what was done there, in raw units")] if model.encode_actions else []),
            Port("lengths", (BATCH,), "number of steps of each trajectory, from 1 to time", dtype="int64"),
        )
        shape = (BATCH, model.latent_features)
        self.outputs = (
            Port("mean", shape, "mean of z given the trajectory"),
            Port("deviation", shape, "standard deviation of each z given the trajectory"),
        )

    def compute(self, given: dict[str, Tensor]) -> dict[str, Tensor]:
        """The parameters of the posterior."""
        observations, lengths = given["observations"], given["lengths"]
        known = torch.zeros(observations.shape[:2], dtype=torch.bool, device=observations.device)
        actions = given.get("actions", observations[..., :0])
        posterior = self.model.posterior(TrajectoryBatch(observations, observations, actions, lengths, known))
        return {"mean": posterior.loc, "deviation": posterior.scale}

    def write(self, given: dict[str, Value]) -> dict[str, Value]:
        """The parameters of the posterior."""
        model, lengths = self.model, given["lengths"]
        assert isinstance(model.encoder, Encoder)
        sheet, net = lengths.sheet, model.encoder.recurrent
        normalizers = {"observations": model.observation_normalizer, "actions": model.action_normalizer}
        read = [features(law, values(law, given[name])) for name, law in normalizers.items() if name in given]
        time = sheet.node("Shape", given["observations"], start=1, end=2).squeeze(0)
        step = sheet.node("Range", np.array(0), time, np.array(1))
        ranks = changes_of_ranks(model.ranks, given["observations"], step) if model.ranks.num_features else None
        rows = sheet.join([read[0], *([] if ranks is None else ranks), *read[1:]])
        left = lengths.unsqueeze(1) - step  # steps that are left, (B, T)
        inside = left.above(np.array(0))
        index = sheet.where(inside, left - np.array(1), step).unsqueeze(-1)
        backwards = sheet.node("GatherElements", rows, sheet.node("Expand", index, sheet.node("Shape", rows)), axis=1)
        share = (inside.number() / lengths.unsqueeze(1).number()).unsqueeze(-1)
        pooled = [(over_time(net.forwards, rows) * share).sum(1), (over_time(net.backwards, backwards) * share).sum(1)]
        law = linear(model.encoder.parameters_of_law, sheet.join(pooled))
        if ranks is not None and model.encoder.of_summary is not None:
            areas = (areas_of(model.ranks, *ranks) * share).sum(1) / model.ranks.area_unit
            law = law + sheet.node("MatMul", areas, as_rows(model.encoder.of_summary.weight).T)
        mean, log_variance = sheet.nodes_of("Split", [law, np.array([model.latent_features] * 2)], 2, axis=-1)
        low, high = LOG_VARIANCE_RANGE
        clamped = sheet.node("Clip", log_variance, low, high)
        return {"mean": mean, "deviation": (clamped * 0.5).apply("Exp")}


class StateDecoderGraph(Graph):
    """p(s_t+1 | s_1:t, z) at every step of a sequence; with `dynamics`, p(s_t+1 | s_1:t, a_1:t, z).

    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),))).eval()
    >>> [port.name for port in StateDecoderGraph(model).outputs]
    ['next_observations', 'mean', 'deviation', 'end', 'end_probability']
    """

    name = "state_decoder"

    def __init__(self, model: TrajectoryVAE) -> None:
        super().__init__()
        self.model = model
        space, components = model.observation_space, model.state_decoder.head.num_components
        actions = model.action_space.num_columns
        self.noise = (*noise_names(space, components), *([END] if model.stop else []))
        """What each column of the input `noise` decides."""
        latent = Port("z", (BATCH, model.latent_features), "the style, one for each sequence")
        self.inputs = (
            _sequence("observations", space.num_columns, "states so far, in raw units"),
            *([_sequence("actions", actions, "what was done in them, in raw units")] if model.dynamics else []),
            *([latent] if model.latent_features else []),
            _sequence("noise", len(self.noise), "uniform random numbers in [0, 1)"),
            Port("most_likely", (1,), "0 draws the next states by the noise, 1 takes the most likely ones"),
        )
        ends = (
            Port(END, (BATCH, TIME), "1 where the episode ends with this step"),
            Port("end_probability", (BATCH, TIME), "probability that the episode ends with this step"),
        )
        following = Port(
            "next_observations",
            (BATCH, TIME, space.num_columns),
            "the state that follows each one, in raw units",
            angles=tuple(space.angular.tolist()),
            spread=tuple(model.observation_normalizer.std.tolist()),
        )
        self.outputs = (
            following,
            *law_ports(model.observation_normalizer, components, (BATCH, TIME)),
            *(ends if model.stop else ()),
        )

    def compute(self, given: dict[str, Tensor]) -> dict[str, Tensor]:
        """The next states, their law, and whether the episode ends."""
        model, observations, noise = self.model, given["observations"], given["noise"]
        z = given.get("z", observations[:, 0, :0])
        values = model.observation_normalizer.values(observations)
        states = model.observation_normalizer.features(values)
        inputs = states
        if model.dynamics:
            inputs = model.state_decoder_inputs(states, model.action_normalizer.values(given["actions"]))
        foretold = model.state_decoder(inputs, values, z)
        tensors = law_tensors(foretold.following, model.observation_normalizer)
        found = {
            "next_observations": choose(tensors, model.observation_space, noise, given["most_likely"]),
            **tensors,
        }
        if model.stop:
            ends = foretold.log_odds.sigmoid()
            threshold = torch.where(given["most_likely"] > 0.5, 0.5, noise[..., -1])
            found |= {END: (ends > threshold).to(ends.dtype), "end_probability": ends}
        return found

    def write(self, given: dict[str, Value]) -> dict[str, Value]:
        """The next states, their law, and whether the episode ends."""
        model, raw, noise = self.model, given["observations"], given["noise"]
        sheet, decoder = raw.sheet, model.state_decoder
        rows = values(model.observation_normalizer, raw)
        inputs = features(model.observation_normalizer, rows)
        if model.dynamics:
            acted = values(model.action_normalizer, given["actions"])
            inputs = sheet.join([inputs, features(model.action_normalizer, acted)])
        after = read(decoder.trunk, inputs, given.get("z"), model.latent_features)
        numbers = numbers_of(noise, given["most_likely"], decoder.head, int(model.stop), 3)
        features_after = Arranged(after, np.arange(decoder.trunk.num_features))
        law = law_of(decoder.head, model.observation_normalizer, features_after, 3, origin=rows)
        found = {"next_observations": choice(decoder.head, law, numbers, 3).row, **law}
        if isinstance(decoder.stop, nn.Linear) and numbers.further is not None:
            ends = linear(decoder.stop, after, rank=3).apply("Sigmoid")
            end = ends.above(numbers.further).number()
            found |= {END: end.squeeze(-1), "end_probability": ends.squeeze(-1)}
        return found
