"""The methods that are compared, in the order of the table: one line each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from tvae.baselines.act import ActionChunks
from tvae.baselines.bet import BehaviorTransformer
from tvae.baselines.cloning import CloningLSTM, CloningMLP
from tvae.baselines.contract import Method
from tvae.baselines.dagger import DAgger
from tvae.baselines.flow import FlowMatching
from tvae.baselines.from_observation import CloningFromObservation
from tvae.baselines.indexed import IndexedCloning
from tvae.baselines.labelled import LabelledCloning
from tvae.baselines.scripted import Demonstrators
from tvae.baselines.sectar import SelfConsistentTrajectories
from tvae.baselines.state_vae import StateTrajectoryVAE
from tvae.baselines.trivial import Walking, WalkingAttacking
from tvae.config import RunConfig
from tvae.errors import TvaeError
from tvae.experiments.benchmark.ours import Ours
from tvae.experiments.benchmark.people import People
from tvae.experiments.benchmark.tasks import TASKS
from tvae.experiments.tasks import OVERCOOKED_CONFIG


class Need(Enum):
    """What a method learns from beside demonstrations."""

    LABELS = "labels"
    NUMBER = "number of styles"
    ENVIRONMENT = "environment"
    DEMONSTRATORS = "demonstrators"


Maker: TypeAlias = Callable[[str, Path], Method]
"""Makes a method for a task; the path is where finished cells of `tvae reproduce` lie."""


@dataclass(frozen=True)
class Entry:
    """A method as the benchmark lists it."""

    title: str
    make: Maker
    needs: tuple[Need, ...] = ()
    tasks: tuple[str, ...] = tuple(TASKS)
    learns: bool = True
    """Whether there is anything that a shorter training would learn less of."""


_WITH_PEOPLE: Mapping[str, Mapping[str, int]] = {
    "pusht": {"hidden_features": 128, "num_components": 5},
    "overcooked": {"hidden_features": OVERCOOKED_CONFIG.model.hidden_features},
}
"""What the other methods have there at least: as much as ours, on PushT more, which serves them."""


def _always(method: Method) -> Maker:
    return lambda task, cells: method


def _sized(method: Method) -> Maker:
    """As it is, but wider with real people, and with more laws for an action on PushT.

    >>> [_sized(CloningLSTM())(task, Path()).hidden_features for task in ("zombie", "pusht")]
    [64, 128]
    """

    def make(task: str, cells: Path) -> Method:
        data: Any = method
        least = _WITH_PEOPLE.get(task, {})
        larger = {
            field.name: max(getattr(data, field.name), least[field.name])
            for field in fields(data)
            if field.name in least
        }
        found: Method = replace(data, **larger)
        return found

    return make


Coded: TypeAlias = IndexedCloning | LabelledCloning | DAgger | StateTrajectoryVAE | SelfConsistentTrajectories


def _coded(method: Coded) -> Maker:
    """With one law for an action on circles: within a style there is one way to walk there."""
    circles, sized = _always(replace(method, num_components=1)), _sized(method)
    return lambda task, cells: (circles if task == "circle" else sized)(task, cells)


def from_extra(module: str, name: str, extra: str, **hyperparameters: Any) -> Maker:
    """Makes the method `name` of a module that needs an optional extra.

    The maker raises `TvaeError`, which says what to install, where the extra is missing.

    >>> from_extra("tvae.baselines.cloning", "CloningMLP", "baselines", num_steps=5)("zombie", Path()).num_steps
    5
    """

    def make(task: str, cells: Path) -> Method:
        try:
            found: Method = getattr(import_module(module), name)(**hyperparameters)
        except ImportError as error:
            if (error.name or "").startswith("tvae."):
                raise
            raise TvaeError(f"{name} needs an extra: pip install 'tvae[{extra}]' ({error})") from error
        return found

    return make


def _infogail(task: str, cells: Path) -> Method:
    """With as many codes as the task has styles."""
    return from_extra("tvae.baselines.gail", "InfoGAIL", "imitation", num_codes=len(TASKS[task].labels))(task, cells)


def _state_vae_gail(task: str, cells: Path) -> Method:
    """With the first stage as it is alone."""
    first = _coded(StateTrajectoryVAE())(task, cells)
    return from_extra("tvae.baselines.state_vae_gail", "StateVAEWithGAIL", "imitation", first=first)(task, cells)


def _untuned(task: str, cells: Path) -> Method:
    """As `tvae fit` does where nothing is asked, but that it is told which episodes are of one group."""
    return Ours(task, RunConfig(group=TASKS[task].config.group), cells)


_PEOPLE = ("pusht", "overcooked")

METHODS: Mapping[str, Entry] = {
    "demonstrators": Entry("Scripted demonstrators", _always(Demonstrators()), (Need.DEMONSTRATORS,), learns=False),
    "people": Entry("The people themselves", lambda task, cells: People(task), tasks=_PEOPLE, learns=False),
    "walk": Entry("Straight walk", _always(Walking()), tasks=("zombie",), learns=False),
    "walk_attacking": Entry(
        "Straight walk, attacks in range", _always(WalkingAttacking()), tasks=("zombie",), learns=False
    ),
    "cloning_mlp": Entry("Behavioural cloning, MLP", _sized(CloningMLP())),
    "cloning_lstm": Entry("Behavioural cloning, LSTM", _sized(CloningLSTM())),
    "act": Entry("Action chunks, VAE (ACT-like)", _sized(ActionChunks())),
    "flow": Entry("Action chunks, flow matching", _sized(FlowMatching())),
    "bet": Entry("Behavior Transformer", _sized(BehaviorTransformer())),
    "from_observation": Entry("Cloning from observation", _sized(CloningFromObservation()), (Need.ENVIRONMENT,)),
    "apprenticeship": Entry(
        "Apprenticeship learning",
        from_extra("tvae.baselines.apprenticeship", "ApprenticeshipLearning", "imitation"),
        (Need.ENVIRONMENT,),
    ),
    "gail": Entry("GAIL", from_extra("tvae.baselines.gail", "GAIL", "imitation"), (Need.ENVIRONMENT,)),
    "infogail": Entry(
        "InfoGAIL given the number of styles",
        _infogail,
        (Need.ENVIRONMENT, Need.NUMBER),
    ),
    "state_vae": Entry("State-only trajectory VAE", _coded(StateTrajectoryVAE())),
    "state_vae_gail": Entry("State-only trajectory VAE, then GAIL", _state_vae_gail, (Need.ENVIRONMENT,)),
    "sectar": Entry("SeCTAR, one level", _coded(SelfConsistentTrajectories())),
    "indexed": Entry("Code for each trajectory (ZBC)", _coded(IndexedCloning())),
    "labelled": Entry("Cloning given the true label", _coded(LabelledCloning()), (Need.LABELS,)),
    "dagger": Entry(
        "DAgger given the true label", _coded(DAgger()), (Need.LABELS, Need.ENVIRONMENT, Need.DEMONSTRATORS)
    ),
    "ours_untuned": Entry("T-VAE (ours), untuned", _untuned, tasks=("overcooked",)),
    "ours": Entry("T-VAE (ours)", lambda task, cells: Ours(task, TASKS[task].config, cells)),
}
