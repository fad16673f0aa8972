"""What sets each style apart, in plain words.

A style's episodes are compared with all others, one statistic x at a time:

    d   = (mean here - mean elsewhere) / pooled standard deviation                 (Cohen 1988)
    AUC = P(x here > x elsewhere) + 1/2 P(x here = x elsewhere) = U / (n1 n2)       (McGraw and Wong 1992)

with the p-value of the Mann-Whitney U test, adjusted after Benjamini and Hochberg over the statistics of a style.
The styles were found in these same episodes, so p-values are no evidence that the styles exist; they only keep
chance out of the description.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from string import Formatter

import numpy as np
from scipy.stats import false_discovery_control, mannwhitneyu, rankdata

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.statistics import EpisodeStatistics, Statistic
from tvae.spaces import FloatArray, IntArray

MOST_SENTENCES = 4
FEWEST_EPISODES = 3
"""Fewer episodes than this, here or elsewhere, are not compared."""
SIGNIFICANCE = 0.05
LEAST_AUC_DISTANCE = 0.1
MOST_RANK_CORRELATION = 0.9
"""Two statistics that correlate more than this say the same."""
MOST_TOLD = 100_000
"""Of more episodes, styles are described by as many, evenly taken."""
MOST_TESTED = 10_000
"""Tests see at most so many episodes of each side, evenly taken."""

_TOO_FEW = "too few episodes to compare"
_NOTHING = "nothing sets it apart from the other episodes"
_MOST_SHOWN_EFFECT = 10.0
_AS_TELLING = 0.02
"""Statistics of one signal whose AUC distances differ by less are equally telling."""
_DECIMALS_OF_SCALE = 10
"""Differences below 1e-10 of a statistic's largest value are rounding noise."""


@dataclass(frozen=True, slots=True)
class Difference:
    """How a style differs from all other episodes in one statistic."""

    statistic: Statistic
    here: float
    """Mean over the episodes of the style."""
    elsewhere: float
    """Mean over all other episodes."""
    effect_size: float
    """Cohen's d; infinite where neither side varies but their values differ."""
    auc: float
    """Probability that an episode here has the larger value than one elsewhere, ties counted half."""
    p_value: float
    """Two-sided, adjusted over the statistics of the style."""

    @property
    def auc_distance(self) -> float:
        """abs(AUC - 1/2): 0 where the sides cannot be told apart, 1/2 where they never overlap."""
        return abs(self.auc - 0.5)

    @property
    def is_clear(self) -> bool:
        """Whether it is significant and large enough to tell, and the means differ the way the ranks do."""
        return (
            self.p_value < SIGNIFICANCE
            and self.auc_distance >= LEAST_AUC_DISTANCE
            and (self.auc - 0.5) * self.effect_size > 0
        )


def describe(demonstrations: Demonstrations, assignment: IntArray) -> dict[int, tuple[str, ...]]:
    """For each style, in at most four sentences, what sets it apart from all other episodes.

    `assignment` (E,) is the style of each episode. How the episodes were played comes first; what came of it,
    `return` and `info.*`, only where there is room. A signal is told once, and not if it ranks the episodes as
    one told already does. A single style is described by itself.

    >>> from tvae.envs.zombie import zombie_demonstrations
    >>> episodes = zombie_demonstrations(num_episodes=40)
    >>> attacks = (episodes.attribute("label") == "attack").astype(np.int64)
    >>> describe(episodes, attacks)[1][0]
    'attack happens 1.0 times an episode against 0.0 (d > 10)'
    """
    if assignment.shape != (len(demonstrations),):
        raise ValueError(f"{len(demonstrations)} episodes need as many styles, got the shape {assignment.shape}")
    of_each = np.unique(assignment, return_index=True)[1]
    told = np.union1d(of_each, _evenly(np.arange(len(assignment)), MOST_TOLD))
    statistics, assignment = EpisodeStatistics.of(demonstrations.select(told)), assignment[told]
    styles = np.unique(assignment).tolist()
    if len(styles) == 1:
        return {styles[0]: _absolute(statistics)}
    return {style: _relative(statistics, assignment, style) for style in styles}


