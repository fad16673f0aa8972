"""What verbs print: tables of styles, metrics and signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.markup import escape
from rich.table import Table

from tvae.data.validation import Summary
from tvae.experiments.run_directory import RunDirectory, read_json
from tvae.experiments.using import FinishedRun


def styles_table(run: FinishedRun) -> Table:
    """Each style with its share and what sets it apart."""
    table = Table("style", "share", "what sets it apart")
    for style in run.findings.playstyles.styles:
        words = "\n".join(run.findings.words[style.index])
        table.add_row(escape(run.findings.name(style)), f"{style.weight:.0%}", escape(words))
    return table


def metrics_table(run: RunDirectory) -> Table:
    """All of `metrics.json`."""
    table = Table("metric", "value")
    for name, value in _leaves(read_json(run.metrics)):
        table.add_row(escape(name), escape(f"{value:.4g}" if isinstance(value, float) else str(value)))
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
