"""T-VAE: the playstyles hidden in recorded demonstrations, and a bot for each of them.

The names below are loaded when they are first used, so that `import tvae` itself costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

if TYPE_CHECKING:
    from tvae.data.demonstrations import Demonstrations as Demonstrations
    from tvae.data.sources import load_demonstrations as load_demonstrations
    from tvae.data.sources import save_demonstrations as save_demonstrations
    from tvae.data.trajectory import DataError as DataError
    from tvae.data.trajectory import Trajectory as Trajectory
    from tvae.evaluate.playstyles import discover as discover
    from tvae.evaluate.styles import Playstyles as Playstyles
    from tvae.fitting.fit import fit as fit
    from tvae.generate.closed_loop import Agent as Agent
    from tvae.generate.closed_loop import rollout as rollout
    from tvae.generate.closed_loop import rollout_parallel as rollout_parallel
    from tvae.generate.open_loop import imagine as imagine
    from tvae.model.tvae import TrajectoryVAE as TrajectoryVAE

__version__ = "0.1.0"

_HOMES = {
    "Agent": "tvae.generate.closed_loop",
    "DataError": "tvae.data.trajectory",
    "Demonstrations": "tvae.data.demonstrations",
    "Playstyles": "tvae.evaluate.styles",
    "Trajectory": "tvae.data.trajectory",
    "TrajectoryVAE": "tvae.model.tvae",
    "discover": "tvae.evaluate.playstyles",
    "fit": "tvae.fitting.fit",
    "imagine": "tvae.generate.open_loop",
    "load_demonstrations": "tvae.data.sources",
    "rollout": "tvae.generate.closed_loop",
    "rollout_parallel": "tvae.generate.closed_loop",
    "save_demonstrations": "tvae.data.sources",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'tvae' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])


register(
    id="tvae/ZombieAttack-v0",
    entry_point="tvae.envs.zombie:ZombieAttackEnv",
    vector_entry_point="tvae.envs.zombie:ZombieAttackVectorEnv",
)
register(
    id="tvae/Navigation-v0",
    entry_point="tvae.envs.navigation:NavigationEnv",
    vector_entry_point="tvae.envs.navigation:NavigationVectorEnv",
)
register(
    id="tvae/Circle-v0",
    entry_point="tvae.envs.circle:CircleEnv",
    vector_entry_point="tvae.envs.circle:CircleVectorEnv",
)
register(id="tvae/Overcooked-v0", entry_point="tvae.envs.overcooked:OvercookedEnv")
register(id="tvae/PushT-v0", entry_point="tvae.envs.pusht:PushTEnv", max_episode_steps=300)
