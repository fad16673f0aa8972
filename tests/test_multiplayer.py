"""Several players in a parallel environment of PettingZoo, a bot each."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces as gym
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import aec_to_parallel, parallel_to_aec
from pettingzoo.utils.wrappers import BaseParallelWrapper

import tvae
from commands import call, refused
from toys import noise, untrained
from tvae.data.sources import load_demonstrations, save_demonstrations
from tvae.gymnasium_spaces import flatten
from tvae.model.tvae import TrajectoryVAE
from tvae.multiplayer import PlayersError, rollout, spaces_of_player
from tvae.rollouts import SpaceMismatchError

SEES = {
    "hunter": gym.Box(-20, 20, (2,), np.float64),
    "hare": gym.Dict({"at": gym.Box(-20, 20, (1,)), "on": gym.Discrete(2)}),
}
DOES = {"hunter": gym.Box(-1, 1, (1,), np.float64), "hare": gym.Discrete(3, start=-1)}


class Hunt(ParallelEnv):
    """On a line. The hare leaves after `leaves` steps and the hunter comes after `comes`; all ends after five."""

    metadata = {"name": "hunt", "signal_names": {"hunter": {"observation": ["hunter", "hare"]}}}  # noqa: RUF012

    render_mode = None

    def __init__(self, leaves: int = 3, comes: int = 0, returns: int = 99) -> None:
        self.possible_agents = ["hunter", "hare"]
        self.leaves, self.comes, self.returns = leaves, comes, returns
        self.given: list[dict[str, Any]] = []

    def observation_space(self, agent: str) -> gymnasium.Space:
        return SEES[agent]

    def action_space(self, agent: str) -> gymnasium.Space:
        return DOES[agent]

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        self.at = np.random.default_rng(seed).uniform(-5, 5, 2)
        self.time = 0
        self._meet()
        return self._see(self.agents), {agent: {} for agent in self.agents}

    def _meet(self) -> None:
        there = {"hunter": self.time >= self.comes, "hare": self.time < self.leaves or self.time >= self.returns}
        self.agents = [agent for agent in self.possible_agents if there[agent] and self.time < 5]

    def _see(self, agents: list[str]) -> dict[str, Any]:
        seen = {"hunter": self.at.copy(), "hare": {"at": self.at[1:].astype(np.float32), "on": self.time % 2}}
        return {agent: seen[agent] for agent in agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        assert set(actions) == set(self.agents)
        assert all(self.action_space(agent).contains(action) for agent, action in actions.items())
        self.given.append(actions)
        self.at += [float(np.ravel(actions.get(agent, 0.0))[0]) for agent in self.possible_agents]
        self.time += 1
        acted = self.agents
        self._meet()
        gone = {agent: agent not in self.agents for agent in acted}
        info = {agent: {"time": self.time, "words": "no number", "once": 1.0} for agent in acted}
        if self.time == 2 and "hunter" in info:
            del info["hunter"]["once"]
        both = list(dict.fromkeys([*acted, *self.agents]))
        return self._see(both), dict.fromkeys(acted, 0.5), gone, dict.fromkeys(acted, False), info


def model_of(player: str, env: ParallelEnv | None = None) -> TrajectoryVAE:
    observation_space, action_space = spaces_of_player(env or Hunt(), player)
    return untrained(noise([5, 4], observation_space=observation_space, action_space=action_space))


class Anywhere:
    """z ~ N(0, I); keeps what it gave."""

    def __init__(self) -> None:
        self.given: list[list[float]] = []

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        z = rng.normal(size=(count, 2))
        self.given += z.tolist()
        return z


@pytest.fixture(scope="module")
def models() -> dict[str, TrajectoryVAE]:
    return {player: model_of(player) for player in ("hunter", "hare")}


def agents_of(models: dict[str, TrajectoryVAE]) -> dict[str, tvae.Agent]:
    return {player: tvae.Agent(model, Anywhere()) for player, model in models.items()}


def test_each_player_gets_its_demonstrations(models: dict[str, TrajectoryVAE]) -> None:
    env = Hunt()
    played = tvae.rollout_parallel(env, agents_of(models), 4, seed=3)
    assert {player: episodes.lengths.tolist() for player, episodes in played.items()} == {
        "hunter": [5] * 4, "hare": [3] * 4
    }  # fmt: skip
    assert played["hunter"].observation_space.names == ("hunter", "hare")
    assert played["hare"].observation_space.names == ("at", "on")
    assert "info.words" not in played["hare"].steps
    for player, episodes in played.items():
        assert episodes.final_observed.all()
        assert episodes.attributes["episode"].tolist() == [0, 1, 2, 3]
        assert {"reward", "terminated", "truncated", "info.time"} <= set(episodes.steps)
        assert ("info.once" in episodes.steps) == (player == "hare")
        given = [flatten(DOES[player], actions[player]) for actions in env.given if player in actions]
        np.testing.assert_array_equal(np.stack(given), episodes.actions)
    hunter, hare = played["hunter"][1], played["hare"][1]
    np.testing.assert_allclose(hunter.observations[:4, 1], hare.observations[:, 0], rtol=1e-6)
    np.testing.assert_allclose(np.diff(hunter.observations[:, 0]), hunter.actions[:, 0])
    assert hare.steps["terminated"].tolist() == [False, False, True]
    assert hunter.steps["info.time"].tolist() == [1, 2, 3, 4, 5]


def test_each_draws_a_z_of_its_own_and_the_seed_decides(models: dict[str, TrajectoryVAE]) -> None:
    one, other = Anywhere(), Anywhere()
    agents = {"hunter": tvae.Agent(models["hunter"], one), "hare": tvae.Agent(models["hare"], other)}
    before = one.given[-1]
    first = tvae.rollout_parallel(Hunt(), agents, 3, seed=5)
    drawn = one.given[1:] + other.given[1:]
    assert len(drawn) == 6
    assert len({tuple(z) for z in drawn}) == 6
    assert agents["hunter"].policy.z.tolist() == [before]
    again, different = (tvae.rollout_parallel(Hunt(), agents_of(models), 3, seed=seed) for seed in (5, 6))
    for player, episodes in first.items():
        np.testing.assert_array_equal(episodes.actions, again[player].actions)
        np.testing.assert_array_equal(episodes.observations, again[player].observations)
        assert not np.array_equal(episodes.observations, different[player].observations)


def test_one_agent_may_play_for_all() -> None:
    class Twins(Hunt):
        def observation_space(self, agent: str) -> gymnasium.Space:
            return SEES["hunter"]

        def action_space(self, agent: str) -> gymnasium.Space:
            return DOES["hunter"]

        def _see(self, agents: list[str]) -> dict[str, Any]:
            return dict.fromkeys(agents, self.at)  # the same array in each step

        metadata = {}  # noqa: RUF012

    agent = tvae.Agent(model_of("hunter", Twins()), Anywhere())
    played = tvae.rollout_parallel(Twins(), {"hunter": agent, "hare": agent}, 2)
    assert not np.array_equal(played["hunter"][0].actions[:3], played["hare"][0].actions)
    moved = np.diff(played["hunter"][0].observations[:, 0])
    np.testing.assert_allclose(moved, played["hunter"][0].actions[:, 0])


def test_who_comes_late_begins_late(models: dict[str, TrajectoryVAE]) -> None:
    played = tvae.rollout_parallel(Hunt(comes=2), agents_of(models), 2)
    assert played["hunter"].lengths.tolist() == [3, 3]
    assert played["hunter"][0].steps["info.time"].tolist() == [3, 4, 5]


def test_who_cannot_be_recorded_is_refused(models: dict[str, TrajectoryVAE]) -> None:
    with pytest.raises(PlayersError, match="hunter never acted in 2 episodes"):
        tvae.rollout_parallel(Hunt(leaves=5, comes=9), agents_of(models), 2)
    with pytest.raises(PlayersError, match="hare comes back in an episode that it has left"):
        tvae.rollout_parallel(Hunt(leaves=1, returns=3), agents_of(models), 1)
    env = Hunt()
    env._see = lambda agents: {}
    with pytest.raises(PlayersError, match="hunter acts, and the environment gives it no observation"):
        tvae.rollout_parallel(env, agents_of(models), 1)


def test_wrappers_are_respected(models: dict[str, TrajectoryVAE]) -> None:
    class Far(BaseParallelWrapper):
        def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
            observations, infos = super().reset(seed=seed, options=options)
            return {**observations, "hunter": observations["hunter"] + 10}, infos

    near, far = (tvae.rollout_parallel(env, agents_of(models), 1) for env in (Hunt(), Far(Hunt())))
    np.testing.assert_allclose(far["hunter"][0].observations[0], near["hunter"][0].observations[0] + 10)
    assert far["hunter"].observation_space == near["hunter"].observation_space


def test_players_who_take_turns_can_be_made_parallel(models: dict[str, TrajectoryVAE]) -> None:
    turns = parallel_to_aec(Hunt(leaves=5))
    assert isinstance(turns, AECEnv)
    with pytest.raises(PlayersError, match=r"need a parallel environment of PettingZoo, got hunt; .*aec_to_parallel"):
        tvae.rollout_parallel(turns, agents_of(models), 1)
    played = tvae.rollout_parallel(aec_to_parallel(turns), agents_of(models), 1)
    assert played["hare"].lengths.tolist() == [5]


def test_players_and_agents_must_be_the_same(models: dict[str, TrajectoryVAE]) -> None:
    agents = agents_of(models)
    with pytest.raises(PlayersError, match=r"Players: hare, hunter\. Without one: hare\. .*environment: fox\."):
        tvae.rollout_parallel(Hunt(), {"hunter": agents["hunter"], "fox": agents["hare"]}, 1)
    with pytest.raises(PlayersError, match=r"need a parallel environment of PettingZoo, got .*CartPole"):
        tvae.rollout_parallel(gymnasium.make("CartPole-v1"), agents, 1)


def test_other_spaces_are_shown_from_both_sides(models: dict[str, TrajectoryVAE]) -> None:
    agents = agents_of({"hunter": models["hunter"], "hare": models["hunter"]})
    message = r"observations differ between model and player 'hare': .*Model: hunter, hare\. Player 'hare': at, on\."
    with pytest.raises(SpaceMismatchError, match=message):
        tvae.rollout_parallel(Hunt(), agents, 1)


def test_progress_is_told_and_counts_are_checked(models: dict[str, TrajectoryVAE]) -> None:
    policies, told = {player: agent.policy for player, agent in agents_of(models).items()}, []
    rollout(Hunt(), policies, 3, on_step=told.append)
    assert told == [1, 2, 3]
    with pytest.raises(ValueError, match="num_episodes must be at least 1, got 0"):
        rollout(Hunt(), policies, 0)


# On the command line


class Dance(ParallelEnv):
    """Two who see both places and step to one side or the other, for four steps."""

    metadata = {"name": "dance", "signal_names": {"observation": ["left", "right"], "action": ["side"]}}  # noqa: RUF012
    possible_agents = ["ann", "bob"]  # noqa: RUF012
    closed = 0

    def observation_space(self, agent: str) -> gymnasium.Space:
        return gym.Box(-20, 20, (2,), np.float64)

    def action_space(self, agent: str) -> gymnasium.Space:
        return gym.Discrete(2)

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        self.agents, self.time = list(self.possible_agents), 0
        self.at = np.random.default_rng(seed).uniform(-5, 5, 2)
        return {agent: self.at.copy() for agent in self.agents}, {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        acted, self.time = self.agents, self.time + 1
        self.at = self.at + [2 * float(actions[agent]) - 1 for agent in acted]
        self.agents = acted if self.time < 4 else []
        info = {"ann": {"time": self.time, "alone": 1.0}, "bob": {"time": self.time}}
        seen = {agent: self.at.copy() for agent in acted}
        return seen, dict.fromkeys(acted, 0.5), dict.fromkeys(acted, self.time == 4), dict.fromkeys(acted, False), info

    def close(self) -> None:
        Dance.closed += 1


@pytest.fixture
def games(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules as PettingZoo and as others have them."""
    package, dance = ModuleType("games"), ModuleType("games.dance_v1")
    dance.parallel_env = Dance  # type: ignore[attr-defined]
    package.__path__ = []
    package.Dance, package.Hunt, package.number = Dance, Hunt, 3  # type: ignore[attr-defined]
    package.Cart = lambda: gymnasium.make("CartPole-v1")  # type: ignore[attr-defined]
    for module in (package, dance):
        monkeypatch.setitem(sys.modules, module.__name__, module)


