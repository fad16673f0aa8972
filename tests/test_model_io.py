"""Saved models come back the same, and what is no model is refused in words without running any of it."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from toys import ACTIONS, OBSERVATIONS, noise, untrained
from tvae.data.batches import batch_of
from tvae.errors import ModelError
from tvae.model.elbo import log_likelihood
from tvae.model.saving import write_tensors
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import whole

EXTREMES = {
    "plain": {},
    "everything": {
        "latent_features": 3,
        "window": 4,
        "dropout": 0.2,
        "stop": True,
        "action_components": 3,
        "state_components": 2,
        "prior_components": 2,
        "state_floor": 0.3,
        "action_floor": 0.4,
        "encode_actions": False,
        "dynamics": True,
    },
    "without latent": {"latent_features": 0, "stop": False},
}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    directory = tmp_path / "model"
    untrained(noise([4, 7, 5])).save(directory)
    return directory


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ({"latent_features": -1}, "latent_features must be at least 0, got -1"),
        ({"hidden_features": 0}, "hidden_features must be at least 1, got 0"),
        ({"action_components": 0}, "action_components must be at least 1, got 0"),
    ],
)
def test_counts_that_cannot_be_are_refused_by_name(argument: dict, message: str):
    with pytest.raises(ValueError, match=message):
        TrajectoryVAE(OBSERVATIONS, ACTIONS, **argument)


def edit(directory: Path, **changes: object) -> None:
    path = directory / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize("name", EXTREMES)
@pytest.mark.parametrize("kind", [str, Path])
def test_a_model_comes_back_the_same(tmp_path: Path, name: str, kind: type):
    model = untrained(noise([4, 7, 5]), **EXTREMES[name])
    model.save(kind(tmp_path / "deep" / "model"))
    loaded = TrajectoryVAE.load(kind(tmp_path / "deep" / "model"))
    assert sorted(path.name for path in (tmp_path / "deep" / "model").iterdir()) == ["config.json", "model.safetensors"]
    assert not loaded.training
    assert (loaded.observation_space, loaded.action_space) == (OBSERVATIONS, ACTIONS)
    assert loaded.arguments == model.arguments
    assert loaded.arguments.items() >= EXTREMES[name].items()
    batch = batch_of(noise([6, 2], [True, False], seed=1), np.arange(2))
    with torch.no_grad():
        for one, other in zip(
            log_likelihood(model, batch, model.posterior(batch).mean, whole(batch)),
            log_likelihood(loaded, batch, loaded.posterior(batch).mean, whole(batch)),
            strict=True,
        ):
            assert torch.equal(one, other)


def test_a_description_from_before_an_argument_was_added_means_its_default(tmp_path: Path):
    model = untrained(noise([4, 7, 5]))
    model.save(tmp_path)
    older = {name: value for name, value in model.arguments.items() if name not in {"encode_actions", "dynamics"}}
    assert len(older) == len(model.arguments) - 2
    edit(tmp_path, arguments=older)
    loaded = TrajectoryVAE.load(tmp_path)
    assert loaded.arguments == model.arguments
    assert (loaded.encode_actions, loaded.dynamics) == (True, False)


def test_saving_again_replaces(saved: Path):
    other = untrained(noise([4, 7, 5]), seed=1, hidden_features=5)
    other.save(saved)
    assert TrajectoryVAE.load(saved).arguments["hidden_features"] == 5


@pytest.mark.parametrize("cut", [0, 5, 100, -1])
def test_truncated_weights_are_refused(saved: Path, cut: int):
    path = saved / "model.safetensors"
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(ModelError, match=r"model.safetensors is missing or truncated"):
        TrajectoryVAE.load(saved)


@pytest.mark.parametrize(
    ("missing", "message"),
    [("model.safetensors", "is missing or truncated"), ("config.json", "not a model directory: it has no config.json")],
)
def test_missing_files_are_named(saved: Path, missing: str, message: str):
    (saved / missing).unlink()
    with pytest.raises(ModelError, match=message):
        TrajectoryVAE.load(saved)


def test_a_directory_that_is_none_is_refused(tmp_path: Path):
    with pytest.raises(ModelError, match="is not a model directory"):
        TrajectoryVAE.load(tmp_path / "nowhere")


@pytest.mark.parametrize("content", [b"", b'{"format": ', b"\xff\xfe\x00", b"not json"])
def test_a_config_that_is_not_json_is_refused(saved: Path, content: bytes):
    (saved / "config.json").write_bytes(content)
    with pytest.raises(ModelError, match=r"config.json is not whole JSON"):
        TrajectoryVAE.load(saved)


@pytest.mark.parametrize(
    "content",
    [
        {"model_type": "bert", "hidden_size": 768, "architectures": ["BertModel"]},
        [1, 2],
        "text",
        None,
        {"format": "tvae"},
    ],
)
def test_a_config_of_another_project_is_refused(saved: Path, content: object):
    (saved / "config.json").write_text(json.dumps(content))
    with pytest.raises(ModelError, match="does not describe a tvae model"):
        TrajectoryVAE.load(saved)


@pytest.mark.parametrize(
    ("version", "message"),
    [
        (5, "has schema version 5, this tvae reads version 4: it was written by a newer release"),
        (3, "has schema version 3, this tvae reads version 4: it was written by an older release"),
        (None, "schema version None"),
        ("4", "schema version 4, this tvae reads version 4: it was written by an older"),
    ],
)
def test_other_schema_versions_are_refused(saved: Path, version: object, message: str):
    edit(saved, schema_version=version)
    with pytest.raises(ModelError, match=message):
        TrajectoryVAE.load(saved)


@pytest.mark.parametrize(
    "changes",
    [
        {"arguments": {"hidden_features": 8, "layers": 3}},
        {"arguments": {"hidden_features": -8}},
        {"arguments": {"hidden_features": "many"}},
        {"arguments": {"dropout": 2.0}},
        {"arguments": {"window": 0}},
        {"arguments": {"state_floor": 0}},
        {"arguments": [1]},
        {"arguments": None},
        {"observation_space": [1, 2]},
        {"observation_space": [{"kind": "image", "name": "x"}]},
        {"observation_space": [{"kind": "categorical", "name": "x"}]},
        {"action_space": None},
    ],
    ids=str,
)
def test_a_description_that_makes_no_sense_is_refused(saved: Path, changes: dict):
    edit(saved, **changes)
    with pytest.raises(ModelError, match=r"config.json does not describe a model"):
        TrajectoryVAE.load(saved)


def test_a_description_without_its_parts_is_refused(saved: Path):
    (saved / "config.json").write_text(json.dumps({"format": "tvae-model", "schema_version": 4}))
    with pytest.raises(ModelError, match="does not describe a model"):
        TrajectoryVAE.load(saved)


def test_weights_of_other_shapes_are_refused(saved: Path):
    edit(saved, arguments={"hidden_features": 9})
    with pytest.raises(ModelError, match="holds another model's weights"):
        TrajectoryVAE.load(saved)


@pytest.mark.parametrize("change", ["less", "more"])
def test_weights_of_other_names_are_refused(saved: Path, change: str):
    path = saved / "model.safetensors"
    tensors = load_file(path)
    if change == "less":
        tensors.pop("observation_normalizer.mean")
    else:
        tensors["extra"] = torch.zeros(1)
    save_file(tensors, path)
    with pytest.raises(ModelError, match="holds another model's weights"):
        TrajectoryVAE.load(saved)


class Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("how", ["pickle", "torch"])
def test_nothing_is_executed(saved: Path, tmp_path: Path, how: str):
    sprung, weights = tmp_path / "sprung", saved / "model.safetensors"
    if how == "pickle":
        weights.write_bytes(pickle.dumps(Trap(sprung)))
    else:
        torch.save({"model": Trap(sprung)}, weights)
    with pytest.raises(ModelError, match="missing or truncated"):
        TrajectoryVAE.load(saved)
    assert not sprung.exists()
    pickle.loads(pickle.dumps(Trap(sprung)))  # noqa: S301 - the trap itself works
    assert sprung.exists()


def test_an_interrupted_save_leaves_the_old_model(saved: Path, monkeypatch: pytest.MonkeyPatch):
    before = load_file(saved / "model.safetensors")

    def full(*arguments: object, **keywords: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("tvae.model.saving.save_file", full)
    with pytest.raises(OSError, match="no space left"):
        untrained(noise([4, 7, 5]), seed=1).save(saved)
    after = TrajectoryVAE.load(saved).state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_weights_that_cannot_be_written_are_an_error_of_the_system(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    path = tmp_path / "model.safetensors"
    write_tensors(path, {"weight": torch.ones(2)})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"model\.safetensors cannot be written: "):
            write_tensors(path, {"weight": torch.ones(10_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert load_file(path)["weight"].tolist() == [1, 1]
    assert [found.name for found in tmp_path.iterdir()] == ["model.safetensors"]
