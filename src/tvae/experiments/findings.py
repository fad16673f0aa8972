"""What a run found: its styles, the labels that they match, and words for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tvae.errors import TvaeError
from tvae.evaluate.styles import Playstyles, Style
from tvae.evaluate.words import explanation


@dataclass(frozen=True, eq=False)
class Findings:
    """Playstyles with their labels, where the data has labels, and the sentences that set each apart."""

    playstyles: Playstyles
    labels: Mapping[int, str]
    """The label that most training episodes of a style carry."""
    words: Mapping[int, tuple[str, ...]]
    """What sets each style apart."""

    def name(self, style: Style) -> str:
        """The style's label if it has one, else its own name."""
        return self.labels.get(style.index, style.name)

    @property
    def explanation(self) -> str:
        """What a reader of all the sentences has to be told once; may be empty."""
        return explanation(sentence for sentences in self.words.values() for sentence in sentences)

    def style(self, name: str) -> Style:
        """The style of this number, name or label; `TvaeError` says which there are."""
        for style in self.playstyles.styles:
            if name in {str(style.index), style.name, self.labels.get(style.index)}:
                return style
        there = ", ".join(f"{style.index} ({self.name(style)})" for style in self.playstyles.styles)
        raise TvaeError(f"there is no style {name!r}; there are: {there}")

    def to_json(self) -> dict[str, Any]:
        """Plain data for `playstyles.json`."""
        return {
            "playstyles": self.playstyles.to_json(),
            "labels": {str(index): label for index, label in self.labels.items()},
            "words": {str(index): list(sentences) for index, sentences in self.words.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Findings:
        """What `to_json` wrote."""
        return cls(
            Playstyles.from_json(data["playstyles"]),
            {int(index): str(label) for index, label in data["labels"].items()},
            {int(index): tuple(sentences) for index, sentences in data["words"].items()},
        )
