"""What sets each style apart, in plain words.

A style's episodes are compared with all others, one statistic at a time (`tvae.evaluate.differences`).
What is told so may be shared with one other style. Where it does not tell the style from that one, its nearest, a
further sentence does: the two styles' episodes are compared in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from string import Formatter

import numpy as np
from scipy.stats import rankdata

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.differences import FEWEST_EPISODES, LEAST_AUC_DISTANCE, Difference, differences, evenly
from tvae.evaluate.statistics import EpisodeStatistics, Statistic
from tvae.spaces import FloatArray, IntArray

MOST_SENTENCES = 4
"""Against all other episodes; one more may tell a style from its nearest."""
TOLD_APART = 0.4
"""AUC distance from which a statistic tells two styles apart by itself: AUC of 0.9 or 0.1."""
MOST_RANK_CORRELATION = 0.9
"""Two statistics that correlate more than this say the same."""
MOST_TOLD = 100_000
"""Of more episodes, styles are described by as many, evenly taken."""

_EFFECT_SIZES = "d is Cohen's d, the difference of the two means in standard deviations: 0.2 is small, 0.8 is large."
_TOO_FEW = "too few episodes to compare"
_NOTHING = "nothing sets it apart from the other episodes"
_MOST_SHOWN_EFFECT = 10.0
_AS_TELLING = 0.02
"""Statistics of one signal whose AUC distances differ by less are equally telling."""


def describe(demonstrations: Demonstrations, assignment: IntArray) -> dict[int, tuple[str, ...]]:
    """For each style, in at most four sentences, what sets it apart from all other episodes; in one more, if need be,
    from its nearest style.

    `assignment` (E,) is the style of each episode. How the episodes were played comes first; what came of it,
    `return` and `info.*`, only where there is room. A signal is told once, and not if it ranks the episodes as
    one told already does. The nearest style is the one that the told statistics tell it from worst; that sentence is
    there where none of them does (`TOLD_APART`) and another one does better. A single style is described by itself.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> episodes = zombie_demonstrations(num_episodes=40)
    >>> attacks = (episodes.attribute("label") == "attack").astype(np.int64)
    >>> describe(episodes, attacks)[1][0]
    'attack happens 1.0 times an episode against 0.0 (d > 10)'
    """
    if assignment.shape != (len(demonstrations),):
        raise ValueError(f"{len(demonstrations)} episodes need as many styles, got the shape {assignment.shape}")
    of_each = np.unique(assignment, return_index=True)[1]
    told = np.union1d(of_each, evenly(np.arange(len(assignment)), MOST_TOLD))
    statistics, assignment = EpisodeStatistics.of(demonstrations.select(told)), assignment[told]
    styles = np.unique(assignment).tolist()
    if len(styles) == 1:
        return {styles[0]: _absolute(statistics)}
    return {style: _relative(statistics, assignment, style) for style in styles}


def explanation(sentences: Iterable[str]) -> str:
    """What a reader of these sentences of `describe` has to be told once about (d = ...); empty where none has it.

    >>> explanation(["jump happens 3.0 times an episode against 0.0 (d = 2.7)"])
    "d is Cohen's d, the difference of the two means in standard deviations: 0.2 is small, 0.8 is large."
    """
    return _EFFECT_SIZES if any("(d " in sentence for sentence in sentences) else ""


def _relative(statistics: EpisodeStatistics, assignment: IntArray, style: int) -> tuple[str, ...]:
    num_here = int(np.count_nonzero(assignment == style))
    if min(num_here, len(assignment) - num_here) < FEWEST_EPISODES:
        return (_TOO_FEW,)
    clear = [found for found in differences(statistics, assignment, style) if found.is_clear]
    told: list[Difference] = []
    ranks: list[FloatArray] = []
    for found in sorted(_one_a_source(clear, statistics.names), key=lambda one: one.statistic.is_outcome):
        mine = rankdata(statistics[found.statistic.name])
        if all(abs(np.corrcoef(mine, known)[0, 1]) <= MOST_RANK_CORRELATION for known in ranks):
            told.append(found)
            ranks.append(mine)
        if len(told) == MOST_SENTENCES:
            break
    said = [_sentence(found) for found in told]
    return (*said, *_from_nearest(statistics, assignment, style, told)) or (_NOTHING,)


def _from_nearest(
    statistics: EpisodeStatistics, assignment: IntArray, style: int, told: Sequence[Difference]
) -> tuple[str, ...]:
    """One sentence that sets a style apart from the one that `told` tells it from worst, if they leave it to say.

    Of styles that are told apart equally badly, the one whose average episode is less different comes first; those
    with too few episodes, or nothing to set them apart, are passed over.
    """
    others = [other for other in np.unique(assignment).tolist() if other != style]
    if len(others) < 2:
        return ()
    columns = [statistics.names.index(one.statistic.name) for one in told]
    told_only = EpisodeStatistics(tuple(one.statistic for one in told), statistics.values[:, columns])
    apart = {other: _most_telling(_between(told_only, assignment, style, other)) for other in others}
    away = {other: _distance(statistics, assignment, style, other) for other in others}
    for other in sorted(others, key=lambda other: (apart[other], away[other])):
        if apart[other] >= TOLD_APART:
            break
        clear = [found for found in _between(statistics, assignment, style, other) if found.is_clear]
        better = [found for found in clear if found.auc_distance >= apart[other] + LEAST_AUC_DISTANCE]
        played = sorted(_one_a_source(better, statistics.names), key=lambda one: one.statistic.is_outcome)
        if played:
            return (_sentence(played[0], f" in style {other}"),)
    return ()


def _between(statistics: EpisodeStatistics, assignment: IntArray, style: int, other: int) -> tuple[Difference, ...]:
    """How the episodes of a style differ from those of one other."""
    rows = np.flatnonzero((assignment == style) | (assignment == other))
    return differences(EpisodeStatistics(statistics.statistics, statistics.values[rows]), assignment[rows], style)


def _most_telling(found: Sequence[Difference]) -> float:
    return max((one.auc_distance for one in found), default=0.0)


def _distance(statistics: EpisodeStatistics, assignment: IntArray, style: int, other: int) -> float:
    """Between the average episodes of two styles, in standard deviations of each statistic."""
    here, there = (statistics.values[assignment == one].mean(axis=0) for one in (style, other))
    spread = statistics.values.std(axis=0)
    return float(np.linalg.norm((here - there)[spread > 0] / spread[spread > 0]))


def _one_a_source(ranked: Sequence[Difference], names: Sequence[str]) -> list[Difference]:
    """One difference of each source, in the order of their best: of those about as telling, the simplest to say.

    `names` are the statistics, the simplest of a source first.
    """
    found: dict[str, list[Difference]] = {}
    for one in ranked:
        found.setdefault(one.statistic.source, []).append(one)
    return [
        min(
            (one for one in several if one.auc_distance >= several[0].auc_distance - _AS_TELLING),
            key=lambda one: names.index(one.statistic.name),
        )
        for several in found.values()
    ]


def _absolute(statistics: EpisodeStatistics) -> tuple[str, ...]:
    """How long episodes last, then the leading average of each signal, actions first."""
    leading: dict[str, tuple[Statistic, float]] = {}
    for statistic, mean in zip(statistics.statistics, statistics.values.mean(axis=0).tolist(), strict=True):
        known = leading.get(statistic.source)
        larger_share = known is not None and _field(statistic.phrase) == "percent" and mean > known[1]
        if known is None or larger_share:
            leading[statistic.source] = (statistic, mean)
    steps = leading.pop("steps")
    played = [one for one in reversed(leading.values()) if not one[0].is_outcome and one[1] != 0]
    return tuple(
        statistic.phrase.format(**_shown(statistic.phrase, (mean,))[0])
        for statistic, mean in [steps, *played][:MOST_SENTENCES]
    )


def _sentence(found: Difference, place: str = "") -> str:
    """Such as `distance comes as low as 0.8 against 1.3 (d = -3.1)`, with the place behind the second number."""
    phrase = found.statistic.phrase
    here, elsewhere = _shown(phrase, (found.here, found.elsewhere))
    effect = found.effect_size
    if abs(effect) > _MOST_SHOWN_EFFECT:
        size = f"d {'>' if effect > 0 else '<'} {math.copysign(_MOST_SHOWN_EFFECT, effect):.0f}"
    else:
        size = f"d = {_numbers((effect,))[0]}"
    return f"{phrase.format(**here)} against {elsewhere[_field(phrase)]}{place} ({size})"


def _field(phrase: str) -> str:
    """The name of the phrase's one field: `number` or `percent`."""
    (field,) = (name for _, name, _, _ in Formatter().parse(phrase) if name)
    return field


def _shown(phrase: str, values: Sequence[float]) -> list[dict[str, str]]:
    """What fills the phrase's field, for each of the values."""
    field = _field(phrase)
    if field == "percent":
        return [{field: f"{number}%"} for number in _numbers([100 * value for value in values])]
    return [{field: number} for number in _numbers(values)]


def _numbers(values: Sequence[float]) -> list[str]:
    """The values to two significant digits of the largest, to more where different ones would read the same.

    >>> _numbers((0.84, 1.31)), _numbers((1.0, 1e-17)), _numbers((14.21, 14.18)), _numbers((1234.0, 0.0))
    (['0.8', '1.3'], ['1.0', '0.0'], ['14.21', '14.18'], ['1200', '0'])
    """
    largest = max(abs(value) for value in values)
    if largest == 0:
        return ["0.0"] * len(values)
    magnitude = math.floor(math.log10(largest))
    shown: list[str] = []
    for digits in range(2, 7):
        decimals = digits - 1 - magnitude
        if -4 <= magnitude < 7:
            shown = [f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}" for value in values]
        else:
            shown = [f"{value:.{digits - 1}e}" for value in values]
        if len(set(shown)) == len(set(values)):
            break
    return shown
