"""The runs of `tvae demo`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tvae.config import ModelConfig, RunConfig, TrainingConfig
from tvae.data.demonstrations import Demonstrations
from tvae.data.segments import segment
from tvae.envs.zombie import zombie_demonstrations
from tvae.experiments.arenas import Arena
from tvae.experiments.recipe import Recipe

PUSHT_DATA = Path("data/pusht_human_206.npz")
OVERCOOKED_DATA = Path("data/overcooked_human_2019.json.gz")


def zombie(data: Path | None, seed: int) -> Recipe:
    """Scripted demonstrators that attack or avoid a zombie."""
    return Recipe(
        title="Zombie attack",
        demonstrations=lambda: zombie_demonstrations(2000, seed),
        config=RunConfig(seed=seed),
        arena=Arena("tvae/ZombieAttack-v0", episodes=1000),
    )
