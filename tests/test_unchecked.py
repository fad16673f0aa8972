"""What users meet whose programs nothing checks for types: numbers of NumPy, and things of a wrong kind.

Every call of the package is checked in tests (`conftest.py`), so all of this happens in a process of its own.
"""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json, tempfile
import gymnasium, numpy as np, torch
import tvae
from tvae.data.arrays import from_arrays
from tvae.spaces import Continuous, Space

random = np.random.default_rng(0)
walks = from_arrays([random.normal(size=(5, 2)) for _ in range(12)], [random.normal(size=(4, 1)) for _ in range(12)])
one = np.int64(1)
few = dict(hidden_features=np.int32(8), num_steps=one, policy_steps=one, device=torch.device("cpu"))
model = tvae.fit(walks, seed=np.int64(3), **few)
envs = gymnasium.make_vec("CartPole-v1", num_envs=2)

def saved():
    given = dict(latent_features=np.int64(3), policy_features=np.int64(4), dropout=np.float32(0.5), window=np.int64(2),
                 action_components=np.int64(2), horizon=np.int64(2), stop=np.bool_(True), dynamics=np.bool_(False))
    with tempfile.TemporaryDirectory() as directory:
        tvae.fit(walks, **few, **given).save(directory)
        assert tvae.TrajectoryVAE.load(directory).arguments.items() >= given.items()

attempts = {
    "save": saved,
    "window": lambda: tvae.imagine(model, np.zeros((1, 2)), [[0.0, 0.0]], num_steps=one, window=one, seed=one),
    "fit a path": lambda: tvae.fit("sessions.parquet"),
    "fit a list": lambda: tvae.fit([]),
    "half a window": lambda: tvae.TrajectoryVAE(walks.observation_space, walks.action_space, window=2.5),
    "z of text": lambda: tvae.Agent(model, "attack"),
    "z of styles": lambda: tvae.Agent(model, tvae.discover(model, walks)),
    "z of no numbers": lambda: tvae.Agent(model, [[0.0], [0.0, 1.0]]),
    "many environments": lambda: tvae.Agent(model, [0.0, 0.0], envs),
}
found = {}
for name, attempt in attempts.items():
    try:
        attempt()
        found[name] = "done"
    except Exception as error:
        found[name] = f"{isinstance(error, ValueError)} {error}"
print(json.dumps(found))
"""
NO_Z = "an agent needs a z, or something that samples one such as `playstyles.styles[0]`, got "
MANY = "an agent acts in one environment, got a vector environment; leave `env` out and let `tvae.rollout` play in it"


@pytest.fixture(scope="module")
def found() -> dict[str, str]:
    run = subprocess.run([sys.executable, "-W", "ignore", "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    outcomes: dict[str, str] = json.loads(run.stdout.splitlines()[-1])
    return outcomes


@pytest.mark.parametrize("name", ["save", "window"])
def test_numbers_of_numpy_are_numbers(found: dict[str, str], name: str):
    """What cannot be saved is found out only after a training otherwise."""
    assert found[name] == "done"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("fit a path", "fit needs demonstrations, as tvae.load_demonstrations reads them, got str"),
        ("fit a list", "fit needs demonstrations, as tvae.load_demonstrations reads them, got list"),
        ("half a window", "window must be a whole number, got 2.5"),
        ("z of text", f"{NO_Z}str"),
        ("z of styles", f"{NO_Z}Playstyles"),
        ("z of no numbers", f"{NO_Z}list"),
        ("many environments", MANY),
    ],
)
def test_what_is_of_a_wrong_kind_is_refused_in_words(found: dict[str, str], name: str, message: str):
    assert found[name] == f"True {message}"
