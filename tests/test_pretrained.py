"""Shipped models: written small and whole, found by name, and a bot in three lines."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch

import tvae
from toys import untrained
from tvae.envs.zombie import zombie_demonstrations
from tvae.errors import ModelError
from tvae.evaluate.encoding import Posteriors
from tvae.evaluate.playstyles import find_playstyles
from tvae.experiments.findings import Findings
from tvae.experiments.run_directory import RunDirectory, write_json
from tvae.experiments.shipping import MOST_MEMBERS, ship
from tvae.pretrained import pretrained_directory, pretrained_names

CARD = "# Zombie attack\n\nTwo styles; größer als nichts.\n"
FILES = ["README.md", "config.json", "model.safetensors", "playstyles.json"]


@pytest.fixture(scope="module")
def model() -> tvae.TrajectoryVAE:
    return untrained(zombie_demonstrations(10))


@pytest.fixture(scope="module")
def findings() -> Findings:
    """Two clear styles of 210 and 90 episodes."""
    random = np.random.default_rng(0)
    means = np.repeat([[-4.0, 0.0], [4.0, 0.0]], [210, 90], axis=0) + 0.5 * random.standard_normal((300, 2))
    playstyles = find_playstyles(Posteriors(means, np.full((300, 2), 0.3)))
    return Findings(playstyles, {0: "attack", 1: "avoid"}, {0: ("goes there",), 1: ("goes away",)})


@pytest.fixture
def root(
    model: tvae.TrajectoryVAE, findings: Findings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A package that comes with the model `zombie`."""
    path = tmp_path / "package"
    path.mkdir()
    (path / "__init__.py").touch()
    (path / "__pycache__").mkdir()
    monkeypatch.setattr("tvae.pretrained.ROOT", path)
    ship(model, findings, path / "zombie", CARD)
    return path


def same(left: tvae.TrajectoryVAE, right: tvae.TrajectoryVAE) -> bool:
    ours, theirs = left.state_dict(), right.state_dict()
    return ours.keys() == theirs.keys() and all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_bot_in_three_lines(root: Path):
    env = gymnasium.make("tvae/ZombieAttack-v0")
    model = tvae.TrajectoryVAE.from_pretrained("zombie")
    playstyles = tvae.Playstyles.from_pretrained("zombie")
    agent = tvae.Agent(model, playstyles.styles[0], env)
    observation, _ = env.reset(seed=0)
    assert env.action_space.contains(agent.act(observation))


def test_a_shipped_model_comes_back_whole(root: Path, model: tvae.TrajectoryVAE, findings: Findings):
    assert pretrained_names() == ("zombie",)
    directory = pretrained_directory("zombie")
    assert sorted(path.name for path in directory.iterdir()) == FILES
    assert json.loads((directory / "config.json").read_text()) == model.description()
    assert (directory / "README.md").read_text(encoding="utf-8") == CARD
    loaded = tvae.TrajectoryVAE.from_pretrained("zombie")
    assert same(loaded, model)
    assert not loaded.training
    again = Findings.from_json(json.loads((directory / "playstyles.json").read_text()))
    assert (again.labels, again.words) == (findings.labels, findings.words)
    assert again.playstyles.to_json() == tvae.Playstyles.from_pretrained("zombie").to_json()


def test_only_the_members_are_fewer(root: Path, findings: Findings):
    shipped, whole = tvae.Playstyles.from_pretrained("zombie").to_json(), findings.playstyles.to_json()
    for style, original in zip(shipped["styles"], whole["styles"], strict=True):
        members, everyone = style.pop("members"), original.pop("members")
        kept = list(zip(members["means"], members["scales"], strict=True))
        there = list(zip(everyone["means"], everyone["scales"], strict=True))
        assert len(kept) == min(len(there), MOST_MEMBERS)
        assert [kept[0], kept[-1]] == [there[0], there[-1]]
        positions = [there.index(member) for member in kept]
        assert positions == sorted(set(positions))
    assert shipped == whole
    assert [len(style.members) for style in findings.playstyles.styles] == [210, 90]


