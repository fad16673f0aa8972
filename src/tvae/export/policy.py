"""One step of the policy: what a bot sees, its z and its memory go in, its action and its memory come out.

A bot with the rolling window W reads its last W states from a recurrent state of zero, so that W recurrent states are
on their way at any time: the k-th has read the last k states. Each step lets all of them read one more, a fresh one
among them; the one that has read W gives the action and is dropped. The memory holds the other W - 1. All of them are
zero where an episode begins, and then the oldest has read every state there was: before step W nothing is forgotten.
So the memory of a new episode is zeros, whatever the window, and a step costs what it costs to read W states at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tvae.export.arranged import Arranged
from tvae.export.heads import choice, hazard, law_of
from tvae.export.inputs import seen
from tvae.export.laws import choose, law_ports, law_tensors, noise_names
from tvae.export.ports import BATCH, Graph, Port
from tvae.export.recurrence import Carried, react
from tvae.export.sheet import Value
from tvae.export.uniform import numbers_of
from tvae.model.events import SURE
from tvae.model.trunks import Memory, ReactiveTrunk
from tvae.model.tvae import TrajectoryVAE


@dataclass(frozen=True)
class Field:
    """Some neighbouring columns of the memory."""

    name: str
    shape: tuple[int, ...]
    meaning: str

    @property
    def size(self) -> int:
        """How many columns."""
        return torch.Size(self.shape).numel()


def memory_fields(model: TrajectoryVAE) -> tuple[Field, ...]:
    """What a bot of `model` has to remember from step to step, in the order of the memory's columns."""
    trunk, window, events = model.policy_decoder.trunk, model.bot_window, model.events.num_events
    fields = [Field("started", (1,), "1 once the episode has begun")]
    if isinstance(trunk, ReactiveTrunk) and window != 1:
        fields.append(Field("last", (len(trunk.unit),), "the last input of the recurrent net"))
    if window != 1:
        shape = (1 if window is None else window - 1, model.policy_decoder.trunk.recurrent.hidden_size)
        fields.append(Field("hidden", shape, "hidden states of the recurrent net that are on their way"))
        fields.append(Field("cell", shape, "cell states of the recurrent net that are on their way"))
    if events:
        fields.append(Field("used", (events,), "1 for an event that may occur in this episode"))
        fields.append(
            Field("due", (events,), f"probability with which an event that occurred was due; from {SURE} on it is done")
        )
    return tuple(fields)


