"""From demonstrations to a trained model in one call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import DataError
from tvae.device import resolve_device, seeded
from tvae.fitting.amounts import Amounts
from tvae.fitting.refine import refine_policy
from tvae.model.tvae import TrajectoryVAE
from tvae.train.loop import train
from tvae.train.observer import Observer
from tvae.train.penalties import Penalty
from tvae.train.schedules import RAISED, KLSchedule


@torch.inference_mode(False)  # whatever is on where it is called: who learns needs gradients
def fit(
    demonstrations: Demonstrations,
    *,
    latent_features: int = 2,
    hidden_features: int = 64,
    policy_features: int | None = None,
    dropout: float = 0.0,
    window: int | None = 4,
    stop: bool = True,
    action_components: int = 2,
    state_components: int = 1,
    prior_components: int = 4,
    encode_actions: bool = True,
    reactive: bool = True,
    horizon: int = 1,
    dynamics: bool = False,
    events: bool = True,
    schedule: KLSchedule = RAISED,
    num_steps: int | None = None,
    batch_size: int | None = None,
    learning_rate: float = 1e-2,
    clip: float = 1.0,
    state_weight: float = 1.0,
    shortest_window: int = 1,
    penalties: Sequence[Penalty] = (),
    evaluate_every: int = 100,
    patience: int = 10,
    held_out: float = 0.1,
    group: str | None = None,
    policy_steps: int | None = None,
    seed: int = 0,
    device: str | torch.device = "auto",
    checkpoint: str | Path | None = None,
    observer: Observer = Observer(),  # noqa: B008 - frozen
) -> TrajectoryVAE:
    """A `TrajectoryVAE` trained on all but a held-out part of the demonstrations.

    The first arguments are those of `TrajectoryVAE`, the later ones those of `train`. `num_steps` None are 60 passes
    over the demonstrations, but 2,200 steps at least and 6,000 at most. `held_out` is the share of episodes kept for
    early stopping; with `group`, an attribute, groups stay whole. The policy then learns further alone
    (`tvae.fitting.refine`), for `policy_steps`: None for as many as `num_steps`, at most 2,500, and 0 for none.

    Raises `DataError` for anything but demonstrations.
    """
    if not isinstance(demonstrations, Demonstrations):
        raise DataError(
            "fit needs demonstrations, as tvae.load_demonstrations reads them, "
            f"got {type(demonstrations).__name__}"
        )
    training, judged = demonstrations.split(held_out, seed=seed, group=group)
    amounts = Amounts.of(training.lengths, batch_size=batch_size, num_steps=num_steps, policy_steps=policy_steps)
    model = new_model(
        demonstrations,
        seed=seed,
        device=device,
        latent_features=latent_features,
        hidden_features=hidden_features,
        policy_features=policy_features,
        dropout=dropout,
        window=window,
        stop=stop,
        action_components=action_components,
        state_components=state_components,
        prior_components=prior_components,
        encode_actions=encode_actions,
        reactive=reactive,
        horizon=horizon,
        dynamics=dynamics,
        events=events,
    )
    train(
        model,
        training,
        judged,
        schedule=schedule,
        num_steps=amounts.num_steps,
        batch_size=amounts.batch_size,
        learning_rate=learning_rate,
        clip=clip,
        state_weight=state_weight,
        shortest_window=shortest_window,
        penalties=penalties,
        evaluate_every=evaluate_every,
        patience=patience,
        seed=seed,
        checkpoint=None if checkpoint is None else Path(checkpoint),
        observer=observer,
    )
    if amounts.policy_steps:
        refine_policy(model, training, judged, num_steps=amounts.policy_steps, seed=seed, observer=observer)
    return model


def new_model(
    demonstrations: Demonstrations, *, seed: int, device: str | torch.device, **arguments: Any
) -> TrajectoryVAE:
    """An untrained model of the demonstrations' spaces; its first weights depend on `seed` alone.

    `arguments` are those of `TrajectoryVAE`.
    """
    with seeded(seed, torch.device("cpu")):
        model = TrajectoryVAE(demonstrations.observation_space, demonstrations.action_space, **arguments)
    return model.to(resolve_device(device))
