"""What is wrong with data, all of it at once, and what is in it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from tvae.data.columns import kinds_by_column
from tvae.data.demonstrations import Demonstrations
from tvae.data.hints import hints
from tvae.data.issues import Issue, Remedy
from tvae.data.preparation import AS_RECORDED, Preparation
from tvae.data.ragged import blocks, ranges
from tvae.data.sources import open_any_table, read_source
from tvae.data.table_rows import Examined, examine
from tvae.data.table_schema import ACTION, OBSERVATION
from tvae.data.tables import DataSource
from tvae.data.texts import first_with_mark
from tvae.data.trajectory import Attribute, DataError
from tvae.spaces import Angular, Binary, Categorical, FloatArray, IntArray, Signal, Space, describe

_BLOCK_STEPS = 1 << 20
_MOST_VALUES = 20
_FULL_TURN = 2 * math.pi * (1 + 1e-6)
"""A little more than 2 pi in single precision."""


def validate(
    source: DataSource,
    *,
    angular: Sequence[str] = (),
    continuous: Sequence[str] = (),
    categorical: Sequence[str] = (),
    binary: Sequence[str] = (),
    preparation: Preparation = AS_RECORDED,
) -> list[Issue]:
    """Everything that keeps `load_demonstrations` from reading a source; nothing if it can be read.

    For a table each kind of problem is counted, with the first place where it stands; for other sources it
    is the first problem.

    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "walks.csv"
    >>> _ = path.write_text("episode,step,observation.x,action.go\\n7,0,,left\\n7,2,0.5,left\\n")
    >>> for issue in validate(path):
    ...     print(issue)
    episode 7, step 2, column step: leaves a gap: it follows step 0
    episode 7, step 0, column observation.x: is missing or not a number
    """
    examined = _examined(
        source,
        angular=angular,
        continuous=continuous,
        categorical=categorical,
        binary=binary,
        preparation=preparation,
    )
    return list(examined.issues)


@dataclass(frozen=True)
class Soundness:
    """What is to be said against a source."""

    issues: tuple[Issue, ...]
    """What keeps it from being read."""
    suspicions: tuple[Issue, ...]
    """What can be read, but is perhaps not meant so; nothing where there are issues."""
    hints: tuple[Issue, ...] = ()
    """What may have been forgotten (`tvae.data.hints`); nothing where there are issues."""


def examine_source(
    source: DataSource,
    *,
    angular: Sequence[str] = (),
    continuous: Sequence[str] = (),
    categorical: Sequence[str] = (),
    binary: Sequence[str] = (),
    preparation: Preparation = AS_RECORDED,
) -> Soundness:
    """What `validate` finds, and what looks as if it were meant otherwise.

    >>> import pyarrow as pa
    >>> rows = {"episode": [0, 0], "step": [0, 1], "observation.heading": [350.0, 10.0], "action.go": [0.5, 1.5]}
    >>> print(examine_source(pa.table(rows), angular=["heading"]).suspicions[0])
    column observation.heading: is an angle in radians, but goes from 10 to 350: is it in degrees?
    """
    examined = _examined(
        source,
        angular=angular,
        continuous=continuous,
        categorical=categorical,
        binary=binary,
        preparation=preparation,
    )
    if examined.demonstrations is None:
        return Soundness(examined.issues, ())
    return Soundness(
        (),
        tuple(suspicions(summarise(examined.demonstrations))),
        tuple(hints(examined.demonstrations, examined.decided)),
    )


def _examined(
    source: DataSource,
    *,
    angular: Sequence[str],
    continuous: Sequence[str],
    categorical: Sequence[str],
    binary: Sequence[str],
    preparation: Preparation,
) -> Examined:
    try:
        kinds = kinds_by_column(angular, continuous, categorical, binary)
        raw = open_any_table(source, preparation)
        if raw is None:
            demonstrations, decided = read_source(source, kinds, preparation)
            return Examined(demonstrations, (), decided)
    except DataError as error:
        return Examined(None, (Issue(str(error)),))
    return examine(raw, kinds=kinds, preparation=preparation)


@dataclass(frozen=True)
class SignalSummary:
    """One column of the observations or the actions."""

    column: str
    """Such as `observation.x`."""
    kind: str
    """Such as `continuous`, `categorical (3)` or `angular, from degrees`."""
    minimum: float | None
    mean: float | None
    """Of angles the direction of the mean vector."""
    maximum: float | None
    frequencies: tuple[tuple[str, float], ...]
    """Share of each category, or of 0 and 1; empty for numbers and angles, which have the other three."""


@dataclass(frozen=True)
class AttributeSummary:
    """One fact about episodes."""

    name: str
    num_values: int
    """How many different values there are."""
    counts: tuple[tuple[Attribute, int], ...]
    """The most frequent values, at most 20, and how many episodes have each."""


@dataclass(frozen=True)
class Summary:
    """What demonstrations hold."""

    num_episodes: int
    num_steps: int
    length_quantiles: tuple[float, float, float, float, float]
    """Minimum, quartiles and maximum of the numbers of steps."""
    num_final_observed: int
    """Episodes whose observation after the last action was recorded."""
    signals: tuple[SignalSummary, ...]
    steps: tuple[str, ...]
    """Names of the step columns."""
    attributes: tuple[AttributeSummary, ...]


def suspicions(summary: Summary) -> Iterator[Issue]:
    """Angles beyond a full turn, which are seldom recorded in radians, |x| > 2 pi, and categories such as `0,5`."""
    for signal in summary.signals:
        names = pa.chunked_array([[name for name, _ in signal.frequencies]], pa.string())
        with_comma = first_with_mark(names, ",")
        if with_comma is not None:
            message = f"is a category, but has values such as {with_comma!r}: are they numbers with a decimal comma?"
            yield Issue(message, column=signal.column, remedy=Remedy.SAY_DECIMAL)
        if signal.kind != describe(Angular(signal.column)) or signal.minimum is None or signal.maximum is None:
            continue
        if max(-signal.minimum, signal.maximum) > _FULL_TURN:
            message = (
                f"is an angle in radians, but goes from {signal.minimum:.4g} to {signal.maximum:.4g}: "
                "is it in degrees?"
            )
            yield Issue(message, column=signal.column, remedy=Remedy.SAY_DEGREES)


def summarise(demonstrations: Demonstrations) -> Summary:
    """Numbers for a table of what was recorded.

    >>> from tvae.data.arrays import from_arrays
    >>> summary = summarise(from_arrays([[0.0, 4.0], [2.0, 2.0]], [["left", "right"], ["left", "left"]]))
    >>> summary.num_episodes, summary.num_steps, summary.signals[0].mean, summary.signals[1].frequencies
    (2, 4, 2.0, (('left', 0.75), ('right', 0.25)))
    """
    low, first, middle, third, high = np.quantile(demonstrations.lengths, [0, 0.25, 0.5, 0.75, 1]).tolist()
    seen = demonstrations.lengths + demonstrations.final_observed
    return Summary(
        num_episodes=len(demonstrations),
        num_steps=demonstrations.num_steps,
        length_quantiles=(low, first, middle, third, high),
        num_final_observed=int(demonstrations.final_observed.sum()),
        signals=(
            *_signals(
                OBSERVATION,
                demonstrations.observation_space,
                demonstrations.observations,
                demonstrations.observation_starts,
                seen,
            ),
            *_signals(
                ACTION,
                demonstrations.action_space,
                demonstrations.actions,
                demonstrations.action_starts,
                demonstrations.lengths,
            ),
        ),
        steps=tuple(demonstrations.steps),
        attributes=tuple(
            _attribute(name, values.tolist()) for name, values in demonstrations.attributes.items()
        ),
    )


def _attribute(name: str, values: list[Attribute]) -> AttributeSummary:
    counts = Counter(values)
    return AttributeSummary(name, len(counts), tuple(counts.most_common(_MOST_VALUES)))


def _signals(
    prefix: str, space: Space, flat: FloatArray, starts: IntArray, counts: IntArray
) -> Iterator[SignalSummary]:
    """A summary of each column over the rows of some episodes, read in parts."""
    parts = list(blocks(counts, _BLOCK_STEPS))
    for index, signal in enumerate(space.signals):
        columns = (flat[ranges(starts[part], counts[part]), index] for part in parts)
        yield _signal(prefix + signal.name, signal, columns)


def _signal(column: str, signal: Signal, parts: Iterator[FloatArray]) -> SignalSummary:
    if isinstance(signal, Categorical | Binary):
        categories = signal.categories if isinstance(signal, Categorical) else (0, 1)
        counts = np.zeros(len(categories))
        for part in parts:
            counts += np.bincount(part.astype(np.int64), minlength=len(categories))
        frequencies = tuple(zip(map(str, categories), (counts / counts.sum()).tolist(), strict=True))
        return SignalSummary(column, describe(signal), None, None, None, frequencies)
    lowest, highest, total, count = math.inf, -math.inf, 0j, 0
    for part in parts:
        lowest, highest = min(lowest, float(part.min())), max(highest, float(part.max()))
        with np.errstate(over="ignore"):
            total += np.exp(1j * part).sum() if isinstance(signal, Angular) else part.sum()
        count += len(part)
    mean = float(np.angle(total)) if isinstance(signal, Angular) else total.real / count
    in_degrees = isinstance(signal, Angular) and signal.recorded_in_degrees
    kind = f"{describe(signal)}, from degrees" if in_degrees else describe(signal)
    return SignalSummary(column, kind, lowest, mean, highest, ())
