"""Words about styles: what is known to set the demonstrators apart is said, and nothing else."""

import math

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.envs.zombie import zombie_demonstrations
from tvae.evaluate import differences as compared
from tvae.evaluate import words
from tvae.evaluate.differences import differences, evenly
from tvae.evaluate.statistics import EpisodeStatistics, Statistic
from tvae.evaluate.words import describe
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

NOTHING = ("nothing sets it apart from the other episodes",)
ATTACK, AVOID = 0, 1


@pytest.fixture(scope="module")
def zombies():
    return zombie_demonstrations(200)


@pytest.fixture(scope="module")
def styles(zombies):
    return (zombies.attribute("label") == "avoid").astype(np.int64)


def table(*columns, **named):
    named = {f"x{k}": column for k, column in enumerate(columns)} | named
    statistics = tuple(Statistic(f"{name}.mean", name, f"{name} is {{number}}") for name in named)
    return EpisodeStatistics(statistics, np.stack(list(named.values()), axis=1).astype(np.float64))


def recorded(actions, space):
    episodes = [Trajectory(np.zeros((len(rows), 0)), np.array(rows, dtype=np.float64)) for rows in actions]
    return Demonstrations.from_trajectories(episodes, Space(()), space)


def test_attackers_and_avoiders(zombies, styles):
    said = describe(zombies, styles)
    assert said[ATTACK][0] == "attack happens 1.0 times an episode against 0.0 (d > 10)"
    assert said[AVOID][0] == "attack happens 0.0 times an episode against 1.0 (d < -10)"
    assert said[ATTACK][1].startswith("distance_to_zombie comes as low as 0.4 against 1.7 (d = -")
    assert said[AVOID][1].startswith("distance_to_zombie comes as low as 1.7 against 0.4 (d = ")
    for sentences in said.values():
        assert 2 <= len(sentences) <= 4
        assert not any("zombie_dead" in sentence or "attacks" in sentence for sentence in sentences)


def test_order_of_episodes_does_not_matter(zombies, styles):
    order = np.random.default_rng(1).permutation(len(zombies))
    assert describe(zombies.select(order), styles[order]) == describe(zombies, styles)


def test_numbers_against_their_definitions():
    random = np.random.default_rng(0)
    values, style = random.normal(size=(60, 5)), random.integers(0, 3, 60)
    values[style == 1, 2] += 2
    found = differences(table(*values.T), style, 1)
    here, elsewhere = values[style == 1], values[style != 1]
    assert found[0].statistic.name == "x2.mean"
    assert len(found) == 5
    adjusted = []
    for one in found:
        k = int(one.statistic.name[1])
        a, b = here[:, k], elsewhere[:, k]
        assert one.here == pytest.approx(a.mean())
        assert one.elsewhere == pytest.approx(b.mean())
        assert one.auc == pytest.approx(np.mean(a[:, None] > b))
        variance = ((len(a) - 1) * a.var(ddof=1) + (len(b) - 1) * b.var(ddof=1)) / (len(style) - 2)
        assert one.effect_size == pytest.approx((a.mean() - b.mean()) / math.sqrt(variance))
        adjusted.append((mannwhitneyu(a, b, method="asymptotic").pvalue, one.p_value))
    adjusted.sort()
    expected = np.minimum.accumulate([p * 5 / rank for rank, (p, _) in reversed([*enumerate(adjusted, 1)])])[::-1]
    np.testing.assert_allclose([p for _, p in adjusted], np.minimum(expected, 1))
    assert [one.auc_distance for one in found] == sorted((one.auc_distance for one in found), reverse=True)


def test_identical_styles(zombies):
    twice = zombies.select(np.repeat(np.arange(50), 2))
    assert describe(twice, np.arange(100) % 2) == {0: NOTHING, 1: NOTHING}


def test_styles_at_random(zombies, styles):
    """Attackers dealt out by chance: what chance brings is not told."""
    attackers = zombies.select(np.flatnonzero(styles == ATTACK))
    for seed in range(5):
        dealt = np.random.default_rng(seed).permutation(np.arange(100) % 2)
        assert describe(attackers, dealt) == {0: NOTHING, 1: NOTHING}