class PolicyStep(Graph):
    """pi(a_t | s_1:t, z) of a bot: a step of `tvae.Agent` as a function without side effects.

    >>> from tvae.spaces import Binary, Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Binary("jump"),)), window=1).eval()
    >>> step = PolicyStep(model)
    >>> [port.name for port in step.inputs], [port.name for port in step.outputs]
    (['observation', 'z', 'memory', 'noise', 'most_likely'], ['action', 'probability', 'memory_out'])
    >>> [field.name for field in step.fields], step.noise
    (['started', 'used', 'due'], ('jump', 'jump.used'))
    """

    name = "policy_step"

    def __init__(self, model: TrajectoryVAE) -> None:
        super().__init__()
        self.model = model
        self.window = model.bot_window
        self.fields = memory_fields(model)
        space, components = model.action_space, model.policy_decoder.head.num_components
        events = [space.names[column] for column in model.events.columns.tolist()]
        self.noise = (*noise_names(space, components), *(f"{name}.used" for name in events))
        """What each column of the input `noise` decides."""
        size = sum(field.size for field in self.fields)
        kept = Port("memory", (BATCH, size), "zeros where an episode begins, afterwards memory_out of the last step")
        latent = Port("z", (BATCH, model.latent_features), "the style, the same in all of an episode")
        self.inputs = (
            Port("observation", (BATCH, model.observation_space.num_columns), "what the bot sees now, in raw units"),
            *([latent] if model.latent_features else []),
            kept,
            Port("noise", (BATCH, len(self.noise)), "uniform random numbers in [0, 1), fresh in each step"),
            Port("most_likely", (1,), "0 draws the action by the noise, 1 takes the most likely one"),
        )
        angles, spread = tuple(space.angular.tolist()), tuple(model.action_normalizer.std.tolist())
        self.outputs = (
            Port("action", (BATCH, space.num_columns), "what the bot does, in raw units", angles=angles, spread=spread),
            *law_ports(model.action_normalizer, components, (BATCH,)),
            Port("memory_out", (BATCH, size), "memory for the next step"),
        )

    def compute(self, given: dict[str, Tensor]) -> dict[str, Tensor]:
        """The action, its law, and the next memory."""
        model, observation, noise = self.model, given["observation"], given["noise"]
        z = given.get("z", observation[:, :0])
        kept = dict(
            zip(
                (field.name for field in self.fields),
                given["memory"].split([field.size for field in self.fields], dim=-1),
                strict=True,
            )
        )
        started = kept["started"] > 0.5
        num_events = model.events.num_events
        known: dict[str, Tensor] = {"started": torch.ones_like(kept["started"])}
        done = observation[:, :0]
        if num_events:
            drawn = torch.where(given["most_likely"] > 0.5, 0.5, noise[:, -num_events:])
            begun = (model.events.probability(z) > drawn).to(z.dtype)
            known["used"] = torch.where(started, kept["used"], begun)
            done = (1 - kept["due"] <= 1 - SURE).to(z.dtype)
        inputs = model.policy_decoder_inputs(observation, done)
        features, recurrent = self._advance(inputs, z, kept, started)
        law = model.policy_decoder.law(features)
        if num_events:
            law = model.events.given(law, known["used"] > 0.5)
        tensors = law_tensors(law, model.action_normalizer)
        action = choose(tensors, model.action_space, noise, given["most_likely"])
        if num_events:
            known["due"] = kept["due"] + (1 - kept["due"]) * model.events.hazard(law) * model.events.of(action)
        known |= recurrent
        memory = torch.cat([known[field.name] for field in self.fields], dim=-1)
        return {"action": action, **tensors, "memory_out": memory}

    def _advance(
        self, inputs: Tensor, z: Tensor, kept: dict[str, Tensor], started: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """The features after the present input, and what to remember of it."""
        trunk, window = self.model.policy_decoder.trunk, self.window
        if window == 1:
            features, _ = trunk(inputs[:, None], z)
            return features[:, 0], {}
        last = torch.where(started, kept["last"], inputs) if "last" in kept else inputs
        size = trunk.recurrent.hidden_size
        if window is None:
            memory = Memory(kept["hidden"][None], kept["cell"][None], last[:, None])
            features, after = trunk(inputs[:, None], z, memory)
            return features[:, 0], {"last": inputs, "hidden": after.hidden[0], "cell": after.cell[0]}
        fresh = torch.zeros_like(kept["hidden"][:, :size])
        states = [torch.cat([fresh, kept[name]], dim=-1).reshape(1, -1, size) for name in ("hidden", "cell")]
        before = torch.cat([inputs[:, None], last[:, None].expand(-1, window - 1, -1)], dim=1)
        every = inputs[:, None].expand(-1, window, -1)
        width = inputs.shape[-1]
        features, after = trunk(
            every.reshape(-1, 1, width),
            z[:, None].expand(-1, window, -1).flatten(0, 1),
            Memory(states[0], states[1], before.reshape(-1, 1, width)),
        )
        hidden, cell = (state.reshape(-1, window * size)[:, :-size] for state in (after.hidden, after.cell))
        seen = features.reshape(-1, window, features.shape[-1])[:, -1]
        return seen, {"last": inputs, "hidden": hidden, "cell": cell}

    def write(self, given: dict[str, Value]) -> dict[str, Value]:
        """The action, its law, and the next memory."""
        model, raw, memory = self.model, given["observation"], given["memory"]
        sheet, events, head = raw.sheet, model.events.num_events, model.policy_decoder.head
        pieces = sheet.split(memory, [field.size for field in self.fields])
        kept = {field.name: piece for field, piece in zip(self.fields, pieces, strict=True) if piece is not None}
        started = kept["started"].above(0.5)
        after: dict[str, Value] = {"started": sheet.node("Max", kept["started"], 1.0)}
        numbers = numbers_of(given["noise"], given["most_likely"], head, events, 2)
        inputs = seen(model.perception, model.observation_normalizer, raw)
        missed = None
        if events:
            missed = 1.0 - kept["due"]
            size = model.policy_decoder.trunk.unit.numel()
            done = sheet.node("LessOrEqual", missed, 1 - SURE).number()
            inputs.append(Arranged(done, np.arange(size - events, size)))
        carried = Carried(started, kept.get("last"), kept.get("hidden"), kept.get("cell"))
        found = react(model.policy_decoder.trunk, model.events, inputs, given.get("z"), carried, self.window)
        used = None
        if numbers.further is not None and model.events.share is not None:
            log_odds = sheet.constant(model.events.share[None]) if found.used is None else found.used
            drawn = log_odds.apply("Sigmoid").above(numbers.further).number()
            after["used"] = used = sheet.where(started, kept["used"], drawn)
        law = law_of(head, model.action_normalizer, found.features, 2, used=used)
        chosen = choice(head, law, numbers, 2)
        if missed is not None and chosen.binary is not None:
            after["due"] = kept["due"] + missed * hazard(law) * chosen.binary
        after |= found.after
        return {"action": chosen.row, **law, "memory_out": sheet.join([after[field.name] for field in self.fields])}
