"""What a trunk makes of the present input and what it carries, written down as ONNX."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import nn

from tvae.export.arranged import Affine, Arranged, apart, each, joined, mapped, stacked
from tvae.export.layers import at_every_step, chain, changes, gates, lstm, lstm_once, over_time, present, silu
from tvae.export.sheet import Value, as_rows
from tvae.model.events import Events
from tvae.model.trunks import PlainTrunk, ReactiveTrunk, Trunk
from tvae.spaces import IntArray


@dataclass(frozen=True)
class Carried:
    """What a bot carries from step to step, apart from its events; what it does not need is None."""

    started: Value
    last: Value | None
    hidden: Value | None
    cell: Value | None


@dataclass(frozen=True)
class Reaction:
    """What a trunk makes of the present input."""

    features: Arranged
    """(B, F)"""
    used: Value | None
    """(B, N) log-odds of each event to occur in this episode; None where z does not tell"""
    after: dict[str, Value]
    """What is carried on, by name."""


def react(
    trunk: Trunk, events: Events, inputs: list[Arranged], z: Value | None, carried: Carried, window: int | None
) -> Reaction:
    """The features after the present inputs (B, S), which come in parts.

    What reads the same rows is one operator: the gates, the first layer of the mix, the modulation by z, and which
    events occur. With a window of 1 there is no last change, and nothing is computed for it.
    """
    assert isinstance(trunk, PlainTrunk | ReactiveTrunk)
    sheet, net = carried.started.sheet, trunk.recurrent
    width, size = net.input_size, net.hidden_size
    seen, fresh, after = _present(trunk, inputs, z, carried)
    order = np.append(np.arange(size), size + seen.order)
    first, second = _by_style(trunk, events, order)
    styled, reading = [stacked(first)] if first else [], gates(net) if not fresh else []
    mix, mixing = _two(trunk.mix) if isinstance(trunk, ReactiveTrunk) else (None, None)
    mixed = [Affine(mix.weight[:, :width], mix.bias)] if mix is not None else []
    maps = [*reading, *styled, *mixed]
    pieces = iter(each(seen, maps) if maps else [])
    if not fresh:
        hidden = lstm_once(*(next(pieces) for _ in reading))
    else:
        hidden, recurrent = _remember(trunk, seen.rows, fresh, carried, window)
        after |= recurrent
    weights = used = None
    if first:
        rows = Arranged(silu(next(pieces)), np.arange(len(styled[0].bias)))
        sizes = [len(order) if isinstance(trunk, ReactiveTrunk) else 0, events.num_events if events.by_style else 0]
        weights, used = sheet.split(mapped(rows, apart(second)), sizes)
    if mix is None or mixing is None:
        return Reaction(Arranged(hidden, np.arange(size)), used, after)
    rest = sheet.node("Gemm", hidden, np.ascontiguousarray(mix.weight[:, width:]), next(pieces), transB=1)
    remembered = silu(mapped(Arranged(silu(rest), np.arange(size)), mixing))
    features = sheet.join([remembered, seen.rows])
    return Reaction(Arranged(features if weights is None else features * weights, order), used, after)


def _present(
    trunk: PlainTrunk | ReactiveTrunk, inputs: list[Arranged], z: Value | None, carried: Carried
) -> tuple[Arranged, list[Value], dict[str, Value]]:
    """What the trunk reads, in parts what a state of zero reads where others are carried, and the last input."""
    size, reactive = len(trunk.unit), isinstance(trunk, ReactiveTrunk)
    latent = [] if z is None else [Arranged(z, np.arange((1 + reactive) * size, trunk.recurrent.input_size))]
    if carried.hidden is None:
        return joined([*inputs, *latent]), [], {}
    present = joined(inputs).in_order(size)
    styles = [part.rows for part in latent]
    change, fresh_change, after = [], [], {}
    if carried.last is not None:
        last = present.sheet.where(carried.started, carried.last, present)
        change, fresh_change, after = [changes(present, last, trunk.unit)], [present * 0.0], {"last": present}
    seen = present.sheet.join([present, *change, *styles])
    fresh = [present, *fresh_change, *styles]
    return Arranged(seen, np.arange(trunk.recurrent.input_size)), fresh, after


def _by_style(
    trunk: PlainTrunk | ReactiveTrunk, events: Events, order: IntArray
) -> tuple[list[Affine], list[Affine]]:
    """First and second layers of the nets that read z: what weighs the features, in their order, and the events.

    z itself is weighed with 1.
    """
    size, width = len(trunk.unit), trunk.recurrent.input_size
    reactive = isinstance(trunk, ReactiveTrunk)
    latent = np.arange((1 + reactive) * size, width)
    first, second = [], []
    if isinstance(trunk, ReactiveTrunk) and trunk.by_style is not None:
        reads, weighs = _two(trunk.by_style)
        first.append(reads.placed(np.append(latent, np.arange(size - trunk.num_done, size)), width))
        beside = np.zeros((len(latent), weighs.weight.shape[1]), dtype=np.float32)
        bias = np.append(weighs.bias + 1, np.ones(len(latent), dtype=np.float32))
        second.append(Affine(np.concatenate([weighs.weight, beside])[order], bias[order]))
    if events.by_style is not None and events.share is not None:
        reads, tells = _two(events.by_style)
        first.append(reads.placed(latent, width))
        second.append(Affine(tells.weight, tells.bias + as_rows(events.share)))
    return first, second


def _two(layers: nn.Sequential) -> tuple[Affine, Affine]:
    """The affine layers of a net with one hidden layer."""
    first, second = (Affine.of(layer) for layer in layers if isinstance(layer, nn.Linear))
    return first, second


def _remember(
    trunk: Trunk, seen: Value, fresh: list[Value], carried: Carried, window: int | None
) -> tuple[Value, dict[str, Value]]:
    """The output (B, H) of the recurrent state that has read the window, and the states that go on."""
    sheet, net = seen.sheet, trunk.recurrent
    assert carried.hidden is not None
    assert carried.cell is not None
    if window is None:
        found = lstm(net, seen.unsqueeze(0), carried.hidden.unsqueeze(0), carried.cell.unsqueeze(0))
        hidden = found.hidden.squeeze(0)
        return hidden, {"hidden": hidden, "cell": found.cell.squeeze(0)}
    size, width = net.hidden_size, net.input_size
    rows = sheet.join([*fresh, *[seen] * (window - 1)]).reshape(1, -1, width)
    zeros = (carried.hidden if window == 2 else carried.hidden.columns(np.arange(size))) * 0.0
    before = [sheet.join([zeros, states]).reshape(1, -1, size) for states in (carried.hidden, carried.cell)]
    found = lstm(net, rows, *before)
    young, last = sheet.split(found.hidden.reshape(-1, window * size), [(window - 1) * size, size])
    assert young is not None
    assert last is not None
    cell = found.cell.reshape(-1, window * size).columns(np.arange((window - 1) * size))
    return last, {"hidden": young, "cell": cell}


def read(trunk: Trunk, inputs: Value, z: Value | None, latent_features: int) -> Value:
    """The features (B, T, F) after each of the inputs (B, T, S), from a recurrent state of zero."""
    assert isinstance(trunk, PlainTrunk | ReactiveTrunk)
    sheet = inputs.sheet
    latent = None if z is None else at_every_step(z, inputs, latent_features)
    change = None
    if isinstance(trunk, ReactiveTrunk):
        edges = np.array([0]), np.array([-1]), np.array([1])
        first = sheet.node("Slice", inputs, np.array([0]), np.array([1]), np.array([1]))
        before = sheet.join([first, sheet.node("Slice", inputs, *edges)], axis=1)
        change = changes(inputs, before, trunk.unit)
    seen = present(sheet, [inputs, change, latent])
    remembered = over_time(trunk.recurrent, seen)
    if not isinstance(trunk, ReactiveTrunk) or change is None:
        return remembered
    mixed = chain(trunk.mix, sheet.join([seen, remembered]), rank=3)
    weighed = sheet.join([mixed, inputs, change])
    if trunk.by_style is not None:
        size = len(trunk.unit)
        done = inputs.columns(np.arange(size - trunk.num_done, size)) if trunk.num_done else None
        weighed = weighed * (chain(trunk.by_style, present(sheet, [latent, done]), rank=3) + 1.0)
    return present(sheet, [weighed, latent])
