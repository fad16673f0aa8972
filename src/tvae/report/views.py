"""From what a report says to what its page shows: key numbers, cards of styles, the latent space."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from tvae.evaluate.playstyles import NOT_DISTINGUISHABLE
from tvae.evaluate.words import explanation
from tvae.figures.curves import training_curves
from tvae.figures.markup import to_markup
from tvae.figures.trajectories import Draw
from tvae.report.content import ReportContent, StyleSection
from tvae.report.pictures import Entry, Sketches, glyph, in_proportion, latent_map, sketch, spread
from tvae.report.tables import Measured, MetricRow, measured, metric_rows, number, of_bots, percent, share
from tvae.spaces import IntArray, describe

_MOST_EPISODES = 300
"""How many episodes open in the latent space."""
_MOST_BYTES = 900_000
"""How much their pictures may weigh together."""
_ROW = 6
"""How many pictures stand in a row of a wide page."""


@dataclass(frozen=True)
class Tile:
    """A key number."""

    value: str
    name: str
    detail: str = ""
    style: int | None = None


@dataclass(frozen=True)
class Cell:
    """A picture of an episode with its caption."""

    picture: Markup
    caption: str = ""
    failed: bool = False


@dataclass(frozen=True)
class Card:
    """A playstyle in words and pictures."""

    title: str
    name: str
    glyph: Markup
    share: str
    width: str
    """The share in CSS."""
    sentences: tuple[str, ...]
    prototypes: tuple[Cell, ...]
    tests: tuple[Cell, ...]
    outcome: str
    """How the test episodes went; empty if nobody judged them."""
    key: tuple[Entry, ...]
    """Explains the pictures."""


@dataclass(frozen=True)
class Explorer:
    """The latent space, and the episodes that open in it."""

    picture: Markup
    data: Mapping[str, object]
    caption: str


@dataclass(frozen=True)
class View:
    """All that the page shows beyond the words of its content."""

    headline: str
    subtitle: str
    tiles: tuple[Tile, ...]
    cards: tuple[Card, ...]
    explorer: Explorer | None
    curves: Markup | None
    signals: tuple[tuple[str, str, str], ...]
    """Role, name and kind."""
    metrics: tuple[MetricRow, ...]
    config: str
    explanation: str
    """Of what is in the sentences; may be empty."""


def view(content: ReportContent) -> View:
    """Draw and count everything that the page shows."""
    always = [position for style in content.styles for position in style.prototypes]
    latent = content.latent_means.shape[1] > 0
    chosen = spread(content.assignment, always, _MOST_EPISODES if latent else 0)
    sketches = _sketch_demonstrations(content, chosen)
    pictures = dict(zip(chosen.tolist(), sketches.pictures, strict=True))
    demonstrations = content.demonstrations
    return View(
        headline=_headline(content),
        subtitle=_subtitle(content),
        tiles=_tiles(content),
        cards=_cards(content, pictures, sketches.keys),
        explorer=_explorer(content, pictures, always) if latent else None,
        curves=Markup(to_markup(training_curves(content.records), "Training curves")) if content.records else None,
        signals=tuple(
            (role, signal.name, describe(signal))
            for role, space in (
                ("observation", demonstrations.observation_space),
                ("action", demonstrations.action_space),
            )
            for signal in space.signals
        ),
        metrics=tuple(metric_rows(content.metrics)),
        config=json.dumps(content.config, indent=2, ensure_ascii=False, default=str) if content.config else "",
        explanation=explanation(sentence for style in content.styles for sentence in style.sentences),
    )


def _headline(content: ReportContent) -> str:
    """How many playstyles there are in what."""
    count = len(content.styles)
    if count > 1:
        return f"{count} playstyles in {content.title}"
    told = "No distinct playstyles" if content.verdict.startswith(NOT_DISTINGUISHABLE) else "One playstyle"
    return f"{told} in {content.title}"


def _subtitle(content: ReportContent) -> str:
    demonstrations = content.demonstrations
    episodes = f"{len(demonstrations):,} session{'' if len(demonstrations) == 1 else 's'}"
    size = f"{episodes}, {demonstrations.num_steps:,} steps, {_num_signals(content)} signals"
    return f"{size}; run {content.run}" if content.run else size


def _num_signals(content: ReportContent) -> int:
    demonstrations = content.demonstrations
    return demonstrations.observation_space.num_columns + demonstrations.action_space.num_columns


def _title(style: StyleSection) -> str:
    return style.label or style.name


def _success(content: ReportContent, style: StyleSection) -> Measured | None:
    given = content.metrics.get("success")
    if isinstance(given, Mapping):
        for name in (style.label, style.name):
            found = of_bots(content.metrics, ("success", str(name))) or measured(given.get(name))
            if found is not None:
                return found
    if style.succeeded is None or len(style.succeeded) == 0:
        return None
    return share(int(style.succeeded.sum()), len(style.succeeded))


def _interval(found: Measured) -> str:
    if found.interval is None:
        return ""
    low, high = found.interval
    return f"{percent(0.95)} interval {percent(low)} to {percent(high)}"


def _tiles(content: ReportContent) -> tuple[Tile, ...]:
    count = len(content.styles)
    if content.verdict.startswith(NOT_DISTINGUISHABLE):
        tiles = [Tile("0", "distinct playstyles", "all sessions count as one style below")]
    else:
        tiles = [Tile(str(count), "playstyle found" if count == 1 else "playstyles found")]
    found_styles = content.metrics.get("playstyles")
    labelled = found_styles if isinstance(found_styles, Mapping) else {}
    ari = measured(content.metrics.get("ari", labelled.get("ari")))
    if ari is not None:
        detail = "adjusted Rand index; 1 is full agreement, 0 is chance"
        tiles.append(Tile(f"{ari.mean:.2f}", "agreement with the labels", detail))
    for index, style in enumerate(content.styles):
        found = _success(content, style)
        if found is not None:
            detail = ", ".join(part for part in (_interval(found), found.basis) if part)
            tiles.append(Tile(percent(found.mean), f"success of {_title(style)}", detail, index))
    demonstrations = content.demonstrations
    steps = f"{demonstrations.num_steps:,} steps"
    return (*tiles, Tile(f"{len(demonstrations):,}", "demonstrations", steps))


def _sketch_demonstrations(content: ReportContent, chosen: IntArray) -> Sketches:
    styles = [content.styles[content.assignment[position]] for position in chosen]
    return sketch(
        [
            (content.demonstrations[int(position)], style.draw, f"Episode {content.episode_ids[position]}")
            for position, style in zip(chosen, styles, strict=True)
        ]
    )


def _cards(
    content: ReportContent, pictures: Mapping[int, str], keys: Mapping[Draw, tuple[Entry, ...]]
) -> tuple[Card, ...]:
    rows = max(1, min(4, 16 // len(content.styles)))
    tests = [_tests(style, _ROW * rows) for style in content.styles]
    sketches = sketch(
        [
            (style.test_episodes[position], style.draw, f"{_title(style)}, test episode {position + 1}")
            for style, positions in zip(content.styles, tests, strict=True)
            for position in positions
            if style.test_episodes is not None
        ]
    )
    played = iter(sketches.pictures)
    return tuple(
        Card(
            title=_title(style),
            name=style.name,
            glyph=Markup(glyph(index)),
            share=percent(style.weight),
            width=f"{100 * style.weight:.4g}%",
            sentences=style.sentences,
            prototypes=tuple(
                Cell(Markup(pictures[position]), content.episode_ids[position]) for position in style.prototypes
            ),
            tests=tuple(_test_cell(style, position, next(played)) for position in positions),
            outcome=_outcome(style, len(positions)),
            key=_union(keys.get(style.draw, ()), sketches.keys.get(style.draw, ())),
        )
        for index, (style, positions) in enumerate(zip(content.styles, tests, strict=True))
    )


def _union(first: Sequence[Entry], second: Sequence[Entry]) -> tuple[Entry, ...]:
    """Each name once: a bot may do what no demonstration did."""
    return tuple({entry.name: entry for entry in (*first, *second)}.values())


def _tests(style: StyleSection, count: int) -> list[int]:
    """Positions of at most `count` test episodes to show."""
    if style.test_episodes is None:
        return []
    unjudged = np.ones(len(style.test_episodes), dtype=np.bool_)
    outcomes = unjudged if style.succeeded is None else style.succeeded
    return [int(position) for position in in_proportion(outcomes, count)]


def _test_cell(style: StyleSection, position: int, picture: str) -> Cell:
    if style.succeeded is None:
        return Cell(Markup(picture))
    failed = not style.succeeded[position]
    return Cell(Markup(picture), "failed" if failed else "", failed)


def _outcome(style: StyleSection, num_shown: int) -> str:
    if style.succeeded is None or not num_shown:
        return ""
    total, successes = len(style.succeeded), int(style.succeeded.sum())
    found = share(successes, total)
    words = f"{percent(found.mean)} succeeded, {successes:,} of {total:,} episodes ({_interval(found)})."
    if num_shown < total:
        words += f" Shown are {num_shown}, failures in their true proportion, at least one if there is any."
    return words


def _explorer(content: ReportContent, pictures: Mapping[int, str], always: Sequence[int]) -> Explorer:
    weight = sum(len(picture) for picture in pictures.values())
    limit = int(len(pictures) * min(1.0, _MOST_BYTES / weight))
    positions = sorted(pictures)
    shown = spread(content.assignment[positions], [positions.index(p) for p in always], limit)
    chosen = np.array(positions)[shown]
    names = [_title(style) for style in content.styles]
    latent = latent_map(content.latent_means[chosen], content.assignment[chosen], names)
    facts = {name: values for name, values in content.demonstrations.attributes.items() if name != "episode"}
    episodes = [
        {
            "id": content.episode_ids[position],
            "place": [round(float(value), 1) for value in place],
            "style": int(content.assignment[position]),
            "probability": f"{content.probability[position]:.3f}",
            "facts": [[name, number(values[position].item())] for name, values in list(facts.items())[:6]],
            "picture": pictures[int(position)],
        }
        for position, place in zip(chosen, latent.places, strict=True)
    ]
    total = len(content.demonstrations)
    caption = f"{len(chosen):,} of {total:,} episodes, evenly from every style." if len(chosen) < total else ""
    first = int(np.searchsorted(chosen, always[0])) if always else 0
    return Explorer(Markup(latent.picture), {"styles": names, "episodes": episodes, "first": first}, caption)