def test_constant_signals():
    """Equal but for rounding, in episodes whose lengths differ with the style: only the lengths are told."""
    style = np.arange(40) % 2
    play = recorded([[[0.1]] * (3 + 4 * s) for s in style], Space((Continuous("speed"),)))
    assert describe(play, style) == {
        0: ("lasts 3.0 steps against 7.0 (d < -10)",),
        1: ("lasts 7.0 steps against 3.0 (d > 10)",),
    }
    same = recorded([[[0.1]] * 3] * 40, Space((Continuous("speed"),)))
    assert describe(same, style) == {0: NOTHING, 1: NOTHING}


def test_zero_variance():
    style = np.array([0] * 6 + [1] * 6)
    found = {one.statistic.name: one for one in differences(table(style, 1 - style, 0 * style), style, 1)}
    assert found["x0.mean"].effect_size == math.inf
    assert found["x1.mean"].effect_size == -math.inf
    assert "x2.mean" not in found


def test_shares_are_percentages():
    moves = Space((Categorical("move", ("left", "{right}")),))
    style = np.arange(20) % 2
    said = describe(recorded([[[s], [1]] for s in style], moves), style)
    assert said[1] == ("move is left 0% of the time against 50% (d < -10)",)
    assert describe(recorded([[[1]]] * 5, moves), np.zeros(5, dtype=np.int64))[0] == (
        "lasts 1.0 steps",
        "move is {right} 100% of the time",
    )


def test_what_ranks_alike_is_told_once():
    random = np.random.default_rng(0)
    style = np.arange(60) % 2
    cause = random.normal(size=60) + 3 * style
    other = random.normal(size=60) + 2 * style
    said = words._relative(table(cause=cause, echo=np.exp(-cause), other=other), style, 1)
    assert [sentence.split()[0] for sentence in said] in (["cause", "other"], ["echo", "other"])


def test_outcomes_come_last():
    style = np.arange(60) % 2
    random = np.random.default_rng(0)
    played, won = style + random.normal(size=60), style + 0.01 * random.normal(size=60)
    told = table(played=played, won=won)
    played_as, won_as = told.statistics
    outcome = Statistic(won_as.name, won_as.source, won_as.phrase, is_outcome=True)
    said = words._relative(EpisodeStatistics((played_as, outcome), told.values), style, 1)
    assert [sentence.split()[0] for sentence in said] == ["played", "won"]


def test_what_tells_a_style_from_its_nearest():
    """0 and 1 press, 2 does not; only where they stand tells 0 from 1, and 0 stands amid the others."""
    random, style = np.random.default_rng(0), np.arange(90) % 3
    stands = np.array([0.0, 5.0, -5.0])[style] + random.normal(size=90)
    space = Space((Binary("press"), Continuous("x")))
    play = recorded([[[int(s < 2), x]] * 3 for s, x in zip(style, stands, strict=True)], space)
    said = describe(play, style)
    assert said[0][0].startswith("press happens 3.0 times an episode against 1.5 (d = ")
    (nearest,) = (sentence for sentence in said[0] if "in style" in sentence)
    assert nearest.startswith("x is ")
    assert " in style 1 (d = -" in nearest
    assert said[0][-1] == nearest
    assert not any("in style" in sentence for sentence in (*said[1], *said[2]))


def test_in_the_middle_of_two():
    """Nothing sets the middle one apart from the others together; the nearer of them is named."""
    random, style = np.random.default_rng(0), np.arange(90) % 3
    values = np.array([0.0, 9.0, -5.0])[style] + random.normal(size=90)
    (said,) = words._relative(table(x=values), style, 0)
    assert said.startswith("x is ")
    assert " in style 2 (d = " in said


