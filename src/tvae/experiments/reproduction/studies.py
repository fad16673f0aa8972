"""The three tasks, each as what is trained, measured and drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

from matplotlib.animation import FuncAnimation

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.envs.zombie import zombie_demonstrations
from tvae.experiments.reproduction import circle, navigation, zombie, zombie_pictures
from tvae.experiments.reproduction.horizon import horizon_picture
from tvae.experiments.reproduction.numbers import Picture, Runs
from tvae.experiments.reproduction.presets import ABLATIONS, BESIDE, PRESETS, SAMPLE_SIZES
from tvae.experiments.reproduction.subject import Subject

Measure: TypeAlias = Callable[[Subject], dict[str, Any]]


@dataclass(frozen=True)
class Study:
    """A task of the paper."""

    title: str
    demonstrations: Callable[[int], Demonstrations]
    """Of a seed."""
    other_demonstrations: Mapping[str, Callable[[int], Demonstrations]] = field(default_factory=dict, kw_only=True)
    """By preset, where one learns from others."""
    test_demonstrations: Callable[[], Demonstrations]
    presets: Mapping[str, RunConfig]
    measures: Mapping[str, Measure]
    """By preset."""
    draw: Callable[[Subject], list[Picture]]
    """The figures of one model."""
    draw_across: Callable[[Runs], list[Picture]]
    """The figures of all seeds and presets together."""
    animations: Callable[[Subject], dict[str, FuncAnimation]] = lambda subject: {}

    def learnt_from(self, preset: str, seed: int) -> Demonstrations:
        """The demonstrations that a preset is trained on."""
        return self.other_demonstrations.get(preset, self.demonstrations)(seed)


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
            "bound": navigation.measure,
            **dict.fromkeys(BESIDE["navigation"], navigation.measure_cloning),
        },
        navigation.draw,
        lambda runs: [horizon_picture(runs, "distance to the nearest test path")],
    ),
    "circle": Study(
        "Circle",
        circle.demonstrations,
        circle.test_demonstrations,
        _presets("circle"),
        {
            "default": circle.measure,
            "paper": circle.measure,
            "bound": circle.measure,
            **dict.fromkeys(BESIDE["circle"], circle.measure_cloning),
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
            **dict.fromkeys(ABLATIONS["zombie"], zombie.measure_briefly),
            "bound": zombie.measure,
            "whole_episodes": zombie.measure_with_windows,
            "no_state_decoder": zombie.measure_bots,
        },
        zombie_pictures.draw,
        zombie_pictures.draw_across,
        zombie_pictures.animations,
        other_demonstrations={name: partial(zombie_demonstrations, count) for name, count in SAMPLE_SIZES.items()},
    ),
}
