"""The errors on the page of gotchas are those that users see."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pandas as pd
import pytest

import tvae
from tvae.data.arrays import from_arrays
from tvae.data.preparation import Clock, Preparation
from tvae.errors import TvaeError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.playstyles import find_playstyles

PAGE = Path(__file__).parent.parent / "docs" / "gotchas.md"
TOLD = [text.strip() for text in re.findall(r"^```text\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)]


def walk(**columns: object) -> tvae.Demonstrations:
    table = {
        "episode": [0, 0, 0, 1, 1],
        "step": [0, 1, 2, 0, 1],
        "observation.x": [0.0, 1.0, 2.0, 0.0, -1.0],
        "action.key": ["right", "right", "stay", "left", "stay"],
    } | columns
    clock = Clock("seconds") if "seconds" in table else None
    frame = pd.DataFrame({name: values for name, values in table.items() if values is not None})
    return tvae.load_demonstrations(frame, preparation=Preparation(clock=clock))


def saved(directory: Path) -> Path:
    tvae.TrajectoryVAE.from_pretrained("zombie").save(directory)
    return directory


def truncated(directory: Path) -> None:
    weights = saved(directory) / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    tvae.TrajectoryVAE.load(directory)


def of_the_future(directory: Path) -> None:
    config = saved(directory) / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"schema_version": 99}))
    tvae.TrajectoryVAE.load(directory)


def elsewhere(_: Path) -> None:
    model = tvae.TrajectoryVAE.from_pretrained("zombie")
    tvae.Agent(model, np.zeros(model.latent_features), gymnasium.make("CartPole-v1"))


PROVOKED: list[Callable[[Path], object]] = [
    lambda _: walk(**{"observation.x": [0.0, np.nan, 2.0, 0.0, -1.0]}),
    lambda _: walk(step=None),
    lambda _: walk(step=[0, 1, 3, 0, 1]),
    lambda _: walk(step=None, seconds=[0.0, 0.5, 1.7, 0.0, 0.5]),
    lambda _: from_arrays([np.zeros((3, 4, 4, 3))], [np.zeros((3, 1))]),
    lambda _: tvae.fit(walk().select(np.array([0]))),
    lambda _: tvae.fit(walk(), group="pair"),
    elsewhere,
    lambda _: tvae.TrajectoryVAE.from_pretrained("zombies"),
    truncated,
    of_the_future,
]
COLLAPSED = next(text for text in TOLD if "collapsed" in text)
ERRORS = [text for text in TOLD if text != COLLAPSED]


@pytest.mark.parametrize(("told", "provoke"), list(zip(ERRORS, PROVOKED, strict=True)), ids=range(len(PROVOKED)))
def test_errors_are_told_as_they_are(told: str, provoke: Callable[[Path], object], tmp_path: Path) -> None:
    with pytest.raises(TvaeError) as raised:
        provoke(tmp_path)
    assert str(raised.value).replace(str(tmp_path), "DIR") == told


def test_a_collapsed_latent_is_told_as_it_is() -> None:
    nothing = np.zeros((50, 2))
    assert find_playstyles(Posteriors(nothing, np.ones_like(nothing))).verdict == COLLAPSED
