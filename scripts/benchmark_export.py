"""How long one step of a bot takes: the exported policy in ONNX Runtime on one core, and PyTorch.

    python scripts/benchmark_export.py zombie

Microseconds at batch 1: the fastest and the median of 5,000 steps. "PyTorch bot" is `tvae.Agent`'s policy with all its
checks, "PyTorch graph" the same arithmetic as the exported graph, drawing from given noise.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import torch

import tvae
from tvae.export.parity import draw, in_torch, open_session
from tvae.export.policy import PolicyStep
from tvae.export.writing import write_onnx
from tvae.generate.closed_loop import LatentPolicy
from tvae.model.decoding import Fixed


def microseconds(step: Callable[[], object], count: int = 5_000) -> tuple[float, float]:
    """The fastest and the median of `count` calls."""
    for _ in range(count // 10):
        step()
    taken = []
    for _ in range(count):
        begun = time.perf_counter()
        step()
        taken.append(time.perf_counter() - begun)
    return 1e6 * min(taken), 1e6 * float(np.median(taken))


def main(name: str) -> None:
    """Print a line for each way to take a step."""
    torch.set_num_threads(1)
    model = tvae.TrajectoryVAE.from_pretrained(name)
    graph = PolicyStep(model).eval()
    path = Path(mkdtemp()) / "policy_step.onnx"
    write_onnx(graph, path)
    rng = np.random.default_rng(0)
    given = {port.name: draw(model, port, rng, 1, 1) for port in graph.inputs}
    bot = LatentPolicy(model, Fixed(np.zeros(model.latent_features)))
    bot.reset(1, seed=0)
    observation = given["observation"].astype(np.float64)
    exported, original = open_session(path), in_torch(graph)
    ways: dict[str, Callable[[], object]] = {
        "ONNX Runtime": lambda: exported(given),
        "PyTorch graph": lambda: original(given),
        "PyTorch bot": lambda: bot.act(observation),
    }
    for way, step in ways.items():
        fastest, median = microseconds(step, 5_000 if way == "ONNX Runtime" else 1_000)
        print(f"{way}: fastest {fastest:.0f}, median {median:.0f} microseconds")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "zombie")
