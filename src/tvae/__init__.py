"""T-VAE: the playstyles hidden in recorded demonstrations, and a bot for each of them."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register(
    id="tvae/ZombieAttack-v0",
    entry_point="tvae.envs.zombie:ZombieAttackEnv",
    vector_entry_point="tvae.envs.zombie:ZombieAttackVectorEnv",
)
register(id="tvae/Overcooked-v0", entry_point="tvae.envs.overcooked:OvercookedEnv")
register(id="tvae/PushT-v0", entry_point="tvae.envs.pusht:PushTEnv", max_episode_steps=300)
