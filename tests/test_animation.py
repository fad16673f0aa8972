"""Animations show the episodes they are given: artists are read back, and files opened again."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.animation import AbstractMovieWriter
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image

from tvae.data.trajectory import Trajectory
from tvae.envs.zombie import AttackExpert, StraightWalk, ZombieAttackVectorEnv, success
from tvae.errors import TvaeError
from tvae.figures.animation import animate
from tvae.figures.palette import ALERT, MUTED, PAPER
from tvae.figures.scene import Scene, in_proportion
from tvae.figures.video import require_video, save_animation
from tvae.figures.zombie import zombie_paths
from tvae.figures.zombie_cell import ZombieCell, killing_step, square_around
from tvae.rollouts import rollout

HELD = 15


def _walk(length: int, attacks: tuple[int, ...] = (), distances: tuple[float, ...] | None = None) -> Trajectory:
    """Straight towards the goal; the zombie stands to the north, at these distances."""
    observations = np.tile([0.0, np.pi / 4, 2.0, np.pi / 2], (length + 1, 1))
    observations[:, 0] = 50**0.5 - 0.5 * np.arange(length + 1)
    if distances is not None:
        observations[:, 2] = distances
    actions = np.tile([0.0, np.pi / 4], (length, 1))
    actions[list(attacks), 0] = 1
    return Trajectory(observations, actions)


def _scene(**changes) -> Scene:
    episodes = [_walk(2), _walk(4, (1,)), _walk(3), _walk(1)]
    means = np.random.default_rng(0).normal(size=(6, 2))
    scene = Scene(
        episodes=episodes,
        succeeded=np.array([True, False, True, True]),
        z=np.arange(8.0).reshape(4, 2) / 4,
        window=2,
        name="attack",
        style=0,
        background_means=means,
        background_assignment=np.arange(6) % 2,
        names=["attack", "avoid"],
    )
    return replace(scene, **changes)


class Recorder(AbstractMovieWriter):
    """Keeps the figure, and what its words are in each frame."""

    def __init__(self):
        super().__init__(fps=10)
        self.words = []

    def setup(self, fig, outfile, dpi=None):
        super().setup(fig, outfile, dpi)

    def grab_frame(self, **savefig_kwargs):
        self.words.append([text.get_text() for text in self.fig.texts])

    def finish(self):
        """Nothing to do."""


def _record(scene: Scene, rate=0.75, total=1000, folder=".") -> Recorder:
    recorder = Recorder()
    animate(scene, rate, total).save(str(Path(folder) / "unwritten"), writer=recorder, dpi=40)
    return recorder


class TestInProportion:
    @pytest.mark.parametrize(
        ("wins", "total", "count", "shown"),
        [
            (1000, 1000, 25, 25),
            (0, 1000, 25, 0),
            (963, 1000, 25, 24),
            (990, 1000, 25, 25),
            (980, 1000, 25, 25),  # 24.5 is rounded up
            (979, 1000, 25, 24),
            (20, 1000, 25, 1),
            (1, 2, 2, 1),
            (2, 3, 1, 1),
        ],
    )
    def test_successes_are_their_share_to_the_nearest(self, wins, total, count, shown):
        succeeded = np.random.default_rng(1).permutation(np.arange(total) < wins)
        chosen = in_proportion(succeeded, count, np.random.default_rng(0))
        assert succeeded[chosen].sum() == shown
        assert len(np.unique(chosen)) == count
        assert (np.diff(chosen) > 0).all()

    def test_every_number_of_all_numbers_can_be_drawn(self):
        for total in range(1, 8):
            for wins in range(total + 1):
                for count in range(1, total + 1):
                    succeeded = np.arange(total) < wins
                    chosen = in_proportion(succeeded, count, np.random.default_rng(0))
                    assert abs(succeeded[chosen].sum() - count * wins / total) <= 0.5

    def test_chance_decides_which_and_is_given(self):
        succeeded = np.arange(1000) < 500
        draws = [in_proportion(succeeded, 25, np.random.default_rng(seed)).tolist() for seed in (0, 0, 1)]
        assert draws[0] == draws[1] != draws[2]

    @pytest.mark.parametrize("count", [0, 5])
    def test_more_than_there_are_is_an_error(self, count):
        with pytest.raises(ValueError, match=f"from 1 to the number of episodes, 4, got {count}"):
            in_proportion(np.ones(4, dtype=np.bool_), count, np.random.default_rng(0))


class TestScene:
    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"episodes": []}, "at least one episode"),
            ({"episodes": [Trajectory(np.zeros((2, 4)), np.zeros((2, 2)))] * 4}, r"\(2, 4\) and \(2, 2\) in episode 0"),
            ({"succeeded": np.ones(3, dtype=np.bool_)}, r"succeeded of shape \(4,\), got \(3,\)"),
            ({"z": np.zeros((4, 0))}, "Z at least 1"),
            ({"z": np.zeros((4, 3))}, r"background_means need the shape \(N, 3\), got \(6, 2\)"),
            ({"background_assignment": np.zeros(5, dtype=np.int64)}, r"6 background_means .* \(5,\)"),
            ({"style": 2}, r"indices of the 2 names, got \[0, 1, 2\]"),
            ({"window": 0}, "window must be at least 1 state, got 0"),
        ],
    )
    def test_parts_that_do_not_fit_are_errors_in_words(self, changes, message):
        with pytest.raises(ValueError, match=message):
            _scene(**changes)


class TestZombieCell:
    def test_the_zombie_dies_where_the_environment_says_so(self):
        episodes = rollout(ZombieAttackVectorEnv(50), AttackExpert(), 50)
        for episode in episodes:
            dead = np.flatnonzero(episode.steps["info.zombie_dead"])
            assert killing_step(episode) == (dead[0] if len(dead) else None)
        assert success(episodes)["attack"].all()
        assert killing_step(rollout(ZombieAttackVectorEnv(1), StraightWalk(), 1)[0]) is None

    def test_an_attack_out_of_range_kills_nobody(self):
        assert killing_step(_walk(3, attacks=(0, 1, 2), distances=(2.0, 1.0, 0.9, 0.5))) == 2
        assert killing_step(_walk(3, attacks=(0,), distances=(2.0, 1.0, 0.9, 0.5))) is None

    def test_a_step_shows_what_has_happened_so_far(self):
        episode = _walk(4, attacks=(0, 2), distances=(2.0, 1.5, 0.8, 0.9, 1.1))
        agent, zombie = zombie_paths(episode.observations)
        cell = ZombieCell(Figure().add_subplot(), episode, window=2, colour="#0072b2", succeeded=False)
        cell.show(2)
        assert np.array_equal(cell.seen.get_xydata(), agent[1:3])
        assert np.array_equal(cell.past.get_xydata(), agent[:2])
        assert np.array_equal(cell.agent.get_xydata(), agent[2:3])
        assert np.array_equal(cell.attacks.get_xydata(), agent[:1])
        assert np.array_equal(cell.zombie.get_xydata(), zombie[2:3])
        assert cell.reach.get_center() == pytest.approx(tuple(zombie[2]))
        assert (cell.zombie.get_visible(), cell.reach.get_visible(), cell.corpse.get_visible()) == (True, True, False)
        assert not cell.flag.get_visible()
        cell.show(3)
        assert np.array_equal(cell.attacks.get_xydata(), agent[[0, 2]])
        assert (cell.zombie.get_visible(), cell.reach.get_visible(), cell.corpse.get_visible()) == (False, False, True)
        cell.show(99)
        assert np.array_equal(cell.agent.get_xydata(), agent[4:])
        assert cell.flag.get_visible()

    def test_without_a_window_the_whole_path_is_in_full_colour(self):
        episode = _walk(4)
        cell = ZombieCell(Figure().add_subplot(), episode, window=None, colour="#0072b2", succeeded=True)
        cell.show(4)
        assert len(cell.seen.get_xydata()) == 5
        assert len(cell.past.get_xydata()) == 1

    @pytest.mark.parametrize(("succeeded", "colour"), [(True, MUTED), (False, ALERT)])
    def test_the_end_gets_a_frame_and_a_failure_a_word(self, succeeded, colour):
        axes = Figure().add_subplot()
        cell = ZombieCell(axes, _walk(2), window=None, colour="#0072b2", succeeded=succeeded)
        cell.show(1)
        assert not any(spine.get_visible() for spine in axes.spines.values())
        cell.show(2)
        assert all(spine.get_visible() for spine in axes.spines.values())
        assert {to_hex(spine.get_edgecolor()) for spine in axes.spines.values()} == {colour}
        assert cell.flag.get_visible() is not succeeded

    def test_planes_hold_every_start_and_the_goal(self):
        episodes = list(rollout(ZombieAttackVectorEnv(20, start_low=-5.0), AttackExpert(), 20))
        low, high = square_around(episodes)
        assert (high - low)[0] == pytest.approx((high - low)[1])
        for episode in episodes:
            for path in zombie_paths(episode.observations):
                assert ((low < path[0]) & (path[0] < high)).all()
        assert ((low < 5) & (high > 5)).all()


class TestAnimate:
    def test_a_frame_a_step_and_a_rest(self, tmp_path):
        recorder = _record(_scene(), folder=tmp_path)
        steps = [next(word for word in words if word.startswith("step ")) for words in recorder.words]
        assert steps == [f"step {min(step, 4)} of 4" for step in range(5 + HELD)]

    def test_the_caption_says_both_counts_and_what_the_bot_remembers(self, tmp_path):
        words = _record(_scene(), rate=0.7364, total=12000, folder=tmp_path).words[0]
        assert "3 of 4 shown succeed; 73.6 % of 12,000 do." in words
        assert "attack: sees its last 2 states (W = 2)" in words

    @pytest.mark.parametrize(
        ("window", "memory"),
        [(None, "remembers everything"), (4, "remembers everything"), (1, "sees the present state (W = 1)")],
    )
    def test_windows_are_said_in_words(self, window, memory, tmp_path):
        assert f"$a$: {memory}" in _record(_scene(window=window, name="$a$"), folder=tmp_path).words[0]

    def test_failures_are_marked_in_the_latent_plane_when_they_end(self, tmp_path):
        scene = _scene()
        axes = next(axes for axes in _record(scene, folder=tmp_path).fig.axes if axes.get_xlabel() == "z_0")
        *demonstrations, shown, failures = axes.lines
        assert np.array_equal(shown.get_xydata(), scene.z)
        assert np.array_equal(failures.get_xydata(), scene.z[1:2])
        for style, line in enumerate(demonstrations):
            assert np.array_equal(line.get_xydata(), scene.background_means[scene.background_assignment == style])

    @pytest.mark.parametrize("num_features", [1, 2, 3])
    def test_a_demonstration_and_an_episode_of_one_z_share_a_place(self, num_features, tmp_path):
        means = np.random.default_rng(0).normal(size=(6, num_features))
        scene = _scene(background_means=means, z=means[[0, 2, 4, 0]])
        axes = next(axes for axes in _record(scene, folder=tmp_path).fig.axes if axes.get_xlabel())
        first, _, shown, _ = axes.lines
        assert np.allclose(shown.get_xdata(), first.get_xdata()[[0, 1, 2, 0]])
        if num_features > 1:
            assert np.allclose(shown.get_ydata(), first.get_ydata()[[0, 1, 2, 0]])

    @pytest.mark.parametrize(
        ("rate", "total", "message"), [(1.1, 9, "from 0 to 1, got 1.1"), (1.0, 3, "the 4 episodes")]
    )
    def test_impossible_counts_are_errors(self, rate, total, message):
        with pytest.raises(ValueError, match=message):
            animate(_scene(), rate, total)


class TestSaving:
    def test_writes_both_files_the_same_every_time(self, tmp_path):
        for name in ("one", "two"):
            save_animation(animate(_scene(), 0.75, 4), tmp_path / name / "world_0.2")
        assert sorted(p.name for p in (tmp_path / "one").iterdir()) == ["world_0.2.gif", "world_0.2.mp4"]
        for suffix in ("gif", "mp4"):
            first, second = ((tmp_path / name / f"world_0.2.{suffix}").read_bytes() for name in ("one", "two"))
            assert first == second
        assert (tmp_path / "one" / "world_0.2.mp4").read_bytes()[4:8] == b"ftyp"
        with Image.open(tmp_path / "one" / "world_0.2.gif") as film:
            durations, pictures = [], []
            for frame in range(film.n_frames):
                film.seek(frame)
                durations.append(film.info["duration"])
                pictures.append(film.convert("RGB").tobytes())
            size = film.size
        assert durations == [100, 100, 100, 100, 100 * (1 + HELD)]
        assert len(set(pictures)) == 5
        assert size == (770, 462)
        assert pictures[0][:3] == bytes.fromhex(PAPER[1:])

    def test_a_figure_that_cannot_be_drawn_leaves_nothing(self, tmp_path, monkeypatch):
        monkeypatch.setattr(ZombieCell, "show", lambda self, step: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            save_animation(animate(_scene(), 0.75, 4), tmp_path / "film")
        assert list(tmp_path.iterdir()) == []

    def test_without_the_extra_the_error_says_what_to_install(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
        with pytest.raises(TvaeError, match=r"pip install 'tvae\[video\]'"):
            require_video()
        animation = animate(_scene(), 0.75, 4)
        with pytest.raises(TvaeError, match=r"pip install 'tvae\[video\]'"):
            save_animation(animation, tmp_path / "film")
        assert list(tmp_path.iterdir()) == []
        animation.save(str(tmp_path / "unwritten"), writer=Recorder())
