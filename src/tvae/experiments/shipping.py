"""A trained model as it comes with the package: without its run, and small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tvae.evaluate.styles import Playstyles
from tvae.experiments.findings import Findings
from tvae.experiments.run_directory import write_json
from tvae.files import appearing
from tvae.model.tvae import TrajectoryVAE
from tvae.spaces import IntArray

MOST_MEMBERS = 100


def ship(
    model: TrajectoryVAE, findings: Findings, directory: str | Path, card: str, *, overwrite: bool = False
) -> None:
    """Write `directory` as `from_pretrained` reads it, whole or not at all.

    It holds `config.json`, `model.safetensors`, `playstyles.json` with at most `MOST_MEMBERS` members of each style,
    and the model card `card` as `README.md`.

    Raises `FileExistsError` for a directory that exists unless `overwrite`, and `ValueError` for styles of another
    width than the model's z or a card that says nothing.

    >>> from tempfile import mkdtemp
    >>> from tvae.evaluate.encoding import Posteriors
    >>> from tvae.evaluate.playstyles import find_playstyles
    >>> from tvae.spaces import Continuous, Space
    >>> model = TrajectoryVAE(Space((Continuous("x"),)), Space((Continuous("dx"),)))
    >>> playstyles = find_playstyles(Posteriors(np.zeros((4, 2)), np.ones((4, 2))))
    >>> directory = Path(mkdtemp()) / "walks"
    >>> ship(model, Findings(playstyles, {}, {}), directory, "Walks on a line.")
    >>> len(Playstyles.from_pretrained(directory))
    1
    """
    width = len(findings.playstyles.styles[0].mean)
    if width != model.latent_features:
        raise ValueError(f"the model has {model.latent_features} latent features, and the styles need {width}")
    if not card.strip():
        raise ValueError("a shipped model needs a card that says what it is, got an empty one")
    with appearing(Path(directory), overwrite=overwrite) as partial:
        model.save(partial)
        write_json(partial / "playstyles.json", replace(findings, playstyles=_small(findings.playstyles)).to_json())
        (partial / "README.md").write_text(card, encoding="utf-8")


def _small(playstyles: Playstyles) -> Playstyles:
    """The same styles with evenly spaced members where there are more than `MOST_MEMBERS`."""

    def spread(count: int) -> IntArray:
        return np.linspace(0, count - 1, min(count, MOST_MEMBERS)).round().astype(np.int64)

    styles = tuple(
        replace(style, members=style.members.select(spread(len(style.members)))) for style in playstyles.styles
    )
    return replace(playstyles, styles=styles)
