"""What verbs print: tables of styles, metrics and signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pyarrow as pa
from rich.markup import escape
from rich.table import Column, Table

from tvae.data.validation import Summary
from tvae.evaluate.unlikeness import unlike_places, unlike_sessions
from tvae.experiments.run_directory import read_json
from tvae.experiments.sessions import Scored
from tvae.experiments.using import FinishedRun


def styles_table(run: FinishedRun) -> Table:
    """Each style with its share and what sets it apart."""
    table = Table("style", "share", "what sets it apart")
    for style in run.findings.playstyles.styles:
        words = "\n".join(run.findings.words[style.index])
        table.add_row(escape(run.findings.title(style)), f"{style.weight:.0%}", escape(words))
    return table


def metrics_table(run: FinishedRun) -> Table:
    """All of `metrics.json`."""
    table = Table("metric", "value")
    for name, value in _leaves(run.findings.shown(read_json(run.directory.metrics))):
        table.add_row(escape(name), escape(_short(value)))
    return table


def _leaves(data: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def signals_table(summary: Summary) -> Table:
    """What each column was taken for, and its values."""
    table = Table("column", "kind", "values")
    for signal in summary.signals:
        if signal.frequencies:
            values = ", ".join(f"{name} {share:.0%}" for name, share in signal.frequencies[:6])
        else:
            values = f"{signal.minimum:.4g} to {signal.maximum:.4g}, mean {signal.mean:.4g}"
        table.add_row(escape(signal.column), signal.kind, escape(values))
    return table


def rows_table(rows: pa.Table) -> Table:
    """A table of rows as it is."""
    table = Table(*(Column(escape(name), overflow="fold") for name in rows.column_names))
    for row in rows.to_pylist():
        table.add_row(*(escape(_short(value)) for value in row.values()))
    return table


def unlike_sessions_table(scored: Scored, count: int) -> Table:
    """The sessions that are least likely a step, and the least likely step of each."""
    headings = ("session", "nats a step", "as unlikely", "worst step", "nats", "signal")
    table = Table(*(Column(heading, overflow="fold") for heading in headings))
    for found in unlike_sessions(scored.scores, scored.reference, count):
        table.add_row(
            escape(str(scored.names[found.session])),
            f"{found.nats_per_step:.2f}",
            f"{found.share:.2%}",
            str(found.worst.step),
            f"{found.worst.nats:.2f}",
            escape(scored.columns[found.worst.signal]),
        )
    return table


def unlike_places_table(scored: Scored, count: int) -> Table:
    """The least likely steps of all."""
    headings = ("session", "step", "nats", "as unlikely", "signal")
    table = Table(*(Column(heading, overflow="fold") for heading in headings))
    for place in unlike_places(scored.scores, scored.reference, count):
        session = escape(str(scored.names[place.session]))
        signal = escape(scored.columns[place.signal])
        table.add_row(session, str(place.step), f"{place.nats:.2f}", f"{place.share:.2%}", signal)
    return table


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
