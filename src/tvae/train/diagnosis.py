"""What is to be said of a training that ended, in words."""

from __future__ import annotations

import warnings

import numpy as np

from tvae.model.tvae import TrajectoryVAE
from tvae.train.checkpoint import Progress, Record

COLLAPSED_NATS = 0.05
FEWEST_LATER = 4
"""Evaluations that must follow the best one before it can be said that the bound fell since."""
_FIRST = 2
"""The best of the held-out bound is early where it is among so many evaluations that may be kept."""
_LEAST_FALL = 0.01
"""A fall below this share of what was gained before is not worth a word."""
_NOISES = 3.0
"""A fall must be so many standard deviations of the bound's noise from one evaluation to the next."""


class TrainingWarning(UserWarning):
    """Training ended, but something about it needs the user's eye; the message says what to do."""


def ending(progress: Progress, num_steps: int) -> str:
    """In one line, where a training ended and which weights are kept; empty where it ended as was to be expected.

    >>> from tvae.train.terms import Terms
    >>> nothing = Terms(0.0, 0.0, 0.0, 0.0)
    >>> records = tuple(Record(step, 1.0, nothing, nothing) for step in (0, 2400, 3400))
    >>> ending(Progress(3400, 1.0, 0.0, 2400, 10, True, records), num_steps=4000)
    'training ended early, at step 3400 of 4000: the held-out bound was best at step 2400, whose weights are kept'
    """
    if progress.best_step == num_steps:
        return ""
    best = f"the held-out bound was best at step {progress.best_step}, whose weights are kept"
    if progress.step < num_steps:
        return f"training ended early, at step {progress.step} of {num_steps}: {best}"
    return best


def diagnose(model: TrajectoryVAE, progress: Progress, state_weight: float, choosable: float) -> None:
    """Warn in words where a training ended in one of the known ways to fail.

    Its weights may be kept from the step `choosable` on. It overfits where the held-out bound was best in the first
    half of the training, or in the first evaluations that may be kept, and fell since while that of the training
    batches rose.
    """
    first, kept = progress.records[0].held_out, progress.best.held_out
    if model.latent_features and kept.kl < COLLAPSED_NATS:
        warnings.warn(
            f"the latent has collapsed: it holds {kept.kl:.3f} nats of a held-out trajectory, so no style can be "
            "told from it. Lower the weight of the KL term, give the decoders a shorter window, or give them more "
            "dropout, so that they need z. If there is one style only, this is the truth.",
            TrainingWarning,
            stacklevel=3,
        )
    peak = _overfitted_since(progress, state_weight, choosable)
    if peak is not None:
        best, after, last = (
            record.held_out.value(progress.best.beta, state_weight)
            for record in (peak, progress.best, progress.records[-1])
        )
        kept_too = peak is progress.best
        now = "whose weights are kept" if kept_too else f"and {after:.1f} at step {progress.best_step}, kept"
        warnings.warn(
            f"the model overfits: its bound on held-out trajectories was best at step {peak.step} ({best:.1f} nats), "
            f"{now}, and fell to {last:.1f} at step {progress.step} while that of training went on to rise. "
            "More demonstrations help most; else give the nets fewer features or some dropout, or train for fewer "
            "steps.",
            TrainingWarning,
            stacklevel=3,
        )
    before, after = (terms.policy + state_weight * terms.state + terms.ahead for terms in (first, kept))
    if after <= before and peak is None:
        warnings.warn(
            "nothing was learnt: held-out likelihood is no better than before training "
            f"({after:.1f} against {before:.1f} nats a trajectory). Check that "
            "actions depend on observations, train for more steps, or lower the learning rate.",
            TrainingWarning,
            stacklevel=3,
        )


def _overfitted_since(progress: Progress, state_weight: float, choosable: float) -> Record | None:
    """The evaluation since which the model overfits; None where it does not.

    All are compared with the weight of the KL term of the kept one. What follows the best evaluation is taken in two
    halves: the held-out bound of the second is lower, and that of training is higher.
    """
    records, beta = progress.records, progress.best.beta
    held = np.array([record.held_out.value(beta, state_weight) for record in records])
    training = np.array([record.training.value(beta, state_weight) for record in records])
    peak = int(held.argmax())
    later = len(records) - 1 - peak
    kept_first = [record.step for record in records[1:] if record.step >= choosable][:_FIRST]
    early = records[peak].step < progress.step / 2 or records[peak].step in kept_first
    if peak == 0 or later < FEWEST_LATER or not early:
        return None
    middle = peak + 1 + later // 2
    fall = held[peak] - held[middle:].mean()
    noise = np.diff(held[peak + 1 :]).std() / np.sqrt(2)
    fell = held[middle:].mean() < held[peak + 1 : middle].mean() and fall > _NOISES * noise
    rose = training[middle:].mean() > training[peak + 1 : middle].mean()
    return records[peak] if fell and rose and fall > _LEAST_FALL * (held[peak] - held[0]) else None
