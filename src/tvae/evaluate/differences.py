"""How the episodes of a style differ from others, in numbers.

A style's episodes are compared with all others, one statistic x at a time:

    d   = (mean here - mean elsewhere) / pooled standard deviation                 (Cohen 1988)
    AUC = P(x here > x elsewhere) + 1/2 P(x here = x elsewhere) = U / (n1 n2)       (McGraw and Wong 1992)

with the p-value of the Mann-Whitney U test, adjusted after Benjamini and Hochberg over the statistics of a style.
The styles were found in these same episodes, so p-values are no evidence that the styles exist; they only keep
chance out of the description.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import false_discovery_control, mannwhitneyu

from tvae.evaluate.statistics import EpisodeStatistics, Statistic
from tvae.spaces import FloatArray, IntArray

FEWEST_EPISODES = 3
"""Fewer episodes than this, here or elsewhere, are not compared."""
SIGNIFICANCE = 0.05
LEAST_AUC_DISTANCE = 0.1
MOST_TESTED = 10_000
"""Tests see at most so many episodes of each side, evenly taken."""

_DECIMALS_OF_SCALE = 10
"""Differences below 1e-10 of a statistic's largest value are rounding noise."""


@dataclass(frozen=True, slots=True)
class Difference:
    """How a style differs from other episodes in one statistic."""

    statistic: Statistic
    here: float
    """Mean over the episodes of the style."""
    elsewhere: float
    """Mean over the other episodes."""
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
    first, second = relative[evenly(here, MOST_TESTED)], relative[evenly(elsewhere, MOST_TESTED)]
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


def evenly(episodes: IntArray, most: int) -> IntArray:
    """At most `most` of them, evenly taken.

    >>> evenly(np.arange(100), 4)
    array([ 0, 25, 50, 75])
    """
    count = min(len(episodes), most)
    return episodes[np.arange(count) * len(episodes) // count]