def test_bots_of_a_style_play_together(games: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = model_of("ann", Dance())
    path = tmp_path / "dances.parquet"
    recorded = noise([4] * 12, observation_space=model.observation_space, action_space=model.action_space)
    save_demonstrations(recorded, path)
    options = ("--training.num-steps", "2", "--training.evaluate-every", "1", "--episodes", "3")
    call("fit", path, "--out", tmp_path / "run", "--env", "games:dance_v1", *options)
    tried = load_demonstrations(tmp_path / "run" / "rollouts" / "style-0.parquet")
    assert len(tried) == 6
    closed = Dance.closed
    call("rollout", tmp_path / "run", "--env", "games:Dance", "--episodes", "5", "--out", tmp_path / "a.parquet")
    assert Dance.closed == closed + 1
    kept = load_demonstrations(tmp_path / "a.parquet")
    assert kept.observation_space.names == ("left", "right")
    assert kept.lengths.tolist() == [4] * 10
    assert kept.attributes["player"].tolist() == ["ann"] * 5 + ["bob"] * 5
    assert kept.attributes["session"].tolist() == [*range(5), *range(5)]
    assert kept.attributes["episode"].tolist()[4:6] == ["4/ann", "0/bob"]
    assert set(kept.steps) == {"reward", "terminated", "truncated", "info.time"}
    np.testing.assert_array_equal(kept[2].observations, kept[7].observations)  # they are in the same game
    assert any((kept[game].actions != kept[game + 5].actions).any() for game in range(5))
    capsys.readouterr()
    for env, message in (
        ("games:Hunt", "actions differ between model and player 'hunter': signal 0 is categorical (2) ('side')"),
        ("games:Cart", "several players need a parallel environment of PettingZoo, got <TimeLimit"),
        ("games:number", "games:number: needs a class, a function or a module with parallel_env, got 3"),
        ("games:waltz_v1", "games:waltz_v1: cannot be imported: No module named 'games.waltz_v1'. A parallel env"),
        ("nogames:waltz", "nogames:waltz: cannot be imported: No module named 'nogames'"),
    ):
        said = refused(capsys, "rollout", tmp_path / "run", "--env", env, "--out", tmp_path / "b.parquet")
        assert message in " ".join(said.split())
    said = refused(capsys, "fit", path, "--out", tmp_path / "other", "--env", "games:Hunt")
    assert "Model: side. Player 'hunter': 0." in said
    assert not (tmp_path / "other").exists()


def test_a_run_that_is_given_does_not_say_what_code_runs(
    games: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, run, path = model_of("ann", Dance()), tmp_path / "run", tmp_path / "dances.parquet"
    recorded = noise([4] * 12, observation_space=model.observation_space, action_space=model.action_space)
    save_demonstrations(recorded, path)
    options = ("--training.num-steps", "2", "--training.evaluate-every", "1", "--episodes", "3")
    call("fit", path, "--out", run, "--env", "games:dance_v1", *options)
    said = json.loads((run / "config.json").read_text())
    said["run"]["arena"]["env"] = "os:system"
    said["run"]["arena"]["options"] = {"command": f"touch {tmp_path / 'harm'}"}
    (run / "config.json").write_text(json.dumps(said))
    capsys.readouterr()
    commands = ("rollout", run, "--out", tmp_path / "a.parquet"), ("evaluate", run), ("fit", "--resume", "--out", run)
    for command in commands:
        words = " ".join(refused(capsys, *command).split())
        assert "environment os:system is code of its own; say that it may run: --env os:system" in words
    assert not (tmp_path / "harm").exists()
