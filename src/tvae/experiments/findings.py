"""What a run found: its styles, the labels that they match, and words for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tvae.errors import TvaeError
from tvae.evaluate.styles import Playstyles, Style
from tvae.evaluate.words import explanation
from tvae.experiments.run_directory import RunDirectoryError, read_json


@dataclass(frozen=True, eq=False)
class Findings:
    """Playstyles with their labels, where the data has labels, the sentences that set each apart, and own names.

    >>> import numpy as np
    >>> from tvae.evaluate.encoding import Posteriors
    >>> from tvae.evaluate.playstyles import find_playstyles
    >>> found = Findings(find_playstyles(Posteriors(np.zeros((4, 2)), np.ones((4, 2)))), {0: "attack"}, {})
    >>> mine = found.renamed({0: "hunters"})
    >>> mine.title(mine.style("attack")), mine.shown({"success": {"attack": 0.9}})
    ('hunters (style 0)', {'success': {'hunters': 0.9}})
    """

    playstyles: Playstyles
    labels: Mapping[int, str]
    """The label that most training episodes of a style carry."""
    words: Mapping[int, tuple[str, ...]]
    """What sets each style apart."""
    names: Mapping[int, str] = field(default_factory=dict)
    """What the user calls a style."""

    def name(self, style: Style) -> str:
        """What the user calls it, else its label if it has one, else `style` and its number."""
        return self.names.get(style.index, self.key(style))

    def key(self, style: Style) -> str:
        """The style's label if it has one, else `style` and its number: its name in `metrics.json`, which stays."""
        return self.labels.get(style.index, style.name)

    def title(self, style: Style) -> str:
        """Its name, with its number where the name does not tell it, as in `campers (style 0)`."""
        name = self.name(style)
        return name if name == style.name else f"{name} ({style.name})"

    @property
    def explanation(self) -> str:
        """What a reader of all the sentences has to be told once; may be empty."""
        return explanation(sentence for sentences in self.words.values() for sentence in sentences)

    def style(self, name: str) -> Style:
        """The style of this number, name or label; `TvaeError` says which there are."""
        for style in self.playstyles.styles:
            if name in self._called(style):
                return style
        there = ", ".join(f"{style.index} ({self.name(style)})" for style in self.playstyles.styles)
        raise TvaeError(f"there is no style {name!r}; there are: {there}")

    def several(self, names: Sequence[str]) -> tuple[Style, ...]:
        """The styles of these numbers, names or labels, each once, the most frequent first.

        >>> found = Findings(Playstyles.from_pretrained("zombie"), {0: "attack"}, {})
        >>> [style.index for style in found.several(["style 1", "attack", "0"])]
        [0, 1]
        """
        indices = {self.style(name).index for name in names}
        return tuple(style for style in self.playstyles.styles if style.index in indices)

    def _called(self, style: Style) -> set[str]:
        return {str(style.index), style.name, self.key(style), self.name(style)}

    def renamed(self, names: Mapping[int, str]) -> Findings:
        """The same with these names of styles, by their number; other styles keep theirs.

        Raises `TvaeError` for a style that is not there, an empty name or one that is no single line of text, and one
        that another style is called by, too.
        """
        for index, name in names.items():
            self.style(str(index))
            if not name.strip() or not name.isprintable():
                raise TvaeError(f"the name of style {index} must be a line of text, got {name!r}")
        found = replace(self, names={**self.names, **names})
        for index, name in names.items():
            for other in found.playstyles.styles:
                if other.index != index and name in found._called(other):
                    raise TvaeError(f"style {index} cannot be {name!r}: that already means {found.title(other)}")
        return found

    def shown(self, metrics: Mapping[str, Any]) -> dict[str, Any]:
        """The same metrics, where those by style have the names of styles for their keys."""
        names = {self.key(style): self.name(style) for style in self.playstyles.styles}

        def named(value: Any) -> Any:
            if not isinstance(value, Mapping):
                return value
            by_style = bool(value) and value.keys() <= names.keys()
            return {names[key] if by_style else key: named(inner) for key, inner in value.items()}

        return {key: named(value) for key, value in metrics.items()}

    def to_json(self) -> dict[str, Any]:
        """Plain data for `playstyles.json`."""
        return {
            "playstyles": self.playstyles.to_json(),
            "labels": {str(index): label for index, label in self.labels.items()},
            "words": {str(index): list(sentences) for index, sentences in self.words.items()},
            "names": {str(index): name for index, name in self.names.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Findings:
        """What `to_json` wrote."""
        return cls(
            Playstyles.from_json(data["playstyles"]),
            {int(index): str(label) for index, label in data["labels"].items()},
            {int(index): tuple(sentences) for index, sentences in data["words"].items()},
            {int(index): str(name) for index, name in data.get("names", {}).items()},
        )


def read_findings(path: Path) -> Findings:
    """What a `playstyles.json` holds; `RunDirectoryError` where it is missing, damaged or of another version."""
    data = read_json(path)
    try:
        return Findings.from_json(data)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise RunDirectoryError(f"{path} does not hold playstyles: {error}") from error
