"""The three tasks, each as what is trained, measured and drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from matplotlib.animation import FuncAnimation

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.experiments.reproduction import circle, navigation, zombie, zombie_pictures
from tvae.experiments.reproduction.horizon import horizon_picture
from tvae.experiments.reproduction.numbers import Picture
from tvae.experiments.reproduction.presets import ABLATIONS, BESIDE, PRESETS
from tvae.experiments.reproduction.subject import Subject

Measure: TypeAlias = Callable[[Subject], dict[str, Any]]
Runs: TypeAlias = Mapping[str, Sequence[Mapping[str, Any]]]
"""The metrics of each preset's seeds."""


@dataclass(frozen=True)
class Study:
    """A task of the paper."""

    title: str
    demonstrations: Callable[[int], Demonstrations]
    """Of a seed."""
    test_demonstrations: Callable[[], Demonstrations]
    presets: Mapping[str, RunConfig]
    measures: Mapping[str, Measure]
    """By preset."""
    draw: Callable[[Subject], list[Picture]]
    """The figures of one model."""
    draw_across: Callable[[Runs], list[Picture]]
    """The figures of all seeds and presets together."""
    animations: Callable[[Subject], dict[str, FuncAnimation]] = lambda subject: {}


def _presets(task: str) -> dict[str, RunConfig]:
    return {**PRESETS[task], **BESIDE[task], **ABLATIONS[task]}


STUDIES: Mapping[str, Study] = {
    "navigation": Study(
        "Navigation",
        navigation.demonstrations,
        navigation.test_demonstrations,
        _presets("navigation"),
        {
            "default": navigation.measure,
            "paper": navigation.measure,
            **{name: lambda subject: {"horizon": navigation.horizon(subject)} for name in BESIDE["navigation"]},
        },
        navigation.draw,
        lambda runs: [horizon_picture(runs, "distance to the nearest test trajectory")],
    ),
    "circle": Study(
        "Circle",
        circle.demonstrations,
        circle.test_demonstrations,
        _presets("circle"),
        {
            "default": circle.measure,
            "paper": circle.measure,
            **{name: lambda subject: {"horizon": circle.horizon(subject)} for name in BESIDE["circle"]},
        },
        circle.draw,
        lambda runs: [horizon_picture(runs, "distance to the nearest circle")],
    ),
    "zombie": Study(
        "Zombie attack",
        zombie.demonstrations,
        zombie.test_demonstrations,
        _presets("zombie"),
        {
            "default": zombie.measure,
            "paper": zombie.measure,
            "windows": zombie.measure_with_windows,
            **dict.fromkeys(ABLATIONS["zombie"], zombie.measure_briefly),
        },
        zombie_pictures.draw,
        zombie_pictures.draw_across,
        zombie_pictures.animations,
    ),
}
