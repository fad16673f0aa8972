from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_strategies import assert_same, demonstrations, quick
from tvae.data import growing
from tvae.data.demonstrations import Demonstrations
from tvae.data.ragged import blocks, ranges
from tvae.data.trajectory import DataError, Trajectory
from tvae.files import appearing
from tvae.spaces import Binary, Continuous, Space

X, GO = Space((Continuous("x"),)), Space((Binary("go"),))


def walk(length: int, *, final: bool = True, **attributes: object) -> Trajectory:
    return Trajectory(
        np.arange(length + final, dtype=float)[:, None],
        np.ones((length, 1)),
        {"reward": np.arange(length) / 2},
        attributes,
    )


def walks(*lengths: int) -> Demonstrations:
    episodes = [walk(length, episode=index, group=index // 2) for index, length in enumerate(lengths)]
    return Demonstrations.from_trajectories(episodes, X, GO)


def test_episodes_are_what_went_in() -> None:
    episodes = [walk(3), walk(1, final=False), walk(5)]
    kept = Demonstrations.from_trajectories(iter(episodes), X, GO)
    assert kept.lengths.tolist() == [3, 1, 5]
    assert kept.num_steps == 9
    for mine, theirs in zip(kept, episodes, strict=True):
        assert mine.has_final_observation == theirs.has_final_observation
        assert np.array_equal(mine.observations, theirs.observations)
        assert np.array_equal(mine.actions, theirs.actions)
        assert np.array_equal(mine.steps["reward"], theirs.steps["reward"])


def test_selection_copies_no_steps() -> None:
    kept = walks(3, 1, 5, 2)
    chosen = kept.select([2, 0])
    assert chosen.lengths.tolist() == [5, 3]
    assert chosen.attributes["episode"].tolist() == [2, 0]
    assert np.shares_memory(chosen[0].observations, kept.observations)
    assert [len(episode) for episode in kept[1:3]] == [1, 5]
    assert len(kept[-1]) == 2
    with pytest.raises(IndexError, match="episode 4 of 4"):
        kept[4]


@quick
@given(
    st.lists(st.integers(0, 5), min_size=2, max_size=20).filter(lambda groups: len(set(groups)) > 1),
    st.floats(0.05, 0.95),
    st.integers(0, 5),
)
def test_split_keeps_groups_whole(groups: list[int], fraction: float, seed: int) -> None:
    episodes = [walk(1, episode=index, group=group) for index, group in enumerate(groups)]
    kept = Demonstrations.from_trajectories(episodes, X, GO)
    train, held_out = kept.split(fraction, seed=seed, group="group")
    assert len(train) > 0
    assert len(held_out) > 0
    assert not set(train.attributes["group"]) & set(held_out.attributes["group"])
    assert sorted([*train.attributes["episode"], *held_out.attributes["episode"]]) == list(range(len(groups)))


def test_split_holds_out_the_fraction() -> None:
    train, held_out = walks(*[1] * 100).split(0.2, seed=3)
    assert (len(train), len(held_out)) == (80, 20)
    again = walks(*[1] * 100).split(0.2, seed=3)[1]
    assert np.array_equal(again.attributes["episode"], held_out.attributes["episode"])


def test_split_that_cannot_be() -> None:
    with pytest.raises(DataError, match="a split needs at least 2 episodes, got 1"):
        walks(3).split(0.5)
    with pytest.raises(DataError, match="at least 2 groups of 'group', got 1"):
        walks(3, 3).split(0.5, group="group")
    with pytest.raises(DataError, match="no attribute 'pair'; there are: episode, group"):
        walks(3, 3).split(0.5, group="pair")
    with pytest.raises(ValueError, match="fraction must lie between 0 and 1, got 1"):
        walks(3, 3).split(1.0)


@pytest.mark.parametrize(
    ("episode", "message"),
    [
        (
            Trajectory(np.full((2, 1), np.nan), np.ones((2, 1))),
            "episode 1, step 0, column observation.x: needs",
        ),
        (
            Trajectory(np.zeros((2, 1)), np.array([[1.0], [0.5]])),
            "episode 1, step 1, column action.go: is bin",
        ),
        (
            Trajectory(np.zeros((2, 2)), np.ones((2, 1))),
            r"episode 1: observations need 1 columns \(x\), got 2",
        ),
    ],
)
def test_values_that_do_not_fit_are_named(episode: Trajectory, message: str) -> None:
    first = Trajectory(np.zeros((1, 1)), np.ones((1, 1)))
    with pytest.raises(DataError, match=message):
        Demonstrations.from_trajectories([first, episode], X, GO)


def test_every_episode_has_the_same_facts() -> None:
    with pytest.raises(
        DataError, match=r"episode 1: .* same attributes: the first has none, this one \['label'\]"
    ):
        Demonstrations.from_trajectories([walk(1), walk(1, label="a")], X, GO)
    for mixed in ([1, "a"], [None, None]):
        with pytest.raises(DataError, match="attribute 'label' needs text, numbers or booleans, of one kind"):
            Demonstrations.from_trajectories([walk(1, label=label) for label in mixed], X, GO)
    with pytest.raises(DataError, match="attribute 'label' needs 2 values, got 1"):
        walks(1, 1).with_attributes({"label": np.array(["a"])})


def test_no_episode_at_all() -> None:
    with pytest.raises(DataError, match="at least one episode, got none"):
        Demonstrations.from_trajectories([], X, GO)


@pytest.mark.parametrize(
    ("observations", "actions", "message"),
    [
        (np.zeros((1, 1)), np.zeros((0, 1)), "an episode needs at least one action, got none"),
        (np.zeros((4, 1)), np.zeros((2, 1)), "2 actions need 2 or 3 observations, got 4"),
        (np.zeros(3), np.zeros((2, 1)), r"need the shapes \(steps, signals\), got \(3,\)"),
    ],
)
def test_arrays_that_make_no_trajectory(observations: np.ndarray, actions: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Trajectory(observations, actions)
    with pytest.raises(DataError, match="step column 'reward' needs 2 values, got 3"):
        Trajectory(np.zeros((2, 1)), np.zeros((2, 1)), {"reward": np.zeros(3)})


@quick
@given(demonstrations())
def test_written_and_opened(tmp_path_factory: pytest.TempPathFactory, kept: Demonstrations) -> None:
    directory = tmp_path_factory.mktemp("kept") / "walks.tvae"
    kept.write(directory)
    assert_same(Demonstrations.open(directory), kept)


def test_opened_demonstrations_are_mapped(tmp_path: Path) -> None:
    walks(3, 2).select([1]).write(tmp_path / "kept")
    opened = Demonstrations.open(tmp_path / "kept")
    assert isinstance(opened.observations, np.memmap)
    assert opened.observations.shape == (3, 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept"]


def test_writing_never_overwrites_unasked(tmp_path: Path) -> None:
    directory = tmp_path / "kept"
    walks(3).write(directory)
    with pytest.raises(FileExistsError, match="exists already"):
        walks(4).write(directory)
    assert Demonstrations.open(directory).num_steps == 3
    walks(4).write(directory, overwrite=True)
    assert Demonstrations.open(directory).num_steps == 4
    (tmp_path / "thesis").mkdir()
    with pytest.raises(FileExistsError, match="holds no demonstrations"):
        walks(4).write(tmp_path / "thesis", overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept", "thesis"]


def test_a_damaged_directory_is_named(tmp_path: Path) -> None:
    directory = tmp_path / "kept"
    walks(3).write(directory)
    (directory / "actions.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(DataError, match="kept: no whole set of demonstrations"):
        Demonstrations.open(directory)
    (directory / "demonstrations.json").write_text('{"format": "other"}')
    with pytest.raises(
        DataError, match="needs format tvae-demonstrations, version 1, got 'other', version None"
    ):
        Demonstrations.open(directory)
    with pytest.raises(DataError, match="nowhere: no whole set of demonstrations"):
        Demonstrations.open(tmp_path / "nowhere")


def test_much_data_is_kept_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    in_memory = walks(3, 1, 5, 2)
    monkeypatch.setattr(growing, "SPILL_BYTES", 40)
    on_disk = walks(3, 1, 5, 2)
    assert isinstance(on_disk.observations, np.memmap)
    assert_same(on_disk, in_memory)


def test_what_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "older").write_text("older")
    for name in ("older", "newer"):
        with suppress(ZeroDivisionError), appearing(tmp_path / name, overwrite=True) as partial:
            partial.write_text("half")
            raise ZeroDivisionError
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("older", "older")]


@pytest.mark.parametrize("directory", [False, True])
def test_what_another_process_wrote_in_the_meantime_stays(tmp_path: Path, *, directory: bool) -> None:
    def write(path: Path, text: str) -> None:
        if directory:
            path.mkdir()
        (path / "part" if directory else path).write_text(text)

    def both_write() -> None:
        with appearing(target) as partial:
            write(partial, "ours")
            write(target, "theirs")

    target = tmp_path / "z"
    with pytest.raises(FileExistsError, match="z exists already"):
        both_write()
    assert [path.name for path in tmp_path.iterdir()] == ["z"]
    assert (target / "part" if directory else target).read_text() == "theirs"


@quick
@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 5)), max_size=8))
def test_ranges(pairs: list[tuple[int, int]]) -> None:
    starts, counts = (np.array([pair[axis] for pair in pairs], dtype=np.int64) for axis in (0, 1))
    expected = [start + index for start, count in pairs for index in range(count)]
    assert ranges(starts, counts).tolist() == expected


@quick
@given(st.lists(st.integers(1, 9), min_size=1, max_size=20), st.integers(1, 20))
def test_blocks_hold_everything_once_and_not_too_much(lengths: list[int], most: int) -> None:
    parts = list(blocks(np.array(lengths), most))
    assert [index for part in parts for index in range(part.start, part.stop)] == list(range(len(lengths)))
    for part in parts:
        assert sum(lengths[part]) <= most or part.stop == part.start + 1