def differences(statistics: EpisodeStatistics, assignment: IntArray, style: int) -> tuple[Difference, ...]:
    """How the episodes of a style differ from all others, the most telling first: by AUC distance, then abs(d).

    One difference for each statistic that is not constant; `Difference.is_clear` tells which to believe. None
    where fewer than three episodes are here or elsewhere.

    >>> jumps = Statistic("jump.count", "jump", "jump happens {number} times an episode")
    >>> statistics = EpisodeStatistics((jumps,), np.array([[0.0], [1.0], [0.0], [2.0], [3.0], [3.0]]))
    >>> (found,) = differences(statistics, np.array([0, 0, 0, 1, 1, 1]), style=1)
    >>> round(found.here, 2), round(found.elsewhere, 2), found.auc, round(found.effect_size, 2)
    (2.67, 0.33, 1.0, 4.04)
    """
    order = np.argsort(assignment, kind="stable")
    inside = assignment[order] == style
    here, elsewhere = order[inside], order[~inside]
    if min(len(here), len(elsewhere)) < FEWEST_EPISODES:
        return ()
    scale = np.abs(statistics.values).max(axis=0)
    relative = np.round(statistics.values / np.where(scale > 0, scale, 1.0), _DECIMALS_OF_SCALE)
    varying = np.flatnonzero(np.ptp(relative, axis=0) > 0)
    if len(varying) == 0:
        return ()
    relative = relative[:, varying]
    first, second = relative[_evenly(here, MOST_TESTED)], relative[_evenly(elsewhere, MOST_TESTED)]
    with np.errstate(divide="ignore", invalid="ignore"):  # a column that varies, but not in what is tested
        test = mannwhitneyu(first, second, axis=0, method="asymptotic")
    columns = zip(
        varying.tolist(),
        statistics.values[here][:, varying].mean(axis=0).tolist(),
        statistics.values[elsewhere][:, varying].mean(axis=0).tolist(),
        _effect_sizes(relative[here], relative[elsewhere]).tolist(),
        (test.statistic / (len(first) * len(second))).tolist(),
        false_discovery_control(np.nan_to_num(test.pvalue, nan=1.0)).tolist(),
        strict=True,
    )
    found = [Difference(statistics.statistics[k], *numbers) for k, *numbers in columns]
    return tuple(sorted(found, key=lambda one: (-one.auc_distance, -abs(one.effect_size))))


def _effect_sizes(here: FloatArray, elsewhere: FloatArray) -> FloatArray:
    """(K,) Cohen's d of the columns of (n1, K) against (n2, K)."""
    difference = here.mean(axis=0) - elsewhere.mean(axis=0)
    squares = [len(side) * side.var(axis=0) for side in (here, elsewhere)]
    pooled = np.sqrt(sum(squares) / (len(here) + len(elsewhere) - 2))
    noise = 10.0**-_DECIMALS_OF_SCALE
    difference[np.abs(difference) < noise] = 0.0
    without = np.where(difference == 0, 0.0, np.copysign(np.inf, difference))
    return np.divide(difference, pooled, out=without, where=pooled >= noise)


def _evenly(episodes: IntArray, most: int) -> IntArray:
    """At most `most` of them, evenly taken."""
    count = min(len(episodes), most)
    return episodes[np.arange(count) * len(episodes) // count]


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
    return tuple(_sentence(found) for found in told) or (_NOTHING,)


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


def _sentence(found: Difference) -> str:
    """Such as `distance comes as low as 0.8 against 1.3 (d = -3.1)`."""
    phrase = found.statistic.phrase
    here, elsewhere = _shown(phrase, (found.here, found.elsewhere))
    effect = found.effect_size
    if abs(effect) > _MOST_SHOWN_EFFECT:
        size = f"d {'>' if effect > 0 else '<'} {math.copysign(_MOST_SHOWN_EFFECT, effect):.0f}"
    else:
        size = f"d = {_numbers((effect,))[0]}"
    return f"{phrase.format(**here)} against {elsewhere[_field(phrase)]} ({size})"


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