@pytest.mark.parametrize("kind", [tvae.TrajectoryVAE, tvae.Playstyles], ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("name", ["chess", "zombie/", "Zombie", "../zombie", "__pycache__", Path("zombie")], ids=repr)
def test_an_unknown_name_says_which_there_are(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type, name: str | Path
):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(ModelError, match=r"there is no model .*: .*the models that come with tvae are zombie"):
        kind.from_pretrained(name)


def test_without_any_shipped_model_the_error_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tvae.pretrained.ROOT", tmp_path)
    with pytest.raises(ModelError, match="the models that come with tvae are none"):
        tvae.TrajectoryVAE.from_pretrained("zombie")


@pytest.mark.parametrize("kind", [str, Path])
def test_a_path_is_a_directory(root: Path, model: tvae.TrajectoryVAE, findings: Findings, tmp_path: Path, kind: type):
    run = RunDirectory.create(tmp_path / "run", force=False)
    model.save(run.path)
    write_json(run.playstyles, findings.to_json())
    assert same(tvae.TrajectoryVAE.from_pretrained(kind(run.path)), model)
    assert tvae.Playstyles.from_pretrained(kind(run.path)).to_json() == findings.playstyles.to_json()


def test_a_shipped_name_means_the_same_in_every_folder(
    root: Path, model: tvae.TrajectoryVAE, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    other = untrained(zombie_demonstrations(10), seed=1)
    other.save("zombie")
    assert same(tvae.TrajectoryVAE.from_pretrained("zombie"), model)
    for path in ("./zombie", Path("zombie")):
        assert same(tvae.TrajectoryVAE.from_pretrained(path), other)


def test_a_directory_that_is_no_model_is_refused(root: Path, tmp_path: Path):
    with pytest.raises(ModelError, match="is not a model directory"):
        tvae.TrajectoryVAE.from_pretrained(tmp_path)
    with pytest.raises(ModelError, match=r"holds no playstyles: it has no playstyles.json"):
        tvae.Playstyles.from_pretrained(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"[1]", b"null", b"{}", b'{"playstyles": {"format": "x"}}', b'{"playstyles": null}']
)
def test_a_file_without_playstyles_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "playstyles.json").write_bytes(content)
    with pytest.raises(ModelError, match=r"playstyles.json does not hold playstyles"):
        tvae.Playstyles.load(tmp_path)


def test_playstyles_without_their_parts_are_refused(tmp_path: Path, findings: Findings):
    data = findings.to_json()
    data["playstyles"]["styles"][0]["members"]["means"] = [[0.0], [1.0]]
    write_json(tmp_path / "playstyles.json", data)
    with pytest.raises(ModelError, match="does not hold playstyles"):
        tvae.Playstyles.load(tmp_path)


def test_what_is_shipped_is_replaced_only_on_demand(root: Path, model: tvae.TrajectoryVAE, findings: Findings):
    with pytest.raises(FileExistsError, match="exists already"):
        ship(model, findings, root / "zombie", "other")
    assert (root / "zombie" / "README.md").read_text(encoding="utf-8") == CARD
    ship(model, findings, str(root / "zombie"), "other", overwrite=True)
    assert (root / "zombie" / "README.md").read_text() == "other"
    assert sorted(path.name for path in root.iterdir()) == ["__init__.py", "__pycache__", "zombie"]


def test_an_interrupted_shipping_leaves_the_old_model(
    root: Path, findings: Findings, model: tvae.TrajectoryVAE, monkeypatch: pytest.MonkeyPatch
):
    def full(*arguments: object, **keywords: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("tvae.experiments.shipping.write_json", full)
    other = untrained(zombie_demonstrations(10), seed=1)
    for name in ("zombie", "new"):
        with pytest.raises(OSError, match="no space left"):
            ship(other, findings, root / name, CARD, overwrite=True)
    assert sorted(path.name for path in root.iterdir()) == ["__init__.py", "__pycache__", "zombie"]
    assert same(tvae.TrajectoryVAE.from_pretrained("zombie"), model)


def test_what_does_not_belong_together_is_not_shipped(
    model: tvae.TrajectoryVAE, findings: Findings, tmp_path: Path
):
    wide = untrained(zombie_demonstrations(10), latent_features=3)
    with pytest.raises(ValueError, match="the model has 3 latent features, and the styles need 2"):
        ship(wide, findings, tmp_path / "zombie", CARD)
    with pytest.raises(ValueError, match="needs a card"):
        ship(model, findings, tmp_path / "zombie", " \n")
    assert list(tmp_path.iterdir()) == []


def test_the_models_of_this_package_are_whole():
    for name in pretrained_names():
        assert sorted(path.name for path in pretrained_directory(name).iterdir()) == FILES
        model, playstyles = tvae.TrajectoryVAE.from_pretrained(name), tvae.Playstyles.from_pretrained(name)
        z = playstyles.styles[0].sample(3, np.random.default_rng(0))
        assert z.shape == (3, model.latent_features)
