"""The options of services that follow experiments."""

from __future__ import annotations

from dataclasses import dataclass

from cyclopts import Parameter

from tvae.experiments.tracking import Tracker
from tvae.experiments.tracking import trackio as _trackio
from tvae.experiments.tracking import wandb as _wandb


@Parameter(name="*")
@dataclass(frozen=True)
class Tracking:
    """Where else the training's curves go."""

    trackio: str | None = None
    """Project of Trackio that gets the training's curves, beside tensorboard/."""
    wandb: str | None = None
    """Project of Weights & Biases that gets the training's curves, beside tensorboard/."""

    def trackers(self) -> tuple[Tracker, ...]:
        """Those that are asked for; `TrackerError` for one that is not installed."""
        asked = ((_trackio, self.trackio), (_wandb, self.wandb))
        return tuple(service(project) for service, project in asked if project is not None)


TRACKING = Tracking()
