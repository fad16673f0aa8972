"""What `tvae data validate` and `info` say that may have been forgotten."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import call
from data_strategies import quick
from tvae.data.hints import wraps
from tvae.data.sources import save_demonstrations
from tvae.data.validation import examine_source
from tvae.experiments.source import Reading, Source
from tvae.experiments.tasks import TASKS

STEPS = 400


def table(x: Any, **more: Any) -> pd.DataFrame:
    """Two episodes that see x and do nothing much."""
    steps = {"episode": np.arange(len(x)) * 2 // len(x), "step": np.arange(len(x)) % -(-len(x) // 2)}
    return pd.DataFrame({**steps, "observation.x": x, "action.a": 0.5, **more})


def walk(seed: int, scale: float) -> Any:
    """An angle in degrees that goes on and on, from step to step by N(0, scale^2)."""
    return np.random.default_rng(seed).normal(0, scale, STEPS).cumsum()


def compass(angle: Any) -> Any:
    return angle % 360


def signed(angle: Any) -> Any:
    return (angle + 180) % 360 - 180


def whole(angle: Any) -> Any:
    return compass(angle).round() % 360.0


def single(angle: Any) -> Any:
    return np.float32(signed(angle))


@pytest.mark.parametrize("form", [compass, signed, whole, single])
@pytest.mark.parametrize("scale", [5.0, 25.0])
def test_angles_in_degrees_are_seen(form: Any, scale: float) -> None:
    turning = form(walk(0, scale) + 20 * np.arange(STEPS) / scale)
    (hint,) = examine_source(table(turning)).hints
    assert hint.column == "observation.x"
    assert hint.message == "looks like an angle in degrees: between steps it jumps by about 360"
    jumps = np.abs(np.diff(turning)) > 270
    assert hint.count == jumps.sum() - jumps[STEPS // 2 - 1]  # from episode to episode
    for known in ({"continuous": ["x"]}, {"angular": ["x"]}):
        assert examine_source(table(turning), **known).hints == ()
    (hint,) = examine_source(table(np.deg2rad(turning))).hints
    assert hint.message == "looks like an angle in radians: between steps it jumps by about 2 pi"


def test_actions_are_looked_at_too() -> None:
    hints = examine_source(table(walk(0, 1.0), **{"action.heading": compass(walk(0, 20.0))})).hints
    assert [hint.column for hint in hints] == ["action.heading"]


def test_a_jump_from_episode_to_episode_is_none() -> None:
    heading = np.tile([350.0, 352.0, 10.0, 8.0], 10)
    rows = table(heading).assign(episode=np.repeat(range(20), 2), step=np.tile([0, 1], 20))
    assert examine_source(rows).hints == ()
    assert len(examine_source(table(heading)).hints) == 0  # a place between which one jumps, by more than it ever moves


RANDOM = np.random.default_rng(7)
NO_ANGLES = {
    "a place on a map": np.abs(walk(1, 8.0)) % 170,
    "a place on a map as wide, with doors": np.where(np.arange(STEPS) % 40 < 20, 10.0, 345.0) + walk(2, 0.1),
    "noise": RANDOM.uniform(0, 360, STEPS),
    "noise on both sides": RANDOM.uniform(-180, 180, STEPS),
    "noise at both ends": RANDOM.beta(0.5, 0.5, STEPS) * 360,
    "a switch": np.where(RANDOM.random(STEPS) < 0.3, 360.0, 0.0),
    "a level": RANDOM.choice([0.0, 120.0, 240.0, 360.0], STEPS),
    "an angle that is never passed": signed(90 + 40 * np.sin(np.arange(STEPS) / 9)),
    "two glitches": np.where(np.isin(np.arange(STEPS), [100, 300]), 355.0, 20.0) + walk(3, 0.01),
    "beyond a turn": walk(4, 30.0) * 3,
    "constant": np.zeros(STEPS),
}


@pytest.mark.parametrize("name", list(NO_ANGLES))
def test_what_is_no_angle_is_not_taken_for_one(name: str) -> None:
    assert examine_source(table(NO_ANGLES[name])).hints == ()


def test_a_count_that_starts_again_at_360_looks_like_one() -> None:
    assert len(examine_source(table(np.arange(STEPS * 5, 0, -5.0) % 360)).hints) == 1
    assert examine_source(table(np.arange(STEPS * 5, 0, -5.0) % 290)).hints == ()


@quick
@given(st.integers(0, 10_000), st.floats(0.5, 16), st.floats(0, 360))
def test_where_an_angle_begins_does_not_matter(seed: int, scale: float, first: float) -> None:
    """All jumps count, whether an angle is counted from 0 or from -180: no step is near 90 degrees."""
    angle = walk(seed, scale) + first
    within = np.ones(STEPS - 1, dtype=np.bool_)
    for form in (compass, signed):
        values = form(angle)
        jumps = int((np.abs(np.diff(values)) > 180).sum())
        assert wraps(values, within, 360.0) == (jumps if jumps >= 3 else 0)


@quick
@given(st.lists(st.floats(-1e300, 1e300), min_size=2, max_size=30))
def test_any_numbers_can_be_looked_at(values: list[float]) -> None:
    assert 0 <= wraps(np.array(values), np.ones(len(values) - 1, dtype=np.bool_), 360.0) < len(values)


def test_few_whole_numbers_are_categories() -> None:
    rows = table(walk(0, 1.0), **{"observation.ammo": np.arange(STEPS) % 4, "action.fire": np.arange(STEPS) % 2})
    (hint,) = examine_source(rows).hints
    assert str(hint) == (
        "taken for categories, as they hold at most 20 different whole numbers: observation.ammo (4), action.fire (2)"
    )
    (hint,) = examine_source(rows, continuous=["ammo"]).hints
    assert "ammo" not in hint.message
    assert examine_source(rows, continuous=["ammo"], binary=["fire"]).hints == ()
    assert examine_source(rows, categorical=["ammo", "fire"]).hints == ()
    assert examine_source(table(walk(0, 1.0), **{"action.key": ["left", "right"] * (STEPS // 2)})).hints == ()
    many = {f"observation.n{index}": np.arange(STEPS) % 3 for index in range(30)}
    (hint,) = examine_source(table(walk(0, 1.0), **many)).hints
    assert str(hint).endswith("observation.n7 (3) and 22 more")


@pytest.mark.parametrize("name", ["a.parquet", "a.csv", "a.tvae", "minari:{}/a"])
def test_what_was_converted_was_decided(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.csv"
    table(whole(walk(0, 20.0)), **{"observation.ammo": np.arange(STEPS) % 4}).to_csv(path, index=False)
    target = name.format(tmp_path) if "{}" in name else str(tmp_path / name)
    save_demonstrations(Source(str(path)).load(), target)
    (hint,) = examine_source(target).hints
    assert hint.message.startswith("looks like an angle in degrees")
    save_demonstrations(Source(str(path), Reading(degrees=("x",))).load(), target, overwrite=True)
    assert examine_source(target).hints == ()


def test_the_commands_name_the_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.csv"
    table(whole(walk(0, 20.0)), **{"observation.ammo": np.arange(STEPS) % 4}).to_csv(path, index=False)
    for verb in ("validate", "info"):
        call("data", verb, path)
        said = " ".join(capsys.readouterr().out.split())
        assert "Hint: column observation.x: looks like an angle in degrees" in said
        assert "; --degrees observation.x takes it for one, --continuous observation.x says that it is none" in said
        assert "observation.ammo (4); --continuous COLUMN takes one for a number" in said
        call("data", verb, path, "--degrees", "x", "--continuous", "ammo")
        assert "Hint" not in capsys.readouterr().out


def test_our_tasks_give_no_hints(tmp_path: Path) -> None:
    for task in ("zombie", "navigation", "circle"):
        kept = TASKS[task](None, 0).demonstrations()
        save_demonstrations(kept, tmp_path / f"{task}.parquet")
        assert examine_source(tmp_path / f"{task}.parquet").hints == ()


def test_a_fit_gives_the_same_hints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "turning.csv"
    table(compass(walk(0, 25.0)), **{"action.b": np.arange(STEPS) % 3}).to_csv(path, index=False)
    small = ["--training.num-steps", "2", "--policy.num-steps", "0", "--model.hidden-features", "4"]
    call("data", "info", path)
    told = _hints(capsys)
    call("fit", path, "--out", tmp_path / "run", *small, "--training.held-out", "0.5")
    assert _hints(capsys) == told
    assert len(told) == 2
    known = ["--degrees", "observation.x", "--continuous", "action.b"]
    call("fit", path, "--out", tmp_path / "known", *small, *known, "--training.held-out", "0.5")
    assert _hints(capsys) == []


def _hints(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What was said since a hint began, up to the next."""
    _, *found = " ".join(capsys.readouterr().out.split()).split("Hint: ")
    return [hint.split(";")[0] for hint in found]
