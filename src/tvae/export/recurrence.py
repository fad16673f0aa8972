"""What a trunk makes of the present input and what it carries, written down as ONNX."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.export.layers import at_every_step, chain, changes, lstm, lstm_once, over_time, present
from tvae.export.sheet import Value
from tvae.model.trunks import PlainTrunk, ReactiveTrunk, Trunk


@dataclass(frozen=True)
class Carried:
    """What a bot carries from step to step, apart from its events; what it does not need is None."""

    started: Value
    last: Value | None
    hidden: Value | None
    cell: Value | None


def react(
    trunk: Trunk, inputs: Value, z: Value | None, carried: Carried, window: int | None
) -> tuple[Value, dict[str, Value]]:
    """The features (B, F) after the present inputs (B, S), and what is carried on, by name."""
    sheet = inputs.sheet
    change = fresh_change = None
    after: dict[str, Value] = {}
    if isinstance(trunk, ReactiveTrunk):
        fresh_change = change = inputs * 0.0
        if carried.last is not None:
            last = sheet.where(carried.started, carried.last, inputs)
            change, after["last"] = changes(inputs, last, trunk.unit), inputs
    seen = present(sheet, [inputs, change, z])
    fresh = present(sheet, [inputs, fresh_change, z])
    hidden, recurrent = _remember(trunk, seen, fresh, carried, window)
    after |= recurrent
    return _mix(trunk, inputs, change, z, seen, hidden, rank=2), after


def _remember(
    trunk: Trunk, seen: Value, fresh: Value, carried: Carried, window: int | None
) -> tuple[Value, dict[str, Value]]:
    """The output (B, H) of the recurrent state that has read the window, and the states that go on."""
    assert isinstance(trunk, PlainTrunk | ReactiveTrunk)
    sheet, net = seen.sheet, trunk.recurrent
    if carried.hidden is None or carried.cell is None:
        return lstm_once(net, seen), {}
    if window is None:
        found = lstm(net, seen.unsqueeze(0), carried.hidden.unsqueeze(0), carried.cell.unsqueeze(0))
        hidden = found.hidden.squeeze(0)
        return hidden, {"hidden": hidden, "cell": found.cell.squeeze(0)}
    size, width = net.hidden_size, net.input_size
    others = sheet.node("Expand", seen.unsqueeze(1), np.array([1, window - 1, 1]))
    rows = sheet.join([fresh.unsqueeze(1), others], axis=1).reshape(1, -1, width)
    zeros = carried.hidden.columns(np.arange(size)) * 0.0
    before = [sheet.join([zeros, states]).reshape(1, -1, size) for states in (carried.hidden, carried.cell)]
    found = lstm(net, rows, *before)
    young = np.arange((window - 1) * size)
    hidden, cell = (states.reshape(-1, window * size) for states in (found.hidden, found.cell))
    oldest = hidden.columns(np.arange((window - 1) * size, window * size))
    return oldest, {"hidden": hidden.columns(young), "cell": cell.columns(young)}


def _mix(
    trunk: Trunk,
    inputs: Value,
    change: Value | None,
    z: Value | None,
    seen: Value,
    remembered: Value,
    *,
    rank: int,
) -> Value:
    """The features of a trunk, given what its recurrent net remembers."""
    if not isinstance(trunk, ReactiveTrunk):
        return remembered
    sheet = inputs.sheet
    mixed = chain(trunk.mix, sheet.join([seen, remembered]), rank=rank)
    weighed = present(sheet, [mixed, inputs, change])
    if trunk.by_style is not None:
        size = len(trunk.unit)
        done = inputs.columns(np.arange(size - trunk.num_done, size)) if trunk.num_done else None
        weighed = weighed * (chain(trunk.by_style, present(sheet, [z, done]), rank=rank) + 1.0)
    return present(sheet, [weighed, z])


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
    return _mix(trunk, inputs, change, latent, seen, over_time(trunk.recurrent, seen), rank=3)
