"""The tasks of `tvae demo`, each a function of the data file and the seed that gives a complete recipe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from tvae.config import ModelConfig, RunConfig, TrainingConfig
from tvae.data.segments import segment
from tvae.errors import TvaeError
from tvae.experiments.arenas import Arena
from tvae.experiments.recipe import Recipe
from tvae.experiments.reproduction.studies import STUDIES

PUSHT_DATA = Path("data/pusht_human_206.npz")
OVERCOOKED_DATA = Path("data/overcooked_human_2019.json.gz")
OVERCOOKED_CONFIG = RunConfig(
    model=ModelConfig(
        latent_features=8,
        hidden_features=128,
        dropout=0.05,
        stop=False,
        action_components=1,
        prior_components=1,
        horizon=8,
    ),
    training=TrainingConfig(
        num_steps=1_000,
        batch_size=16,
        learning_rate=5e-3,
        state_weight=0.1,
        kl_points=((0.0, 8.0),),
        patience=1_000,
        held_out=0.1,
    ),
    group="pair",
)


def navigation(data: Path | None, seed: int) -> Recipe:
    """1,500 scripted walks towards three goals that nobody sees."""
    return _of_the_paper("navigation", "tvae/Navigation-v0", data, seed)


def circle(data: Path | None, seed: int) -> Recipe:
    """1,500 scripted walks around three circles that nobody sees."""
    return _of_the_paper("circle", "tvae/Circle-v0", data, seed)


def zombie(data: Path | None, seed: int) -> Recipe:
    """2,000 episodes of scripted demonstrators that attack or avoid a zombie."""
    return _of_the_paper("zombie", "tvae/ZombieAttack-v0", data, seed)


def _of_the_paper(task: str, env: str, data: Path | None, seed: int) -> Recipe:
    if data is not None:
        raise TvaeError(f"the {task} task makes its own demonstrations and reads no file, got {data}")
    study = STUDIES[task]
    return Recipe(
        title=study.title,
        demonstrations=lambda: study.demonstrations(seed),
        config=replace(study.presets["default"], seed=seed),
        arena=Arena(env, episodes=1000),
    )


def pusht(data: Path | None, seed: int) -> Recipe:
    """206 human demonstrations of pushing a T-shaped block to its place (Chi et al. 2023)."""
    path = recordings(data or PUSHT_DATA)
    module = simulated("tvae.envs.pusht", "pusht")
    return Recipe(
        title="PushT, 206 human demonstrations",
        demonstrations=lambda: module.pusht_demonstrations(path),
        config=RunConfig(seed=seed),
        arena=Arena("tvae/PushT-v0", episodes=200),
    )


def overcooked(data: Path | None, seed: int) -> Recipe:
    """16 human games on the coordination ring, from both seats, in overlapping segments; pairs are held out whole.

    Next states nearly follow from the present ones here; what z tells shows in where the players will be 8 steps later,
    and the weight of the next state is small. That likelihood counts the same evidence up to 8 times, and so does the
    KL term.
    """
    path = recordings(data or OVERCOOKED_DATA)
    module = simulated("tvae.envs.overcooked", "overcooked")
    return Recipe(
        title="Overcooked, coordination ring, human pairs",
        demonstrations=lambda: segment(
            module.with_seats_exchanged(module.overcooked_demonstrations(path, ["coordination_ring"])),
            200,
            stride=50,
            minimum=100,
        ),
        config=replace(OVERCOOKED_CONFIG, seed=seed),
        arena=Arena("tvae/Overcooked-v0", {"layout": "coordination_ring", "horizon": 400}, episodes=100),
    )


TASKS: dict[str, Callable[[Path | None, int], Recipe]] = {
    "navigation": navigation,
    "circle": circle,
    "zombie": zombie,
    "pusht": pusht,
    "overcooked": overcooked,
}


def recordings(path: Path) -> Path:
    """The path, if there is a file; else `TvaeError`, which says how to name its place."""
    if not path.is_file():
        raise TvaeError(f"{path} is not there; the file comes with the repository, name its place with --data")
    return path


def simulated(module: str, extra: str) -> Any:
    """A module that needs a simulator, which is an optional extra; `TvaeError` says what to install."""
    try:
        return import_module(module)
    except ImportError as error:
        raise TvaeError(f"this task needs an extra: pip install 'tvae[{extra}]' ({error})") from error
