"""Overcooked: the recorded games replayed exactly, and what is seen of them."""

import gzip
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError, Trajectory
from tvae.envs.overcooked import (
    ACTIONS,
    SOUP_REWARD,
    OvercookedEnv,
    net_laps,
    overcooked_demonstrations,
    with_seats_exchanged,
)
from tvae.envs.overcooked_features import DIRECTIONS, FRONT, HELD, LAYOUTS, POT, WAYS, Features
from tvae.rollouts import rollout
from tvae.spaces import Categorical

GAMES = Path(__file__).parent.parent / "data" / "overcooked_human_2019.json.gz"
RING = "coordination_ring"


@pytest.fixture(scope="module")
def games():
    return overcooked_demonstrations(GAMES, surroundings=True)


@pytest.fixture(scope="module")
def ring(games):
    return games.select(np.flatnonzero(games.attributes["layout"] == RING))


@pytest.fixture(scope="module")
def recorded():
    with gzip.open(GAMES, "rt", encoding="utf-8") as file:
        return json.load(file)["trials"]


class Recorded:
    """Plays recorded games again, one in each copy."""

    def __init__(self, games):
        self._games = games

    def reset(self, num_episodes, seed):
        assert num_episodes == len(self._games)
        self._step = -1

    def act(self, observations):
        self._step += 1
        return np.stack([game.actions[min(self._step, len(game) - 1)] for game in self._games])


def seen(env, observation):
    """An observation by name."""
    return dict(zip(env.unwrapped.metadata["signal_names"]["observation"], observation.tolist(), strict=True))


def play(env, *moves):
    """Player 0 makes these moves, the other stays."""
    outcome = None
    for move in moves:
        outcome = env.step(np.array([ACTIONS.index(move), ACTIONS.index("stay")]))
    return outcome


def test_replays_are_the_recorded_games(games, recorded):
    assert len(games) == 76
    assert games.num_steps == 91_102
    assert games.final_observed.all()
    assert games.steps["reward"].sum() == 1_363 * SOUP_REWARD
    for episode, game in zip(games, recorded, strict=True):
        names = episode.attributes
        assert (names["pair"], names["layout"], names["split"]) == (game["pair"], game["layout"], game["split"])
        assert names["group"] == names["pair"]
        assert len(episode) == game["T"]
        assert episode.steps["info.soups"][-1] * 5 == game["score_2019"]
        assert np.array_equal(episode.actions, game["joint_actions"])
        start = [coordinate for player in game["start"] for coordinate in player["position"]]
        columns = [games.observation_space.column(name) for name in ("x_0", "y_0", "x_1", "y_1")]
        assert (episode.observations[0, columns] + 1).tolist() == start
        for name, column in zip(("x_0", "y_0", "x_1", "y_1"), columns, strict=True):
            assert np.array_equal(episode.observations[1:, column] + 1, episode.steps[f"info.{name}"])


def test_only_wanted_layouts_are_read():
    room = overcooked_demonstrations(GAMES, ["cramped_room"])
    assert len(room) == 16
    assert set(room.attributes["layout"]) == {"cramped_room"}
    with pytest.raises(ValueError, match=r"layouts must be some of asymmetric_advantages.*, got kitchen"):
        overcooked_demonstrations(GAMES, ["kitchen", RING])
    with pytest.raises(ValueError, match="got none"):
        overcooked_demonstrations(GAMES, [])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"score_2019": 95.0}, "score of 95 needs 19 soups, the replay delivered 18"),
        ({"start": [{"position": [1, 1]}, {"position": [1, 2]}]}, r"must start at .*, got \[1, 1, 1, 2\]"),
    ],
)
def test_a_recording_that_is_another_game_is_refused(recorded, tmp_path, change, message):
    path = tmp_path / "games.json.gz"
    with gzip.open(path, "wt", encoding="utf-8") as file:
        json.dump({"trials": [{**recorded[0], **change}]}, file)
    with pytest.raises(DataError, match=message):
        overcooked_demonstrations(path)


def test_laps_of_the_recorded_pairs(ring):
    laps = np.sort(net_laps(ring))
    assert laps[0] == pytest.approx(-45.3, abs=0.1)
    assert np.abs(laps[1:8]).max() < 12.5
    assert laps[8] == pytest.approx(22.9, abs=0.1)
    assert laps[15] == pytest.approx(38.7, abs=0.1)


def test_clockwise_laps_are_positive(ring):
    path = [(1, 1), (2, 1), (3, 1), (3, 2), (3, 3), (2, 3), (1, 3), (1, 2), (1, 1)]
    rows = np.repeat(ring[0].observations[:1], len(path), axis=0)
    for name, values in zip(("x_0", "y_0"), zip(*path, strict=True), strict=True):
        rows[:, ring.observation_space.column(name)] = np.array(values) - 1
    walks = [Trajectory(rows, np.zeros((8, 2))), Trajectory(rows[::-1], np.zeros((8, 2)))]
    walks = Demonstrations.from_trajectories(walks, ring.observation_space, ring.action_space)
    assert net_laps(walks) == pytest.approx([0.5, -0.5])