def test_left_and_right():
    """Three styles: straight ahead, to the left, to the right, equally sharply."""
    random, style = np.random.default_rng(0), np.arange(60) % 3
    turns = np.array([0.0, 0.2, -0.2])[style]
    headings = [(random.uniform(-3, 3) + rate * np.arange(20) + np.pi) % (2 * np.pi) - np.pi for rate in turns]
    said = describe(recorded([column[:, None] for column in headings], Space((Angular("heading"),))), style)
    assert said[1][0] == "heading turns by a net 3.8 rad against -1.9 (d = 3.6)"
    assert said[2][0] == "heading turns by a net -3.8 rad against 1.9 (d = -3.6)"
    assert said[0][0] == "heading keeps to one direction by 100% against 50% (d > 10)"


def test_nearest_by_chance(zombies, styles):
    """A style dealt into two by chance: nothing tells the halves apart, and the third is told already."""
    attackers = np.flatnonzero(styles == ATTACK)
    for seed in range(5):
        dealt = styles + 1
        dealt[attackers] = 2 * np.random.default_rng(seed).permutation(len(attackers)) // len(attackers)
        dealt[styles == AVOID] = 2
        said = describe(zombies, dealt)
        assert said[2][0].startswith("attack happens 0.0 times")
        assert not any("in style" in sentence for sentences in said.values() for sentence in sentences)


def test_effect_sizes_are_explained_where_there_are_any(zombies, styles):
    said = describe(zombies, styles)
    assert words.explanation([*said[ATTACK], *said[AVOID]]).startswith("d is Cohen's d")
    assert words.explanation([]) == words.explanation(NOTHING) == ""
    assert words.explanation(describe(zombies, np.zeros(len(zombies), dtype=np.int64))[0]) == ""


def test_one_style(zombies):
    (sentences,) = describe(zombies, np.full(len(zombies), 7)).values()
    assert sentences[0] == "lasts 15 steps"
    assert "attack happens 0.50 times an episode" in sentences
    assert len(sentences) == 4


def test_too_few_episodes(zombies, styles):
    few = styles.copy()
    few[np.flatnonzero(styles == AVOID)[:2]] = 2
    said = describe(zombies, few)
    assert said[2] == ("too few episodes to compare",)
    assert said[ATTACK][0].startswith("attack happens 1.0 times")
    assert differences(EpisodeStatistics.of(zombies), few, 2) == ()


def test_many_episodes_are_tested_by_a_part(zombies, styles, monkeypatch):
    monkeypatch.setattr(compared, "MOST_TESTED", 20)
    assert [said[0] for said in describe(zombies, styles).values()] == [
        "attack happens 1.0 times an episode against 0.0 (d > 10)",
        "attack happens 0.0 times an episode against 1.0 (d < -10)",
    ]
    monkeypatch.setattr(words, "MOST_TOLD", 20)
    assert {said[0][:14] for said in describe(zombies, styles).values()} == {"attack happens"}
    assert evenly(np.arange(100), 20).tolist() == list(range(0, 100, 5))


def test_a_rare_style_among_many():
    style = np.zeros(30_000, dtype=np.int64)
    style[:30] = 1
    pressed = recorded(style[:, None, None].tolist(), Space((Binary("press"),)))
    assert describe(pressed, style)[1] == ("press happens 1.0 times an episode against 0.0 (d > 10)",)


def test_assignment_of_another_length(zombies):
    with pytest.raises(ValueError, match="200 episodes need as many styles"):
        describe(zombies, np.zeros(3, dtype=np.int64))


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ((0.0, 0.0), ["0.0", "0.0"]),
        ((-0.01, 2.0), ["0.0", "2.0"]),
        ((99.96, 1.0), ["100", "1"]),
        ((123456.0, 4.0), ["120000", "0"]),
        ((1.5e9, -2e9), ["1.5e+09", "-2.0e+09"]),
        ((1.5e-7, 3e-7), ["1.5e-07", "3.0e-07"]),
        ((0.0123, 0.002), ["0.012", "0.002"]),
        ((100.1, 100.4), ["100.1", "100.4"]),
    ],
)
def test_numbers_are_readable(values, shown):
    assert words._numbers(values) == shown
