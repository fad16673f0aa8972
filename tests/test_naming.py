"""Names of a user's own for styles: what may be one, and where they show."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tvae.errors import TvaeError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.findings import Findings
from tvae.experiments.joining import groups_with
from tvae.experiments.naming import names_in


@pytest.fixture(scope="module")
def findings() -> Findings:
    """Three styles, of which the first two have labels."""
    random = np.random.default_rng(0)
    middles = np.repeat([[-3.0, 0.0], [3.0, 0.0], [0.0, 6.0]], (60, 50, 40), axis=0)
    playstyles = find_playstyles(Posteriors(middles + 0.2 * random.normal(size=(150, 2)), np.full((150, 2), 0.2)))
    assert len(playstyles) == 3
    return Findings(playstyles, {0: "attack", 1: "avoid"}, {0: (), 1: (), 2: ()})


def names(findings: Findings) -> list[str]:
    return [findings.name(style) for style in findings.playstyles.styles]


def test_own_names_come_before_labels(findings: Findings) -> None:
    own = findings.renamed(names_in(["0=campers", "style 2= the rest "], findings))
    assert names(own) == ["campers", "avoid", "the rest"]
    assert [own.title(style) for style in own.playstyles.styles][1:] == ["avoid (style 1)", "the rest (style 2)"]
    assert [own.style(name).index for name in ("campers", "attack", "0", "style 0", "the rest")] == [0, 0, 0, 0, 2]
    assert names(findings) == ["attack", "avoid", "style 2"]


def test_names_are_kept_and_can_be_changed(findings: Findings) -> None:
    own = Findings.from_json(json.loads(json.dumps(findings.renamed({0: "a=b", 1: "[red]"}).to_json())))
    assert names(own) == ["a=b", "[red]", "style 2"]
    swapped = own.renamed(names_in(["0=[red]", "1=a=b"], own))
    assert names(swapped) == ["[red]", "a=b", "style 2"]
    assert names(swapped.renamed({0: "attack"})) == ["attack", "a=b", "style 2"]


def test_findings_of_before_have_no_own_names(findings: Findings) -> None:
    before = findings.to_json()
    del before["names"]
    assert names(Findings.from_json(before)) == names(findings)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["campers"], "--rename needs STYLE=NAME, such as 0=campers, got 'campers'"),
        (["7=campers"], r"there is no style '7'; there are: 0 \(attack\), 1 \(avoid\), 2 \(style 2\)"),
        (["-1=campers"], "there is no style '-1'"),
        (["0="], "the name of style 0 must be a line of text, got ''"),
        (["0=  "], "the name of style 0 must be a line of text, got ''"),
        (["0=two\nlines"], r"must be a line of text, got 'two\\nlines'"),
        (["0=a", "attack=b"], "--rename names style 0 twice: 'a' and 'b'"),
        (["0=same", "1=same"], r"style 0 cannot be 'same': that already means same \(style 1\)"),
        (["0=avoid"], r"style 0 cannot be 'avoid': that already means avoid \(style 1\)"),
        (["0=avoid", "1=runners"], r"style 0 cannot be 'avoid': that already means runners \(style 1\)"),
        (["0=2"], "style 0 cannot be '2': that already means style 2"),
        (["0=style 2"], "style 0 cannot be 'style 2': that already means style 2"),
    ],
)
def test_names_that_cannot_be(findings: Findings, given: list[str], said: str) -> None:
    with pytest.raises(TvaeError, match=said):
        findings.renamed(names_in(given, findings))


def test_metrics_are_shown_by_name(findings: Findings) -> None:
    own = findings.renamed({0: "campers"})
    metrics = {
        "success": {"attack": 0.9, "avoid": 0.8},
        "ci95": {"success": {"attack": [0.8, 1.0], "avoid": [0.7, 0.9]}},
        "playstyles": {"shares": {"attack": 0.4, "avoid": 0.3, "style 2": 0.3}, "num_found": 3},
        "nats_per_trajectory": {"held_out": {"kl": 1.0}},
        "attack": 1,
        "warnings": [],
        "nothing": {},
    }
    shown = own.shown(metrics)
    assert shown["success"] == {"campers": 0.9, "avoid": 0.8}
    assert shown["ci95"]["success"].keys() == {"campers", "avoid"}
    assert shown["playstyles"]["shares"] == {"campers": 0.4, "avoid": 0.3, "style 2": 0.3}
    assert {key: shown[key] for key in ("nats_per_trajectory", "attack", "warnings", "nothing")} == {
        key: metrics[key] for key in ("nats_per_trajectory", "attack", "warnings", "nothing")
    }


def test_styles_to_join_are_told_by_number_name_or_label(findings: Findings) -> None:
    named = findings.renamed({2: "runners"})
    assert groups_with(["runners", "avoid"], named) == [(1, 2)]
    parts = ((0, 3), (1, 4), (2,))
    before = replace(named, playstyles=replace(named.playstyles, parts=parts))
    assert groups_with(["0", "runners"], before) == [(0, 2, 3), (1, 4)]
    with pytest.raises(TvaeError, match="--join needs two styles or more, such as --join 0 2, got 1 avoid"):
        groups_with(["1", "avoid"], named)
    with pytest.raises(TvaeError, match="there is no style '7'"):
        groups_with(["0", "7"], named)
