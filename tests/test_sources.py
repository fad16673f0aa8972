from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces as gym
from hypothesis import given

from data_strategies import assert_same, demonstrations, quick
from tvae.data.arrays import from_arrays
from tvae.data.demonstrations import Demonstrations
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.data.trajectory import DataError
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

TARGETS = ["a.parquet", "a.csv", "b.csv.gz", "a.tvae", "minari:walks", "minari:studio/walks-v0"]


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    monkeypatch.chdir(tmp_path)


def walks(label: str = "east") -> Demonstrations:
    return from_arrays(
        [np.array([[0.5, 1.0], [1.5, 2.0], [2.5, 3.0]])],
        [np.array([True, False])],
        observation_space=Space((Continuous("x"), Categorical("room", ("hall", "attic", "cellar", "roof")))),
        labels=[label],
    )


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_saved_is_loaded(target: str) -> None:
    save_demonstrations(walks(), target)
    assert_same(load_demonstrations(target), walks())
    with pytest.raises(FileExistsError, match="exists already"):
        save_demonstrations(walks("west"), target)
    save_demonstrations(walks("west"), target, overwrite=True)
    assert_same(load_demonstrations(target), walks("west"))


@quick
@given(demonstrations())
def test_from_form_to_form(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    directory = tmp_path_factory.mktemp("forms")
    passed_on = kept
    for name in ("a.parquet", "a.csv", "b.csv.gz", "a.tvae"):
        save_demonstrations(passed_on, directory / name)
        passed_on = load_demonstrations(directory / name)
    assert_same(passed_on, kept)


def test_a_minari_data_set_by_directory_and_id(tmp_path: Path) -> None:
    save_demonstrations(walks(), "minari:studio/walks-v0")
    for source in (
        "studio/walks-v0",
        "minari:studio/walks-v0",
        tmp_path / "root" / "studio" / "walks-v0",
        tmp_path / "root" / "studio" / "walks-v0" / "data",
    ):
        assert_same(load_demonstrations(source), walks())


@pytest.mark.parametrize("target", TARGETS)
def test_kinds_are_overridden_in_every_form(target: str) -> None:
    save_demonstrations(walks(), target)
    kept = load_demonstrations(target, angular=["observation.x"])
    assert kept.observation_space.signals[0] == Angular("x")
    assert kept[0].observations.tolist() == walks()[0].observations.tolist()
    for overrides, message in (
        ({"angular": ["observation.y"]}, r"column observation\.y:? was given a kind"),
        ({"continuous": ["observation.room"]}, r"column observation\.room: cannot be continuous"),
        ({"categorical": ["observation.x"]}, r"column observation\.x: cannot be categorical"),
    ):
        with pytest.raises(DataError, match=message):
            load_demonstrations(target, **overrides)


def test_values_change_with_their_kind(tmp_path: Path) -> None:
    kept = from_arrays([np.array([3, 9, 9])], [np.array([1.0, 5.0])])
    save_demonstrations(kept, tmp_path / "a.tvae")
    changed = load_demonstrations(tmp_path / "a.tvae", continuous=["observation.0"], categorical=["action.0"])
    assert changed.observation_space.signals == (Continuous("0"),)
    assert changed[0].observations[:, 0].tolist() == [3, 9, 9]
    assert changed.action_space.signals == (Categorical("0", (1, 5)),)
    assert changed[0].actions[:, 0].tolist() == [0, 1]
    assert kept[0].observations[:, 0].tolist() == [0, 1, 1]


@pytest.mark.parametrize("target", TARGETS)
def test_spaces_that_are_expected(target: str) -> None:
    save_demonstrations(walks(), target)
    space = walks().observation_space
    assert_same(load_demonstrations(target, observation_space=space), walks())
    with pytest.raises(DataError, match=r"not expected|observations differ from what is expected: 1 signals"):
        load_demonstrations(target, observation_space=Space((Continuous("x"),)))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("nowhere.csv", "there is no such file"),
        ("nowhere.parquet", "there is no such file"),
        (
            "nowhere",
            "no such file, no such directory, and no Minari id either, which looks like namespace/name-v0",
        ),
        (
            "D4RL/door/human-v2",
            "no Minari data set of this id under .*root; `minari download D4RL/door/human-v2`",
        ),
        ("minari:nothing", "no Minari data set there"),
        ("empty", r"a directory without demonstrations\.json .* without metadata\.json .* Parquet and CSV files"),
        ("notes.txt", r"needs to end with one of \.parquet, \.pq, \.csv, \.csv\.gz"),
        ("wrong.csv", "the name says text, but the contents are Parquet"),
    ],
)
def test_sources_that_are_none(tmp_path: Path, source: str, message: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("hello")
    save_demonstrations(walks(), tmp_path / "right.parquet")
    (tmp_path / "right.parquet").rename(tmp_path / "wrong.csv")
    with pytest.raises(DataError, match=message) as caught:
        load_demonstrations(source)
    assert str(caught.value).startswith(source.removeprefix("minari:"))


def test_a_target_of_an_unknown_form() -> None:
    with pytest.raises(
        DataError, match=r"the name needs to end with \.parquet, .*\.tvae, or to begin with minari:"
    ):
        save_demonstrations(walks(), "walks.xlsx")


# Arrays in memory


def test_kinds_of_arrays() -> None:
    kept = from_arrays(
        [np.zeros((3, 2), np.float32), np.zeros((2, 2), np.float32)],
        [np.array(["go", "stop"]), np.array(["go"])],
        groups=[7, 8],
    )
    assert kept.observation_space.signals == (Continuous("0"), Continuous("1"))
    assert kept.action_space.signals == (Categorical("0", ("go", "stop")),)
    assert kept.final_observed.tolist() == [True, True]
    assert kept.attributes["group"].tolist() == [7, 8]
    assert from_arrays([[0.0]], [[True]]).action_space.signals == (Binary("0"),)


def test_arrays_of_a_gymnasium_space() -> None:
    observation_space = gym.Dict({"at": gym.Box(0, 9, (2,)), "room": gym.Discrete(3)})
    kept = from_arrays(
        [{"at": np.ones((3, 2)), "room": np.array([0, 1, 2])}],
        [np.array([4, 5])],
        observation_space=observation_space,
        action_space=gym.Discrete(2, start=4),
    )
    assert kept[0].observations.tolist() == [[1, 1, 0], [1, 1, 1], [1, 1, 2]]
    assert kept[0].actions.tolist() == [[0], [1]]
    with pytest.raises(DataError, match="observations do not fit Dict"):
        from_arrays([{"at": np.ones((3, 2))}], [np.ones((2, 1))], observation_space=observation_space)


@pytest.mark.parametrize(
    ("observations", "actions", "options", "message"),
    [
        (
            [np.zeros(3)],
            [np.arange(30)[:3], np.zeros(3)],
            {},
            "2 episodes of actions need as many observations",
        ),
        (
            [np.zeros(3)],
            [np.zeros(3)],
            {"labels": ["a", "b"]},
            "1 episodes of actions need as many label, got 2",
        ),
        ([], [], {}, "at least one episode"),
        (
            [np.zeros(30)],
            [np.arange(30)],
            {},
            "column action.0: holds 30 different integers.*pass action_space",
        ),
        (
            [np.zeros((3, 2)), np.zeros((3, 1))],
            [np.zeros(3)] * 2,
            {},
            "same columns, got float64 of width 1, float",
        ),
        ([np.zeros((3, 2, 2))], [np.zeros(3)], {}, r"episode 0: observations need an array .* \(3, 2, 2\)"),
        ([[None, 1.0]], [np.zeros(2)], {}, "episode 0: observations need an array .* got object"),
        ([np.zeros(3)] * 2, [np.zeros(3), np.zeros(9)], {}, "episode 1: 9 actions need 9 or 10 observations"),
        ([np.zeros(3)], [np.zeros(0)], {}, "episode 0: an episode needs at least one action"),
        (
            [np.array([0.0, np.nan])],
            [np.zeros(2)],
            {},
            "episode 0, step 1, column observation.0: needs a finite",
        ),
        (
            [np.array(["a", "b"])],
            [np.zeros(2)],
            {"observation_space": Space((Categorical("x", ("a", "b")),))},
            "observations need raw numbers where a space is given, got text",
        ),
        (
            [np.zeros(2)],
            [np.array([0.0, 3.0])],
            {"action_space": Space((Binary("jump"),))},
            "episode 0, step 1, column action.jump: is binary and needs 0 or 1, got 3",
        ),
    ],
)
def test_arrays_that_are_refused(
    observations: list[Any], actions: list[Any], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        from_arrays(observations, actions, **options)