def test_recorded_people_as_a_policy(ring):
    pairs = ring.select(np.flatnonzero(ring.lengths == 1204)[:3])
    envs = gymnasium.make_vec("tvae/Overcooked-v0", num_envs=3, layout=RING, horizon=1204, surroundings=True)
    again = rollout(envs, Recorded(pairs), 3)
    for game, replayed in zip(pairs, again, strict=True):
        assert np.array_equal(game.observations, replayed.observations)
        assert game.steps.keys() == replayed.steps.keys()
        for name, values in game.steps.items():
            assert np.array_equal(values, replayed.steps[name]), name
    assert again.observation_space.names == ring.observation_space.names
    assert again.observation_space.differences(ring.observation_space) == []
    assert again.action_space.differences(ring.action_space) == []


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("surroundings", [True, False])
def test_environment_is_one(layout, surroundings):
    make = {"layout": layout, "surroundings": surroundings, "render_mode": "rgb_array"}
    check_env(gymnasium.make("tvae/Overcooked-v0", **make).unwrapped)


def test_observations_are_categories_of_one_width_in_all_layouts(games):
    assert all(isinstance(signal, Categorical) for signal in games.observation_space.signals)
    assert games.observation_space.num_features <= 150
    assert all(OvercookedEnv(layout).observation_space == OvercookedEnv().observation_space for layout in LAYOUTS)
    layout = games.observations[games.observation_starts, games.observation_space.column("layout")]
    assert [LAYOUTS[int(index)] for index in layout] == games.attributes["layout"].tolist()


def test_without_surroundings_the_same_state_is_seen():
    env, bare = OvercookedEnv(surroundings=True), OvercookedEnv()
    observation, fewer = env.reset()[0], bare.reset()[0]
    assert observation[: len(fewer)].tolist() == fewer.tolist()


def test_a_soup_from_onion_to_delivery():
    env = OvercookedEnv("cramped_room", surroundings=True)
    view = seen(env, env.reset()[0])
    assert (view["x_0"], view["y_0"], view["x_1"], view["y_1"]) == (1, 2, 3, 1)
    assert DIRECTIONS[view["facing_0"]] == "north"
    assert HELD[view["held_0"]] == "nothing"
    assert FRONT[view["front_0"]] == "floor"
    assert [view[f"{direction}_0"] for direction in DIRECTIONS] == [1, 0, 1, 0]
    assert POT[view["pot_0"]] == "empty"
    assert POT[view["pot_1"]] == "absent"
    assert WAYS[view["soup_way_0"]] == "none"
    to_onion, to_pot = ("west", "west", "interact"), ("east", "north", "interact")
    play(env, "north")
    for expected in ("1 onion", "2 onions", "15-19 steps to go"):
        view = seen(env, play(env, *to_onion)[0])
        assert HELD[view["held_0"]] == "onion"
        assert FRONT[view["front_0"]] == "onion dispenser"
        view = seen(env, play(env, *to_pot)[0])
        assert POT[view["pot_0"]] == expected
        assert FRONT[view["front_0"]] == "pot"
        assert HELD[view["held_0"]] == "nothing"
    waiting = [seen(env, play(env, "stay")[0]) for _ in range(19)]
    stages = [POT[view["pot_0"]] for view in waiting]
    assert [stages.count(stage) for stage in POT[4:]] == [4, 7, 7, 1]
    assert WAYS[waiting[-1]["soup_way_0"]] == "north"
    assert WAYS[waiting[-2]["soup_way_0"]] == "none"
    view = seen(env, play(env, "south", "west", "south", "interact")[0])
    assert HELD[view["held_0"]] == "dish"
    view = seen(env, play(env, "north", "east", "north", "interact")[0])
    assert HELD[view["held_0"]] == "soup"
    assert POT[view["pot_0"]] == "empty"
    observation, reward, terminated, truncated, info = play(env, "south", "east", "south", "interact")
    assert FRONT[seen(env, observation)["front_0"]] == "serving counter"
    assert (reward, terminated, truncated, info["soups"]) == (SOUP_REWARD, False, False, 1)


def test_things_on_counters_are_seen():
    env = OvercookedEnv("cramped_room", surroundings=True)
    env.reset()
    view = seen(env, play(env, "north", "west", "interact", "north", "interact")[0])
    assert FRONT[view["front_0"]] == "onion"
    assert HELD[view["held_0"]] == "nothing"
    assert (view["onions"], view["dishes"], view["soups"]) == (1, 0, 0)
    assert WAYS[view["onion_way_0"]] == "north"
    view = seen(env, play(env, "interact", "west")[0])
    assert (view["onions"], HELD[view["held_0"]]) == (0, "onion")


