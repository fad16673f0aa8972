"""A bot of the zombie task that acts with ONNX Runtime and NumPy alone: no PyTorch.

tvae export zombie --out exports/zombie
python examples/act_with_onnx_runtime.py exports/zombie attack
"""

import json
import sys
from pathlib import Path

import gymnasium
import numpy as np
import onnxruntime

import tvae  # noqa: F401 - it registers the environment; it loads no PyTorch


def play(exported: Path, style_name: str, episodes: int, seed: int = 0) -> float:
    """The share of episodes in which the bot of a style does what the style is for."""
    manifest = json.loads((exported / "manifest.json").read_text(encoding="utf-8"))
    session = onnxruntime.InferenceSession(exported / "policy_step.onnx")
    sizes = {port["name"]: port["shape"][-1] for port in manifest["graphs"]["policy_step"]["inputs"]}
    style = next(style for style in manifest["styles"] if style["name"] == style_name)
    members, rng = style["z"]["members"], np.random.default_rng(seed)
    env = gymnasium.make("tvae/ZombieAttack-v0")
    successes = 0
    for episode in range(episodes):
        observation, _ = env.reset(seed=seed + episode)
        one = rng.integers(len(members["means"]))
        z = rng.normal(members["means"][one], members["deviations"][one])
        memory, over = np.zeros((1, sizes["memory"]), dtype=np.float32), False
        while not over:
            noise = rng.random((1, sizes["noise"]), dtype=np.float32)
            given = {"observation": observation[None], "z": z[None], "noise": noise}
            given = {name: array.astype(np.float32) for name, array in given.items()}
            given |= {"memory": memory, "most_likely": np.zeros(1, dtype=np.float32)}
            action, memory = session.run(["action", "memory_out"], given)
            attack, heading = action[0]
            action = {"attack": np.array([attack], dtype=np.int8), "heading": np.array(heading, dtype=np.float64)}
            observation, _, terminated, truncated, info = env.step(action)
            over = terminated or truncated
        kept_to_it = info["zombie_dead"] if style_name == "attack" else info["closest_zombie"] >= 1
        successes += bool(info["goal_reached"] and kept_to_it)
    return successes / episodes


if __name__ == "__main__":
    print(f"success: {play(Path(sys.argv[1]), sys.argv[2], episodes=200):.1%}; torch loaded: {'torch' in sys.modules}")
