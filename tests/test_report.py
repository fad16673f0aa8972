"""The report is one valid page that holds what it is given, and nothing that it should not."""

import hashlib
import json
import re
from base64 import b64encode
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.figures.palette import style_colour
from tvae.figures.trajectories import draw_trajectory
from tvae.report import views
from tvae.report.content import ReportContent, StyleSection
from tvae.report.page import render, write
from tvae.report.pictures import in_proportion, spread
from tvae.report.tables import Measured, measured, metric_rows, share
from tvae.spaces import Binary, Continuous, Space
from tvae.train.checkpoint import Record
from tvae.train.terms import Terms

HOSTILE = '</script><script>alert("1")</script><img src=x onerror=alert(1)>'
VOID = {"meta", "link", "br", "img", "hr", "input"}


class Page(HTMLParser):
    """Reads a page back; raises where elements are not closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.feed(html)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        assert len(dict(attrs)) == len(attrs), f"an attribute of {tag} twice"
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag, f"</{tag}> closes another element"

    def handle_data(self, data):
        inside = self.open[-1] if self.open else ""
        if inside == "script":
            self.scripts.append(data)
        elif inside != "style" and data.strip():
            self.words.append(data.strip())

    @property
    def ids(self) -> list[str | None]:
        return [attrs["id"] for _, attrs in self.tags if "id" in attrs]

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    @property
    def data(self):
        return json.loads(self.scripts[0])


def _walks(count, names=("x", "y"), ids=None):
    rng = np.random.default_rng(0)
    walks = [
        Trajectory(
            np.cumsum(rng.normal(size=(6, len(names))), 0),
            (rng.random((5, 1)) < 0.3).astype(float),
            attributes={
                "episode": f"walk {i}" if ids is None else ids[i],
                "label": "north" if i % 2 else "south",
            },
        )
        for i in range(count)
    ]
    return Demonstrations.from_trajectories(walks, Space(tuple(map(Continuous, names))), Space((Binary("jump"),)))


def _style(index, demonstrations, **fields):
    draw = partial(
        draw_trajectory,
        observation_space=demonstrations.observation_space,
        action_space=demonstrations.action_space,
        colour=style_colour(index),
    )
    defaults = {"name": f"style {index}", "weight": 0.5, "draw": draw, "prototypes": (index, index + 2)}
    return StyleSection(**{**defaults, **fields})


def _content(count=12, **fields):
    demonstrations = fields.pop("demonstrations", None) or _walks(count)
    rng = np.random.default_rng(1)
    defaults = {
        "title": "walks.csv",
        "verdict": "Two playstyles were found.",
        "demonstrations": demonstrations,
        "episode_ids": tuple(str(i) for i in demonstrations.attribute("episode")),
        "latent_means": rng.normal(size=(count, 2)),
        "assignment": np.arange(count) % 2,
        "probability": np.full(count, 0.9),
        "styles": (_style(0, demonstrations), _style(1, demonstrations)),
        "command": "tvae fit walks.csv",
        "version": "0.1.0",
        "created": "3 March 2026",
    }
    return ReportContent(**{**defaults, **fields})


def _full():
    demonstrations = _walks(12)
    played = _walks(40)
    succeeded = np.arange(40) % 10 != 0
    terms = Terms(-3.0, -2.0, -1.0, 1.0)
    return _content(
        demonstrations=demonstrations,
        styles=(
            _style(
                0,
                demonstrations,
                label="south",
                sentences=("Goes south.",),
                test_episodes=played,
                succeeded=succeeded,
            ),
            _style(1, demonstrations, label="north", sentences=("Goes north.",)),
        ),
        run="walks-1",
        warnings=("Little data.",),
        metrics={"ari": 0.93, "held_out": {"policy": -3.25}, "success": {"north": 0.5}},
        records=(Record(0, 1.0, terms, terms), Record(100, 2.0, terms, terms)),
        config={"seed": 7},
        versions={"torch": "2.9.0"},
    )


@pytest.fixture(scope="module")
def full() -> str:
    return render(_full())


class TestPage:
    def test_is_valid_with_every_section(self, full):
        page = Page(full)
        assert full.startswith("<!doctype html>")
        assert len(page.ids) == len(set(page.ids))
        assert {"styles", "latent", "test", "training", "metrics", "made"} <= set(page.ids)
        links = [attrs["href"] for tag, attrs in page.tags if tag == "a"]
        assert {link.removeprefix("#") for link in links} <= set(page.ids)

    def test_needs_nothing_but_itself(self, full):
        for tag, attrs in Page(full).tags:
            assert tag not in {"link", "iframe", "object", "base"}
            for name in ("src", "href", "xlink:href", "action"):
                assert attrs.get(name, "#").startswith("#"), f"{tag} {name}"
        assert "http://" not in full
        assert "https://" not in full
        assert "@import" not in full
        assert "url(" not in full

    def test_allows_its_own_script_and_no_other(self, full):
        policy = next(a["content"] for t, a in Page(full).tags if a.get("http-equiv") == "Content-Security-Policy")
        digest = b64encode(hashlib.sha256(Page(full).scripts[1].encode()).digest()).decode()
        assert f"script-src 'sha256-{digest}'" in policy
        assert "default-src 'none'" in policy

    def test_says_what_it_was_given(self, full):
        text = Page(full).text
        for words in (
            "2 playstyles in walks.csv",
            "12 sessions, 60 steps, 3 signals; run walks-1",
            "Two playstyles were found.",
            "Little data.",
            "playstyles found 2",
            "agreement with the labels 0.93",
            "success of south 90 % 95 % interval",
            "success of north 50 %",
            "demonstrations 12 60 steps",
            "Goes south.",
            "found as style 0",
            "90 % succeeded, 36 of 40 episodes",
            "held_out / policy -3.25",
            "tvae fit walks.csv",
            "torch 2.9.0",
            '"seed": 7',
        ):
            assert words in text, words

    def test_is_the_same_for_the_same_content(self, full):
        assert render(_full()) == full

    def test_stays_small(self, full):
        assert len(full) < 400_000

    def test_works_in_light_and_dark_and_on_paper(self, full):
        assert full.count("prefers-color-scheme: dark") == 2
        assert "@media print" in full
        assert f"--style-0: {style_colour(0)}" in full

    def test_is_written_whole_or_not_at_all(self, tmp_path: Path, full):
        path = tmp_path / "report.html"
        path.write_text("old")
        write(_full(), path)
        assert path.read_text(encoding="utf-8") == full
        assert list(tmp_path.iterdir()) == [path]
        before = path.read_text(encoding="utf-8")
        broken = _content(styles=(_style(0, _walks(12), draw=lambda axes, walk: 1 / 0), _style(1, _walks(12))))
        with pytest.raises(ZeroDivisionError):
            write(broken, path)
        assert path.read_text(encoding="utf-8") == before


class TestHeadline:
    def test_agreement_and_success_are_those_of_the_metrics_with_their_intervals(self):
        metrics = {
            "playstyles": {"ari": 0.87},
            "success": {"style 0": 0.9},
            "ci95": {"success": {"style 0": [0.8, 0.97]}},
            "test_episodes": 50,
        }
        page = Page(render(_content(metrics=metrics)))
        assert "agreement with the labels 0.87" in page.text
        assert "success of style 0 90 % 95 % interval 80 % to 97 %, 50 episodes" in page.text
        assert page.text.count("0.87") == 2  # the tile and one row of the table

    @pytest.mark.parametrize(
        ("verdict", "headline"),
        [
            ("one style: nothing else.", "One playstyle in walks.csv"),
            ("not distinguishable: the latent has collapsed.", "No distinct playstyles in walks.csv"),
        ],
    )
    def test_a_single_style_is_called_what_it_is(self, verdict: str, headline: str):
        one = _content(verdict=verdict, styles=(_style(0, _walks(12)),), assignment=np.zeros(12, dtype=np.int64))
        page = Page(render(one))
        assert headline in page.text


class TestHostileText:
    def test_is_shown_and_never_run(self):
        demonstrations = _walks(6, names=(HOSTILE, "speed"), ids=[f"{HOSTILE}{i}" for i in range(6)])
        style = partial(_style, label=HOSTILE, sentences=(HOSTILE,), demonstrations=demonstrations)
        page = render(
            _content(
                6,
                demonstrations=demonstrations,
                styles=(style(0), style(1, name=HOSTILE)),
                title=HOSTILE,
                verdict=HOSTILE,
                run=HOSTILE,
                warnings=(HOSTILE,),
                metrics={HOSTILE: HOSTILE},
                config={HOSTILE: HOSTILE},
                command=HOSTILE,
                created=HOSTILE,
                versions={HOSTILE: HOSTILE},
            )
        )
        parsed = Page(page)
        assert "<script>alert" not in page
        assert "<img" not in page
        assert [tag for tag, _ in parsed.tags].count("script") == 2
        assert not [attrs for _, attrs in parsed.tags if any(name.startswith("on") for name in attrs)]
        assert HOSTILE in parsed.words
        episode = parsed.data["episodes"][0]
        assert episode["id"] == f"{HOSTILE}0"
        assert parsed.data["styles"] == [HOSTILE, HOSTILE]
        assert "<script" not in episode["picture"]
        assert "<img" not in episode["picture"]


class TestSectionsLeftOut:
    def test_nothing_played_nothing_logged_no_labels(self):
        page = Page(render(_content()))
        assert {"test", "training", "metrics"}.isdisjoint(page.ids)
        assert "agreement" not in page.text
        assert "success" not in page.text

    def test_one_style(self):
        content = _content(assignment=np.zeros(12, dtype=np.int64))
        page = Page(render(replace(content, styles=content.styles[:1])))
        assert "playstyle found 1" in page.text
        assert page.ids.count("latent") == 1

    def test_nothing_to_tell_apart_is_no_playstyle(self):
        content = _content(assignment=np.zeros(12, dtype=np.int64), verdict="not distinguishable: it has collapsed.")
        page = Page(render(replace(content, styles=content.styles[:1])))
        assert "distinct playstyles 0 all sessions count as one style below" in page.text
        assert "playstyle found" not in page.text

    def test_no_latent(self):
        page = Page(render(_content(latent_means=np.zeros((12, 0)))))
        assert "latent" not in page.ids
        assert page.scripts == []
        assert "Typical episodes" in page.text

    def test_no_prototypes(self):
        content = _content()
        page = Page(render(replace(content, styles=tuple(replace(s, prototypes=()) for s in content.styles))))
        assert "Typical episodes" not in page.text
        assert page.data["first"] == 0

    def test_played_but_not_judged(self):
        content = _content()
        styles = (replace(content.styles[0], test_episodes=_walks(3)), content.styles[1])
        page = Page(render(replace(content, styles=styles)))
        assert "test" in page.ids
        assert "failed" not in page.text
        assert "succeeded" not in page.text


class TestLatentSpace:
    def test_every_episode_opens(self):
        content = _content()
        data = Page(render(content)).data
        assert [episode["id"] for episode in data["episodes"]] == list(content.episode_ids)
        assert [episode["style"] for episode in data["episodes"]] == content.assignment.tolist()
        assert data["first"] == content.styles[0].prototypes[0]
        episode = data["episodes"][3]
        assert episode["probability"] == "0.900"
        assert episode["facts"] == [["label", "north"]]
        assert episode["picture"].startswith("<svg")
        assert 'aria-label="Episode walk 3"' in episode["picture"]

    def test_places_are_where_the_points_are_drawn(self):
        content = _content()
        html = render(content)
        figure = html[html.index('id="map"') : html.index("</svg>", html.index('id="map"'))]
        circles = re.findall(r'fill:var\(--style-0[^>]*d="([^"]*)"', figure)
        markers = max(circles, key=len)
        starts = [tuple(map(float, m)) for m in re.findall(r"M(-?[\d.]+),(-?[\d.]+)", markers)]
        places = [e["place"] for e in Page(html).data["episodes"] if e["style"] == 0]
        assert len(starts) == len(places)
        for x, y in places:
            assert min(np.hypot(x - a, y - b) for a, b in starts) < 3

    def test_many_episodes_are_thinned_but_prototypes_stay(self, monkeypatch):
        monkeypatch.setattr(views, "_MOST_EPISODES", 10)
        content = _content(40)
        page = Page(render(content))
        ids = {episode["id"] for episode in page.data["episodes"]}
        assert len(ids) <= 14
        for style in content.styles:
            assert {content.episode_ids[position] for position in style.prototypes} <= ids
        assert f"{len(ids)} of 40 episodes, evenly from every style." in page.text

    def test_heavy_pictures_are_fewer(self, monkeypatch):
        monkeypatch.setattr(views, "_MOST_BYTES", 6_000)
        data = Page(render(_content(40))).data
        assert 4 <= len(data["episodes"]) < 20


class TestTestEpisodes:
    def test_failures_are_framed_and_named_in_proportion(self, full):
        page = Page(full)
        assert [attrs.get("class") for tag, attrs in page.tags if tag == "li"].count("failed") == 2
        assert page.words.count("failed") == 2

    @pytest.mark.parametrize(
        ("failures", "total", "shown"), [(0, 100, 0), (1, 1000, 1), (50, 100, 12), (100, 100, 24), (1, 3, 1)]
    )
    def test_shares(self, failures, total, shown):
        outcomes = np.arange(total) >= failures
        chosen = in_proportion(outcomes, 24)
        assert len(chosen) == len(set(chosen.tolist())) == min(24, total)
        assert int((~outcomes[chosen]).sum()) == shown

    def test_as_many_outcomes_as_episodes(self):
        with pytest.raises(ValueError, match="3 test episodes need as many outcomes, got 2"):
            _style(0, _walks(4), test_episodes=_walks(3), succeeded=np.array([True, False]))

    def test_the_key_names_what_only_the_bot_did(self):
        content = _content()
        still = Demonstrations.from_trajectories(
            [Trajectory(walk.observations, 0 * walk.actions, attributes=walk.attributes) for walk in _walks(12)],
            content.demonstrations.observation_space,
            content.demonstrations.action_space,
        )
        styles = (replace(content.styles[0], test_episodes=_walks(3)), content.styles[1])
        page = Page(render(replace(content, demonstrations=still, styles=styles)))
        assert page.words.count("jump") == 3  # the key in the card, the one of the bot, the table of signals
        assert Page(render(replace(content, demonstrations=still))).words.count("jump") == 1

    def test_many_styles_show_fewer_each(self):
        content = _content()
        styles = tuple(_style(k, content.demonstrations, test_episodes=_walks(30), prototypes=()) for k in range(3))
        few = Page(render(replace(content, assignment=np.zeros(12, dtype=np.int64), styles=styles[:1])))
        many = Page(render(replace(content, styles=styles * 3)))
        assert [tag for tag, _ in few.tags].count("figure") == 24
        assert [tag for tag, _ in many.tags].count("figure") == 9 * 6


class TestContent:
    def test_lengths_must_agree(self):
        with pytest.raises(ValueError, match="12 demonstrations need as many of everything, got 3 probability"):
            _content(probability=np.ones(3))

    def test_assignments_need_their_style(self):
        with pytest.raises(ValueError, match="need a style from 0 to 1, got 0 to 2"):
            _content(assignment=np.arange(12) % 3)

    def test_means_are_finite(self):
        with pytest.raises(ValueError, match="finite"):
            _content(latent_means=np.full((12, 2), np.nan))


class TestTables:
    def test_metrics_keep_their_order_and_depth(self):
        metrics = {
            "b": {"c": {"mean": 1.5, "ci95": [1, 2], "seeds": 3}, "d": [1, 2.5]},
            "a": [{"x": None}],
            "n": {},
        }
        rows = [(row.path, row.value, row.interval, row.basis) for row in metric_rows(metrics)]
        assert rows == [
            (("b", "c"), "1.5", "1 to 2", "3 seeds"),
            (("b", "d"), "1, 2.5", "", ""),
            (("a", "0", "x"), "–", "", ""),
        ]

    def test_intervals_of_bots_stand_beside_what_they_are_of(self):
        metrics = {
            "success": {"north": 0.9, "south": 0.5},
            "ci95": {"success": {"north": [0.8, 1.0]}, "leaps": {"north": [1, 3]}},
            "leaps": {"north": 2.0},
            "test_episodes": 50,
            "held_out_likelihood": {"difference": {"mean": 1.5, "ci95": [1, 2]}},
        }
        rows = {"/".join(row.path): (row.value, row.interval, row.basis) for row in metric_rows(metrics)}
        assert rows == {
            "success/north": ("0.9", "0.8 to 1", "50 episodes"),
            "success/south": ("0.5", "", ""),
            "leaps/north": ("2", "1 to 3", "50 episodes"),
            "test_episodes": ("50", "", ""),
            "held_out_likelihood/difference": ("1.5", "1 to 2", ""),
        }

    def test_numbers_say_what_they_mean(self):
        metrics = {"train_steps": 3, "success": {"north": 0.9}, "leaps": {"north": 2.0}, "mine": 1}
        metrics |= {"ci95": {"leaps": {"north": [1, 3]}}, "nats_per_trajectory": {"training": {"kl": 1.0}}}
        means = {"/".join(row.path): row.meaning for row in metric_rows(metrics)}
        assert means.pop("mine") == ""
        assert all(means.values())
        assert len(set(means.values())) == len(means)

    def test_what_counts_as_measured(self):
        assert measured(1) == Measured(1.0)
        assert measured(None) is None
        assert measured(True) is None
        assert measured({"mean": 1.0}) is None

    def test_wilson_interval_agrees_with_scipy(self):
        from scipy.stats import binomtest

        for successes, trials in ((0, 10), (7, 10), (970, 1000), (3, 3)):
            expected = binomtest(successes, trials).proportion_ci(method="wilson")
            assert share(successes, trials).interval == pytest.approx((expected.low, expected.high), abs=1e-9)

    def test_a_share_of_nothing_is_an_error(self):
        with pytest.raises(ValueError, match="at least one trial"):
            share(0, 0)

    def test_spread_takes_styles_in_proportion(self):
        assignment = np.array([0] * 75 + [1] * 25)
        chosen = spread(assignment, [], 20)
        assert len(chosen) == 20
        assert (assignment[chosen] == 1).sum() == 5
