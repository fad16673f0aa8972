"""T-VAE: the playstyles hidden in recorded demonstrations, and a bot for each of them."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

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
