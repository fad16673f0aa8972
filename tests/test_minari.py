import json
import socket
import warnings
from collections import OrderedDict
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
import pytest
from gymnasium import spaces as gym
from hypothesis import given
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from data_strategies import assert_same, demonstrations, quick
from tvae.data.demonstrations import Demonstrations
from tvae.data.minari_source import find_minari, is_minari_id, minari_root, read_minari
from tvae.data.minari_target import write_minari
from tvae.data.preparation import Preparation
from tvae.data.sources import load_demonstrations
from tvae.data.tabular import read_table, write_csv, write_parquet
from tvae.data.trajectory import DataError, Trajectory
from tvae.gymnasium_spaces import space_from_gymnasium
from tvae.spaces import Angular, Binary, Categorical, Continuous, Space

ID = "studio/walks/human-v0"


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root of its own, and no network and no environment for anyone."""

    def forbidden(*args: Any, **kwargs: Any) -> None:
        raise AssertionError("reading data must not do this")

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    monkeypatch.setattr(socket, "socket", forbidden)
    monkeypatch.setattr(gymnasium, "make", forbidden)
    return tmp_path / "root"


def walks() -> Demonstrations:
    observation_space = Space((Continuous("z"), Angular("heading"), Categorical("room", ("hall", "attic"))))
    action_space = Space((Angular("turn"), Binary("jump")))
    episodes = [
        Trajectory(
            np.array([[index, 0.5, 1.0]] * (3 + index)),
            np.array([[-0.5, 1.0]] * 3),
            {"info.health": np.arange(3), "info.mood": np.array(["a", "bb", ""])},
            {"episode": f"session {index}", "label": "fast", "seed": "none"},
        )
        for index in (0, 1)
    ]
    return Demonstrations.from_trajectories(episodes, observation_space, action_space)


def foreign(
    observation_space: gymnasium.Space[Any],
    action_space: gymnasium.Space[Any],
    buffers: list[EpisodeBuffer],
    data_format: str = "hdf5",
) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Minari asks for authors, links and more
        return minari.create_dataset_from_buffers(
            ID,
            buffers,
            observation_space=observation_space,
            action_space=action_space,
            data_format=data_format,
        )


def plain_buffer(length: int = 2, **changes: Any) -> EpisodeBuffer:
    return EpisodeBuffer(
        **{
            "observations": np.arange(length + 1, dtype=np.float32)[:, None],
            "actions": np.zeros(length, dtype=np.int64),
            "rewards": np.arange(length) / 2,
            "terminations": np.arange(length) == length - 1,
            "truncations": np.zeros(length, dtype=bool),
            **changes,
        }
    )


@quick
@given(demonstrations())
def test_nothing_is_lost(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    directory = tmp_path_factory.mktemp("minari")
    write_minari(kept, directory / "walks")
    from_minari = read_minari(directory / "walks")
    assert_same(from_minari, kept)
    write_parquet(from_minari, directory / "walks.parquet")
    from_parquet = read_table(directory / "walks.parquet")
    assert_same(from_parquet, kept)
    write_csv(from_parquet, directory / "walks.csv")
    write_minari(read_table(directory / "walks.csv"), directory / "again")
    assert_same(read_minari(directory / "again"), kept)


def test_minari_opens_what_we_write(root: Path) -> None:
    write_minari(walks(), ID, description="two walks")
    assert list(minari.list_local_datasets()) == [ID]
    dataset = minari.load_dataset(ID)
    assert (dataset.total_episodes, dataset.total_steps) == (2, 6)
    assert dataset.observation_space == gym.Dict(
        {
            "heading": gym.Box(-np.pi, np.pi, (1,), np.float64),
            "room": gym.Discrete(2),
            "z": gym.Box(-np.inf, np.inf, (1,), np.float64),
        }
    )
    first, second = dataset
    assert first.observations["z"].tolist() == [[0], [0], [0], [0]]
    assert second.observations["room"].tolist() == [1, 1, 1, 1]
    assert second.actions["jump"].tolist() == [[1], [1], [1]]
    assert first.truncations.tolist() == [False, False, True]
    assert first.infos["health"].tolist() == [0, 1, 2]
    assert next(iter(dataset.storage.get_episode_metadata([0])))["label"] == "fast"
    assert_same(read_minari(ID), walks())
    assert_same(read_minari(root / ID), walks())


def test_one_kind_of_signal_is_one_array(tmp_path: Path) -> None:
    space, moves = Space((Continuous("x"), Angular("b"))), Space((Categorical("go", (0, 1)),))
    walk = Trajectory(np.zeros((3, 2)), np.ones((2, 1)), {"reward": np.ones(2)})
    write_minari(Demonstrations.from_trajectories([walk], space, moves), tmp_path / "walk")
    storage = MinariStorage.read(tmp_path / "walk" / "data")
    assert storage.observation_space.shape == (2,)
    assert storage.action_space == gym.Discrete(2)
    assert storage.metadata["dataset_id"] == "walk-v0"
    assert read_minari(tmp_path / "walk").observation_space == space


def test_an_environment_is_noted(tmp_path: Path) -> None:
    write_minari(walks(), tmp_path / "walk-v3", environment="CartPole-v1")
    dataset = minari.MinariDataset(tmp_path / "walk-v3" / "data")
    assert dataset.env_spec.id == "CartPole-v1"
    assert dataset.id == "walk-v3"


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    write_minari(walks(), ID)
    with pytest.raises(FileExistsError, match="exists already"):
        write_minari(walks()[:1], ID)
    assert len(read_minari(ID)) == 2
    write_minari(walks()[:1], ID, overwrite=True)
    assert len(read_minari(ID)) == 1
    (tmp_path / "thesis").mkdir()
    with pytest.raises(FileExistsError, match="is no Minari data set"):
        write_minari(walks(), tmp_path / "thesis", overwrite=True)
    with pytest.raises(DataError, match=r"looks like namespace/name-v0, got '\.\./thesis'"):
        write_minari(walks(), "../thesis")


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(MinariStorage, "update_metadata", fail)
    with pytest.raises(OSError, match="disk full"):
        write_minari(walks(), tmp_path / "new" / "walk")
    assert list((tmp_path / "new").iterdir()) == []


@pytest.mark.parametrize("data_format", ["hdf5", "arrow"])
def test_a_data_set_of_others(data_format: str) -> None:
    observation_space = gym.Dict(
        OrderedDict(
            [
                ("pose", gym.Tuple((gym.Box(-np.pi, np.pi, (), np.float64), gym.Discrete(3, start=1)))),
                ("at", gym.Box(0, 9, (2,), np.float32)),
            ]
        )
    )
    action_space = gym.MultiBinary(2)
    buffers = [
        EpisodeBuffer(
            seed=seed,
            observations={
                "pose": (np.linspace(0, 1, length + 1), np.full(length + 1, 3)),
                "at": np.ones((length + 1, 2), dtype=np.float32),
            },
            actions=np.eye(2, dtype=np.int8)[np.zeros(length, dtype=int)],
            rewards=np.arange(length, dtype=float),
            terminations=np.arange(length) == length - 1,
            truncations=np.zeros(length, dtype=bool),
            infos={"health": list(range(length + 1)), "deep": {"name": [f"n{i}" for i in range(length + 1)]}},
        )
        for seed, length in ((7, 3), (8, 1))
    ]
    if data_format == "arrow":
        for buffer in buffers:
            del buffer.infos["deep"]
    dataset = foreign(observation_space, action_space, buffers, data_format)
    dataset.storage.update_episode_metadata([{"label": "slow"}, {"label": "fast", "only": 1}])
    kept = read_minari(ID)
    assert kept.observation_space.signals == (
        Continuous("at.0"),
        Continuous("at.1"),
        Angular("pose.0"),
        Categorical("pose.1", (1, 2, 3)),
    )
    assert kept.action_space == space_from_gymnasium(action_space)
    assert kept.final_observed.all()
    assert kept[0].observations[-1].tolist() == [1.0, 1.0, 1.0, 2.0]
    assert kept[0].actions.tolist() == [[1, 0]] * 3
    assert kept[0].steps["reward"].tolist() == [0, 1, 2]
    assert kept[0].steps["terminated"].tolist() == [False, False, True]
    assert kept[0].steps["info.health"].tolist() == [1, 2, 3]
    if data_format == "hdf5":
        assert kept[0].steps["info.deep.name"].tolist() == ["n1", "n2", "n3"]
    assert kept[1].attributes == {"episode": 1, "seed": 8, "label": "fast"}


def test_infos_that_are_no_scalars_are_left_out() -> None:
    infos = {"camera": np.zeros((3, 4)), "summary": np.zeros(7), "score": np.ones(2)}
    foreign(gym.Box(0, 9, (1,)), gym.Discrete(2), [plain_buffer(infos=infos)])
    assert sorted(read_minari(ID).steps) == ["info.score", "reward", "terminated", "truncated"]


@pytest.mark.parametrize(
    ("buffers", "message"),
    [
        (
            [plain_buffer(), plain_buffer(observations=np.full((3, 1), np.nan, np.float32))],
            r"episode 1, step 0, column observation\.0: needs a finite number, got nan",
        ),
        (
            [plain_buffer(actions=np.array([0, 5]))],
            r"episode 0, step 1, column action\.0: needs a category index from 0 to 1, got 5",
        ),
        (
            [plain_buffer(observations=np.zeros((7, 1), np.float32))],
            "episode 0: 2 actions need 2 or 3 observations, got 7",
        ),
        (
            [plain_buffer(infos={"a": np.ones(3)}), plain_buffer()],
            "episode 1: lacks 'a', which other episodes have",
        ),
        ([], "needs at least one episode, got none"),
    ],
)
def test_bad_values_are_refused_by_place(buffers: list[EpisodeBuffer], message: str) -> None:
    foreign(gym.Box(0, 9, (1,)), gym.Discrete(2), buffers)
    with pytest.raises(DataError, match=f"{ID}: {message}"):
        read_minari(ID)


def test_spaces_that_are_no_vectors_are_refused() -> None:
    images = np.zeros((3, 64, 64, 3), dtype=np.uint8)
    space = gym.Box(0, 255, (64, 64, 3), np.uint8)
    foreign(space, gym.Discrete(2), [plain_buffer(observations=images)])
    message = r"observations: the space has the shape \(64, 64, 3\) and dtype uint8, .*: images cannot be learned from"
    with pytest.raises(DataError, match=message + r".*name the parts to read instead \(--only\)"):
        read_minari(ID)


def test_parts_that_are_no_vectors_are_left_out() -> None:
    space = gym.Dict(
        {
            "eye": gym.Box(0, 255, (64, 64, 3), np.uint8),
            "mission": gym.Text(9),
            "state": gym.Dict({"at": gym.Box(-9, 9, (2,)), "key": gym.Discrete(2)}),
        }
    )
    seen = {
        "eye": np.zeros((3, 64, 64, 3), dtype=np.uint8),
        "mission": ["go"] * 3,
        "state": {"at": np.arange(6, dtype=np.float32).reshape(3, 2), "key": np.array([0, 1, 1])},
    }
    foreign(space, gym.Discrete(2), [plain_buffer(observations=seen)])
    with pytest.raises(DataError, match=r"observations: space 'eye' has the shape \(64, 64, 3\) and dtype uint8"):
        read_minari(ID)
    with pytest.raises(DataError, match=r"observations: space 'mission' is Text\(.*, such as action and obs"):
        read_minari(ID, ("observation.mission", "action"))
    kept = read_minari(ID, ("observation.state", "action"))
    assert kept.observation_space.names == ("state.at.0", "state.at.1", "state.key")
    assert kept[0].observations.tolist() == [[0, 1, 0], [2, 3, 1], [4, 5, 1]]
    chosen = load_demonstrations(ID, preparation=Preparation(columns=("observation.state.at.1", "action.*")))
    assert chosen[0].observations.tolist() == [[1], [3], [5]]
    assert chosen.action_space.names == ("0",)
    for columns, message in (
        (("action",), r"needs at least one part of observations to read; there are observation\.eye, obs"),
        (("observation.state",), r"needs at least one column action\.\* to read; there are action\.0"),
        (("observation.state", "action", "reward"), r"no column is called 'reward'"),
    ):
        with pytest.raises(DataError, match=f"{ID}: {message}"):
            read_minari(ID, columns)


def test_parts_of_ours() -> None:
    write_minari(walks(), ID)
    kept = read_minari(ID, ("observation.room", "observation.z", "action.jump"))
    assert kept.observation_space.names == ("z", "room")
    assert kept[1].observations.tolist() == [[1, 1]] * 4
    assert kept.action_space.signals == (Binary("jump"),)
    assert kept.attributes["label"].tolist() == ["fast", "fast"]


def damage(path: Path, **changes: Any) -> None:
    metadata = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({name: value for name, value in metadata.items() if value is not None}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observation_space": None}, "the metadata must state 'observation_space'"),
        ({"action_space": None, "env_spec": '{"id": "evil:Evil-v0"}'}, "must state 'action_space'"),
        ({"observation_space": '{"type": "Evil"}'}, "cannot be read as a Minari data set"),
        ({"data_format": "pickle"}, "cannot be read as a Minari data set"),
        ({"total_episodes": 3}, "cannot be read as a Minari data set"),
        ({"tvae": {"version": 99}}, "version 1 of our notes is needed, got 99"),
        ({"tvae": {"version": 1}}, "cannot be read as a Minari data set"),
    ],
)
def test_damaged_metadata(root: Path, changes: dict[str, Any], message: str) -> None:
    write_minari(walks(), ID)
    damage(root / ID / "data" / "metadata.json", **changes)
    with pytest.raises(DataError, match=message):
        read_minari(ID)


def test_damaged_files(root: Path) -> None:
    write_minari(walks(), ID)
    data = root / ID / "data" / "main_data.hdf5"
    data.write_bytes(data.read_bytes()[:1000])
    with pytest.raises(DataError, match="cannot be read as a Minari data set"):
        read_minari(ID)
    (root / ID / "data" / "metadata.json").write_text("{")
    with pytest.raises(DataError, match="cannot be read as a Minari data set"):
        read_minari(ID)


def test_a_data_set_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"D4RL/door/human-v2: no Minari data set there, nor under"):
        read_minari("D4RL/door/human-v2")
    assert find_minari(tmp_path) is None
    assert not minari_root().exists()
    assert [is_minari_id(text) for text in ("a-v0", "a/b-v12", "/a-v0", "a", "../a-v0", "a.csv")] == [
        True,
        True,
        *[False] * 4,
    ]
