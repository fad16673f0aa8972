"""Trackio and Weights & Biases, as a module that keeps what it is told: no service, no network."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from rich.console import Console

from commands import call, refused
from toys import two_styles
from tvae.config import ModelConfig, RunConfig, TrainingConfig
from tvae.experiments.fitting import About, begin, fit_run, history
from tvae.experiments.progress import scalars
from tvae.experiments.run_directory import RunDirectory
from tvae.experiments.source import Source
from tvae.experiments.tracking import Tracker, TrackerError, trackio, wandb
from tvae.train.checkpoint import Record
from tvae.train.terms import Terms


class FakeService(ModuleType):
    """The calls that both services have."""

    def __init__(self, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(name)
        self.begun: list[dict[str, Any]] = []
        self.logged: list[tuple[int, dict[str, float]]] = []
        self.num_finished = 0
        monkeypatch.setitem(sys.modules, name, self)

    def init(self, *, project: str, name: str, config: dict[str, Any]) -> FakeService:
        self.begun.append({"project": project, "name": name, "config": config})
        return self

    def log(self, metrics: dict[str, float], step: int) -> None:
        self.logged.append((step, metrics))

    def finish(self) -> None:
        self.num_finished += 1


def test_a_training_is_followed_and_a_resumed_one_from_its_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = [FakeService(name, monkeypatch) for name in ("trackio", "wandb")]
    demonstrations = two_styles(20)
    config = RunConfig(ModelConfig(hidden_features=8), TrainingConfig(num_steps=4, evaluate_every=2))
    about = About(config, Source("walks.csv"), None, "walks", ("tvae", "fit"))
    run = RunDirectory.create(tmp_path / "run", force=False)
    begin(run, demonstrations, about)

    def fit(*trackers: Tracker) -> None:
        fit_run(run, demonstrations, about, device="cpu", console=Console(quiet=True), trackers=trackers)

    fit(trackio("mine"), wandb("ours"))
    for service, project in zip(both, ("mine", "ours"), strict=True):
        assert service.begun == [{"project": project, "name": "walks", "config": config.to_json()}]
        assert service.logged == [(record.step, scalars(record)) for record in history(run)]
        assert [step for step, _ in service.logged] == [0, 2, 4]
        assert service.num_finished == 1
    assert list(run.tensorboard.iterdir())
    fit(trackio("mine"))
    assert [step for step, _ in both[0].logged] == [0, 2, 4, 0, 2, 4]
    assert len(both[1].begun) == 1


def test_a_training_that_fails_ends_its_run(monkeypatch: pytest.MonkeyPatch) -> None:
    service = FakeService("trackio", monkeypatch)
    terms = Terms(policy=1.0, state=2.0, stop=0.0, kl=0.5)
    record = Record(1, 1.5, terms, terms)

    def fail() -> None:
        with trackio("mine").watching("walks", {}) as observer:
            observer.on_step(1, terms)
            observer.on_record(record)
            raise RuntimeError("lightning")

    with pytest.raises(RuntimeError, match="lightning"):
        fail()
    assert service.logged == [(1, scalars(record))]
    assert service.num_finished == 1


def test_a_service_that_begins_no_run_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    class Error(Exception):
        pass

    def init(**options: object) -> None:
        raise Error("No API key configured.")

    service = FakeService("wandb", monkeypatch)
    monkeypatch.setattr(service, "Error", Error, raising=False)
    monkeypatch.setattr(service, "init", init)
    with (
        pytest.raises(TrackerError, match="--wandb cannot begin a run: No API key configured"),
        wandb("ours").watching("walks", {}),
    ):
        pass
    assert service.num_finished == 0


@pytest.mark.parametrize("verb", ["fit", "demo"])
def test_the_options_name_the_projects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    for name in ("trackio", "wandb"):
        FakeService(name, monkeypatch)
    given: list[tuple[Tracker, ...]] = []
    module = import_module(f"tvae.cli.{verb}")
    monkeypatch.setattr(module, "resumed_run", lambda out, env=None: None)
    monkeypatch.setattr(module, "check_resumed", lambda out, config, **options: None)
    monkeypatch.setattr(module, "complete", lambda begun, trackers, **options: given.append(trackers))
    for options in ([], ["--wandb", "ours"], ["--wandb", "ours", "--trackio", "mine"]):
        call(verb, "--resume", "--out", tmp_path, *options)
    assert given == [(), (wandb("ours"),), (trackio("mine"), wandb("ours"))]


@pytest.mark.parametrize("name", ["trackio", "wandb"])
@pytest.mark.parametrize("command", [("fit", "walks.csv"), ("demo",)], ids=lambda command: command[0])
def test_a_service_that_is_missing_is_said_before_anything_is_made(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    command: tuple[str, ...],
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    said = refused(capsys, *command, "--out", tmp_path / "run", f"--{name}", "mine")
    assert f"--{name} needs an extra: pip install 'tvae[{name}]'" in said
    assert not (tmp_path / "run").exists()