def test_the_other_player_is_in_the_way():
    env = OvercookedEnv("cramped_room", surroundings=True)
    env.reset()
    view = seen(env, play(env, "north", "east", "east")[0])
    assert (view["x_0"], view["y_0"]) == (2, 1)
    assert FRONT[view["front_0"]] == "the other player"
    assert view["east_0"] == 0
    assert view["west_1"] == 0


def cook(position, facing=(0, -1)):
    return SimpleNamespace(position=position, orientation=facing, held_object=None)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_ways_lead_to_their_goal(layout):
    terrain = OvercookedEnv(layout).terrain
    features = Features(layout, terrain)
    floor = [(x, y) for y, row in enumerate(terrain) for x, kind in enumerate(row) if kind == " "]
    for goal, kind in (("onion", "O"), ("dish", "D"), ("pot", "P"), ("serving", "S")):
        reached = set()
        for start in floor:
            (x, y), steps = start, 0
            while terrain[y][x] == " " and steps < 20:
                state = SimpleNamespace(players=[cook((x, y)), cook(floor[0])], objects={})
                view = dict(zip(features.names, features.observe(state), strict=True))
                if WAYS[view[f"{goal}_way_0"]] == "none":
                    break
                dx, dy = [(0, -1), (0, 1), (1, 0), (-1, 0)][view[f"{goal}_way_0"]]
                x, y, steps = x + dx, y + dy, steps + 1
            if terrain[y][x] == kind:
                reached.add(start)
                stations = [(i, j) for j, row in enumerate(terrain) for i, k in enumerate(row) if k == kind]
                assert steps >= min(abs(start[0] - i) + abs(start[1] - j) for i, j in stations)
        cut_off = layout == "forced_coordination"
        assert len(reached) == (3 if cut_off else len(floor)), (goal, set(floor) - reached)


def test_games_end_at_the_horizon_and_restart():
    envs = gymnasium.make_vec("tvae/Overcooked-v0", num_envs=2, horizon=3)
    start, _ = envs.reset(seed=0)
    move = np.array([[ACTIONS.index("east"), 4]] * 2)
    ends = [envs.step(move)[3].tolist() for _ in range(3)]
    assert ends == [[False, False], [False, False], [True, True]]
    observation, reward, _, truncated, info = envs.step(move)
    assert np.array_equal(observation, start)
    assert reward.tolist() == [0, 0]
    assert not truncated.any()
    assert info["soups"].tolist() == [0, 0]


def test_picture():
    env = OvercookedEnv(render_mode="rgb_array")
    env.reset()
    picture = env.render()
    assert picture.shape == (375, 375, 3)
    assert picture.std() > 10


def test_wrong_arguments_are_refused_in_words():
    with pytest.raises(ValueError, match=r"layout must be one of asymmetric_advantages, .*, got 'kitchen'"):
        OvercookedEnv("kitchen")
    with pytest.raises(ValueError, match="horizon must be at least 1 step, got 0"):
        OvercookedEnv(horizon=0)
    with pytest.raises(ResetNeeded, match="must be reset"):
        OvercookedEnv().step(np.array([0, 0]))
    env = OvercookedEnv()
    env.reset()
    with pytest.raises(ValueError, match=r"two numbers from 0 to 5, got \[ 0 -1\]"):
        env.step(np.array([0, -1]))


def test_missing_simulator_is_said_in_words(monkeypatch):
    for name in ("overcooked", "overcooked.mdp"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "tvae.envs.overcooked")
    with pytest.raises(ImportError, match=r"pip install 'tvae\[overcooked\]'"):
        import_module("tvae.envs.overcooked")
    with pytest.raises(ImportError, match=r"pip install 'tvae\[overcooked\]'"):
        gymnasium.make("tvae/Overcooked-v0")


def test_importing_tvae_loads_no_simulator():
    code = "import sys, tvae; print(*{'overcooked', 'gym_pusht', 'pygame', 'pymunk', 'shapely'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_games_with_the_seats_exchanged(ring):
    both = with_seats_exchanged(ring)
    assert len(both) == 2 * len(ring)
    first, exchanged = ring[0], both[len(ring)]
    names = ring.observation_space.names
    for name, other in (("x_0", "x_1"), ("held_1", "held_0"), ("onion_way_0", "onion_way_1"), ("pot_0", "pot_0")):
        column, counterpart = names.index(name), names.index(other)
        np.testing.assert_array_equal(exchanged.observations[:, column], first.observations[:, counterpart])
    np.testing.assert_array_equal(exchanged.actions, first.actions[:, ::-1])
    np.testing.assert_allclose(net_laps(both)[len(ring) :], net_laps(ring))
    assert both.attributes["pair"][len(ring)] == ring.attributes["pair"][0]
    np.testing.assert_array_equal(both[len(ring)].steps["reward"], first.steps["reward"])
