"""Numbers as a reader wants them: nested metrics as rows, shares with their intervals, few digits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from tvae.report.meanings import meaning

_NORMAL_975 = 1.959963984540054


@dataclass(frozen=True)
class Measured:
    """A number, and what is known of its uncertainty."""

    mean: float
    interval: tuple[float, float] | None = None
    """The 95 % confidence interval."""
    basis: str = ""
    """What was counted, such as `5 seeds`."""


def measured(value: Any) -> Measured | None:
    """A metric's value as a number; None where it is none.

    >>> measured({"mean": 0.97, "ci95": [0.95, 0.99], "seeds": 5})
    Measured(mean=0.97, interval=(0.95, 0.99), basis='5 seeds')
    >>> measured("fast") is None
    True
    """
    match value:
        case bool():
            return None
        case int() | float():
            return Measured(float(value))
        case {"mean": int() | float() as mean, "ci95": [low, high], **more}:
            basis = f"{more['seeds']} seeds" if "seeds" in more else ""
            return Measured(float(mean), (float(low), float(high)), basis)
    return None


def share(successes: int, trials: int) -> Measured:
    """A share of trials with Wilson's interval.

    >>> share(97, 100).interval[0] < 0.92 < 0.97 == share(97, 100).mean
    True
    """
    if trials < 1:
        raise ValueError(f"a share needs at least one trial, got {trials}")
    mean, z = successes / trials, _NORMAL_975
    centre = mean + z * z / (2 * trials)
    half = z * sqrt(mean * (1 - mean) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return Measured(mean, ((centre - half) / scale, (centre + half) / scale), f"{trials:,} episodes")


def number(value: Any) -> str:
    """Four digits at most, thousands apart.

    >>> [number(value) for value in (0.97312, 12345, 12345.6, 2e-7, True, None, "x")]
    ['0.9731', '12,345', '12,346', '2e-07', 'yes', '–', 'x']
    """
    match value:
        case None:
            return "–"
        case bool():
            return "yes" if value else "no"
        case int():
            return f"{value:,}"
        case float():
            return f"{value:,.0f}" if 1000 <= abs(value) < 1e9 else f"{value:.4g}"
        case [*parts]:
            return ", ".join(number(part) for part in parts)
    return str(value)


def percent(value: float) -> str:
    """A share in percent, with one decimal unless it is a whole number, never broken over two lines.

    >>> percent(0.9733), percent(1.0)
    ('97.3\\xa0%', '100\\xa0%')
    """
    return f"{100 * value:.1f}".removesuffix(".0") + "\N{NO-BREAK SPACE}%"


@dataclass(frozen=True)
class MetricRow:
    """One line of the table of metrics."""

    path: tuple[str, ...]
    value: str
    interval: str
    basis: str
    meaning: str = ""


def of_bots(metrics: Mapping[str, Any], path: Sequence[str]) -> Measured | None:
    """The number at a path of `metrics.json` with its interval, which stands under `ci95`; None where there is none.

    >>> metrics = {"success": {"attack": 0.9}, "ci95": {"success": {"attack": [0.8, 1.0]}}, "test_episodes": 50}
    >>> of_bots(metrics, ("success", "attack"))
    Measured(mean=0.9, interval=(0.8, 1.0), basis='50 episodes')
    """
    value, interval = _at(metrics, path), _at(metrics, ("ci95", *path))
    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(interval, Sequence):
        return None
    low, high = interval
    episodes = metrics.get("test_episodes")
    return Measured(float(value), (float(low), float(high)), f"{episodes:,} episodes" if episodes else "")


def _at(metrics: Any, path: Sequence[str]) -> Any:
    for part in path:
        metrics = metrics.get(part) if isinstance(metrics, Mapping) else None
    return metrics


def metric_rows(metrics: Mapping[str, Any]) -> Iterator[MetricRow]:
    """Nested metrics line by line, in their order; intervals of bots stand beside what they are of.

    >>> rows = metric_rows({"ari": 1.0, "success": {"all": {"mean": 0.97, "ci95": [0.95, 0.99], "seeds": 5}}})
    >>> [(" / ".join(row.path), row.value, row.interval) for row in rows]
    [('ari', '1', ''), ('success / all', '0.97', '0.95 to 0.99')]
    """
    yield from _rows(metrics, {name: value for name, value in metrics.items() if name != "ci95"}, ())


def _rows(metrics: Mapping[str, Any], part: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[MetricRow]:
    """Those of a part of `metrics`, which stands below the path `above`."""
    for name, value in part.items():
        path = (*above, name)
        found = of_bots(metrics, path) or measured(value)
        if found is not None and found.interval is not None:
            low, high = found.interval
            interval = f"{number(low)} to {number(high)}"
            yield MetricRow(path, number(found.mean), interval, found.basis, meaning(path, metrics))
        elif isinstance(value, Mapping):
            yield from _rows(metrics, value, path)
        elif (
            isinstance(value, Sequence)
            and not isinstance(value, str)
            and any(isinstance(item, Mapping) for item in value)
        ):
            yield from _rows(metrics, {str(index): item for index, item in enumerate(value)}, path)
        else:
            yield MetricRow(path, number(value), "", "", meaning(path, metrics))
