"""What is wrong with a training that ended, in words."""

from __future__ import annotations

import warnings

from tvae.model.tvae import TrajectoryVAE
from tvae.train.checkpoint import Progress

COLLAPSED_NATS = 0.05


class TrainingWarning(UserWarning):
    """Training ended, but something about it needs the user's eye; the message says what to do."""


def diagnose(model: TrajectoryVAE, progress: Progress, state_weight: float) -> None:
    """Warn in words where a training ended in one of the known ways to fail."""
    first, kept = progress.records[0].held_out, progress.best.held_out
    if model.latent_features and kept.kl < COLLAPSED_NATS:
        warnings.warn(
            f"the latent has collapsed: it holds {kept.kl:.3f} nats of a held-out trajectory, so no style can be "
            "told from it. Lower the weight of the KL term, give the decoders a shorter window, or give them more "
            "dropout, so that they need z. If there is one style only, this is the truth.",
            TrainingWarning,
            stacklevel=3,
        )
    before, after = (terms.policy + state_weight * terms.state + terms.ahead for terms in (first, kept))
    if after <= before:
        warnings.warn(
            "nothing was learnt: held-out likelihood is no better than before training "
            f"({after:.1f} against {before:.1f} nats a trajectory). Check that "
            "actions depend on observations, train for more steps, or lower the learning rate.",
            TrainingWarning,
            stacklevel=3,
        )
