"""Demonstrations that are larger than memory."""

import importlib.util
import io
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from data_strategies import assert_same
from tvae.data import identity, packing
from tvae.data.arrays import from_arrays
from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.evaluate import mixtures
from tvae.evaluate.mixtures import Components, assign
from tvae.experiments import analysis
from tvae.experiments.analysis import likelihood_per_step
from tvae.fitting.fit import fit, new_model
from tvae.model import calibration
from tvae.train import loop

SCRIPTS = Path(__file__).parent.parent / "scripts"


def script(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def streaming() -> Iterator[ModuleType]:
    monkeypatch = pytest.MonkeyPatch()
    yield script("benchmark_streaming", monkeypatch)
    monkeypatch.undo()


def test_what_is_written_in_parts_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_BLOCK_ROWS", 3)
    seen = [np.arange(length, dtype=np.float64) for length in (2, 5, 1, 4)]
    kept = from_arrays(seen, [np.ones(length) for length in (2, 4, 1, 3)])
    some = kept.select([3, 0, 1])
    some.write(tmp_path / "some.tvae")
    opened = Demonstrations.open(tmp_path / "some.tvae")
    assert_same(opened, some)
    assert isinstance(opened.observations, np.memmap)
    assert opened.observation_starts.tolist() == [0, 4, 6]


def test_nothing_is_written_through_a_map_which_a_full_disk_ends_the_process_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = from_arrays([[0.5, 1.5], [2.5, 3.5]], [[0.5, 1.5], [2.5, 3.5]])
    with monkeypatch.context() as patched:
        patched.delattr(np, "memmap")
        kept.write(tmp_path / "kept.tvae")
    assert_same(Demonstrations.open(tmp_path / "kept.tvae"), kept)
    np.save(tmp_path / "saved.npy", kept.observations)
    written = (tmp_path / "kept.tvae/observations.npy").read_bytes()
    assert written == (tmp_path / "saved.npy").read_bytes()


def test_what_no_space_allows_is_not_written(tmp_path: Path) -> None:
    kept = from_arrays([[0.5, 1.5], [2.5, 3.5]], [[0.5, 1.5], [2.5, 3.5]])
    kept.actions[3] = np.nan
    with pytest.raises(DataError, match=r"episode 1, step 1, column action\.0: needs a finite number, got nan"):
        kept.write(tmp_path / "bad.tvae")
    assert not (tmp_path / "bad.tvae").exists()


class Watched(np.ndarray[Any, np.dtype[np.float64]]):
    """Rows that know how many of them were read together."""

    most = 0
    total = 0

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        Watched.most, Watched.total = max(Watched.most, found.size), Watched.total + found.size
        return found


def test_training_reads_no_more_of_many_than_of_few(
    streaming: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration, "MOST_ROWS", 1_000)
    monkeypatch.setattr(loop, "MOST_JUDGED_STEPS", 1_000)
    monkeypatch.setattr(identity, "_MOST_STEPS", 1_000)
    read = []
    for count in (400, 2_000):
        streaming.make(tmp_path / "walks.tvae", count, 10)
        demonstrations = Demonstrations.open(tmp_path / "walks.tvae")
        observations = demonstrations.observations
        assert isinstance(observations, np.memmap)
        Watched.most = Watched.total = 0
        watched = replace(demonstrations, observations=observations.view(Watched))
        fit(watched, num_steps=1, policy_steps=0, hidden_features=4, window=None, device="cpu")
        assert Watched.most < 5_000
        read.append(Watched.total)
        shutil.rmtree(tmp_path / "walks.tvae")
    assert read[1] < 1.5 * read[0]


def test_likelihoods_of_very_many_sessions(
    streaming: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    streaming.make(tmp_path / "walks.tvae", 50, 5)
    walks = Demonstrations.open(tmp_path / "walks.tvae")
    model = new_model(walks, seed=0, device="cpu", hidden_features=4)
    said = io.StringIO()
    monkeypatch.setattr(analysis, "MOST_LIKELIHOODS", 20)
    found = likelihood_per_step(model, walks, seed=0, console=Console(file=said))
    assert np.isfinite(found).nonzero()[0].tolist() == list(range(0, 50, 3))
    assert said.getvalue().startswith("log_likelihood_per_step is computed for 17 of 50 sessions")
    assert evenly(walks, 10).attributes["episode"].tolist() == [0, 25]


def test_all_of_a_fit_is_measured(
    streaming: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = script("benchmark_fit", monkeypatch)
    before = analysis.encode
    streaming.make(tmp_path / "walks.tvae", 30, 5)
    found = {stage.name: stage for stage in whole.fit(tmp_path / "walks.tvae", 2)}
    assert analysis.encode is before
    assert (tmp_path / "walks.run" / "report.html").is_file()
    fitted, parts = found["tvae fit"], [stage for stage in found.values() if stage.depth == 1]
    assert [stage.name for stage in parts] == ["begin", "summarise", "fit_run", "analyse", "write_report"]
    assert sum(stage.seconds for stage in parts) <= fitted.seconds
    if sys.platform == "linux":
        assert 0 < fitted.anonymous <= fitted.resident
        assert max(stage.resident for stage in parts) <= fitted.resident


def test_styles_of_very_many_sessions_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    clusters = [Components(np.array([0.3, 0.2]), rng.normal(size=(2, 3)), np.stack([np.eye(3)] * 2)) for _ in range(2)]
    points = rng.normal(size=(50, 3))
    whole = assign(clusters, points)
    monkeypatch.setattr(mixtures, "_BLOCK_POINTS", 7)
    for one, other in zip(whole, assign(clusters, points), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    assert set(whole[0]) == {0, 1}
