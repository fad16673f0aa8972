"""The one training loop: maximise the evidence lower bound on demonstrations, stop on held-out ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tvae.data.batches import (
    BucketedSampler,
    TrajectoryBatch,
    batch_of,
    evenly,
    ordered_batches,
    suitable_batch_size,
    within_memory,
)
from tvae.data.demonstrations import Demonstrations
from tvae.data.identity import identity
from tvae.device import reseed, seeded
from tvae.errors import TvaeError
from tvae.model.arguments import counted
from tvae.model.elbo import elbo
from tvae.model.inference import inferring, learning
from tvae.model.tvae import TrajectoryVAE
from tvae.model.windows import Windows, cut_anywhere
from tvae.train.checkpoint import Progress, Record, copy_of_weights, read_checkpoint, write_checkpoint
from tvae.train.diagnosis import diagnose
from tvae.train.memory import candidates, shortest_sufficient_window
from tvae.train.observer import Observer
from tvae.train.penalties import Penalty
from tvae.train.schedules import KLSchedule
from tvae.train.terms import Terms

MOST_JUDGED_STEPS = 100_000
"""Held-out steps by which weights are judged; of more, evenly spaced episodes."""
_WINDOW_CHOSEN = 0.6
"""Share of the training after which the policy's window is chosen."""


class TrainingError(TvaeError):
    """Training cannot go on; the message says why and what to do."""


def train(
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    held_out: Demonstrations,
    *,
    schedule: KLSchedule,
    num_steps: int,
    batch_size: int | None = None,
    learning_rate: float = 1e-2,
    clip: float = 1.0,
    state_weight: float = 1.0,
    shortest_window: int = 1,
    penalties: Sequence[Penalty] = (),
    evaluate_every: int = 100,
    patience: int = 10,
    seed: int = 0,
    checkpoint: Path | None = None,
    observer: Observer = Observer(),  # noqa: B008 - frozen
) -> tuple[Record, ...]:
    """Train `model` in place, leave it with its best weights on `held_out`, and return the evaluations.

    Each step takes one batch of `batch_size` trajectories of similar lengths (None: `suitable_batch_size`), cut into
    the model's windows at a random offset, and one step of Adam on

        -(policy + state_weight state + ahead + stop - beta KL) / (mean length),

    its learning rate falling to nothing along half a cosine. The gradient of the encoder, the prior and each decoder is
    clipped to the norm `clip` on its own, so that a sharp term cannot drown another. A batch of more than 65,536 steps,
    padding included, is gone through in parts whose gradients add up, so that memory suffices; penalties are then those
    of the parts.

    Of a model that is trained on windows, the window of the policy is chosen at the evaluation that follows 60 % of
    the steps (`tvae.train.memory`), and is at least `shortest_window`. Until then the policy is trained on windows of
    all lengths among which to choose, a random one in each step, and afterwards on windows of the chosen length. These
    too are cut, so that the policy often begins without a past: there it has z and the present state alone to go by,
    and z learns the more.

    Each of `penalties` (`tvae.train.penalties`) is taken off the bound of a step. None counts where weights are judged.

    Every `evaluate_every` steps the bound is evaluated on `held_out`; of more than 100,000 steps, on evenly spaced
    episodes. After `schedule` has settled and the window is chosen, the weights with the best one are kept (two are
    compared with the present weight of the KL term), and training ends early when `patience` evaluations have not
    improved on it. The state term has the weight `state_weight` there too. With 0, z and the policy are learnt as if
    next states were not told; what is told h steps ahead, of a model with a horizon, counts all the same. Without that,
    the state decoder stays as it was but for what the stop term, if the model has one, teaches its trunk.

    The randomness of a step depends on `seed` and the step alone: with `checkpoint`, a file that is written at
    each evaluation and read if it is there, a killed training ends in the same weights on a CPU.

    Warns with `TrainingWarning` (`tvae.train.diagnosis`) where the latent has collapsed, the model overfits, or nothing
    was learnt. Raises `TrainingError` where a gradient or the bound on `held_out` is not finite, `CheckpointError` for
    a checkpoint of another model, other demonstrations or another training, and `ValueError` for numbers that cannot
    be.
    """
    if batch_size is None:
        batch_size = suitable_batch_size(demonstrations.lengths)
    for name, number in (
        ("num_steps", num_steps),
        ("batch_size", batch_size),
        ("shortest_window", shortest_window),
        ("evaluate_every", evaluate_every),
        ("patience", patience),
        ("the number of held-out episodes", len(held_out)),
    ):
        counted(name, number)
    if not clip > 0:
        raise ValueError(f"clip must be above 0, got {clip}")
    if not 0 <= state_weight < math.inf:
        raise ValueError(f"state_weight must be a number of at least 0, got {state_weight}")
    model.calibrate(demonstrations)
    optimizer = torch.optim.Adam(model.parameters(), lr=learning_rate, fused=True)
    chosen = 0.0 if model.window is None else _WINDOW_CHOSEN * num_steps
    judging = evenly(held_out, MOST_JUDGED_STEPS)
    steps = _Steps(
        model,
        optimizer,
        demonstrations,
        BucketedSampler(demonstrations.lengths, batch_size, seed),
        schedule,
        num_steps,
        learning_rate,
        clip,
        state_weight,
        tuple(penalties),
        chosen,
        candidates(model.window, shortest_window),
        seed,
    )
    settings: dict[str, object] = {
        "schedule": schedule,
        "num_steps": num_steps,
        "batch_size": batch_size,
        "learning_rate": learning_rate,
        "clip": clip,
        "state_weight": state_weight,
        "shortest_window": shortest_window,
        "evaluate_every": evaluate_every,
        "patience": patience,
        "seed": seed,
        **{f"model.{name}": value for name, value in model.arguments.items()},
        "demonstrations": identity(demonstrations),
        "held-out demonstrations": identity(held_out),
    }
    if penalties:
        settings["penalties"] = tuple(penalties)
    choosable = max(schedule.settled * num_steps, chosen)
    with seeded(seed, model.device), learning(model):
        if checkpoint is not None and checkpoint.exists():
            progress, best = read_checkpoint(checkpoint, settings, model, optimizer)
        else:
            first = _finite(evaluate(model, judging, batch_size=batch_size, seed=seed), 0)
            beta = schedule.weight(0.0, first.kl, 1.0)
            progress = Progress(0, beta, first.kl, 0, 0, False, (Record(0, beta, first, first),))
            best = copy_of_weights(model)
        for record in progress.records:
            observer.on_record(record)
        while not progress.finished:
            end = min(progress.step + evaluate_every, num_steps)
            terms, beta = steps.run(progress, end, observer)
            if progress.step < chosen <= end:
                model.bot_window = shortest_sufficient_window(
                    model, held_out, shortest=shortest_window, seed=seed
                )
            held = _finite(evaluate(model, judging, batch_size=batch_size, seed=seed), end)
            record = Record(end, beta, Terms.average(terms), held)
            judged = _judge(progress, record, terms[-1].kl, choosable, state_weight)
            if judged.best_step == end:
                best = copy_of_weights(model)
            progress = replace(judged, finished=end == num_steps or judged.stale >= patience)
            observer.on_record(record)
            if checkpoint is not None:
                write_checkpoint(
                    checkpoint, settings=settings, progress=progress, model=model, optimizer=optimizer, best=best
                )
    model.load_state_dict(best)
    observer.on_end(progress)
    diagnose(model, progress, state_weight, choosable)
    return progress.records


@dataclass(frozen=True)
class _Steps:
    """Consecutive steps of gradient descent, each a function of the seed and its number."""

    model: TrajectoryVAE
    optimizer: torch.optim.Optimizer
    demonstrations: Demonstrations
    sampler: BucketedSampler
    schedule: KLSchedule
    num_steps: int
    learning_rate: float
    clip: float
    state_weight: float
    penalties: tuple[Penalty, ...]
    chosen: float
    """The step after which the policy's window is chosen."""
    windows: tuple[int | None, ...]
    """Those among which it is chosen."""
    seed: int

    def run(self, progress: Progress, end: int, observer: Observer) -> tuple[list[Terms], float]:
        """Steps `progress.step` to `end`; returns the terms of each and the last beta."""
        model, beta, kl = self.model, progress.beta, progress.last_kl
        per_step = 1 / float(self.demonstrations.lengths.mean())
        parts = [learnt for part in model.children() if (learnt := [p for p in part.parameters() if p.requires_grad])]
        history: list[Terms] = []
        for step in range(progress.step, end):
            reseed(np.random.SeedSequence((self.seed, step)).generate_state(1, np.uint64).item(), model.device)
            beta = self.schedule.weight(step / self.num_steps, kl, beta)
            for group in self.optimizer.param_groups:
                group["lr"] = self.learning_rate * 0.5 * (1 + math.cos(math.pi * step / self.num_steps))
            episodes = self.sampler.episodes(step)
            self.optimizer.zero_grad()
            found, shares = [], []
            for part in within_memory(self.demonstrations, episodes):
                batch = batch_of(self.demonstrations, part, model.device)
                policy = _any_of(self.windows, batch) if step < self.chosen else cut_anywhere(batch, model.bot_window)
                terms = elbo(model, batch, policy=policy, state=cut_anywhere(batch, model.window))
                value = terms.value(beta, self.state_weight)
                for penalty in self.penalties:
                    value = value - penalty(model, batch, terms.posterior, terms.z)
                found.append(Terms.of(terms))
                shares.append(len(part) / len(episodes))
                (-per_step * shares[-1] * value.mean()).backward()
            norms = [nn.utils.clip_grad_norm_(learnt, self.clip) for learnt in parts]
            history.append(Terms.average(found, shares))
            if not torch.stack(norms).isfinite().all():
                raise TrainingError(
                    f"step {step + 1}: the gradient is not finite; the bound's terms are {history[-1]}. "
                    "Lower the learning rate, or look for extreme values in the demonstrations."
                )
            self.optimizer.step()
            kl = history[-1].kl
            observer.on_step(step + 1, history[-1])
        return history, beta


def _any_of(lengths: Sequence[int | None], batch: TrajectoryBatch) -> Windows:
    """Windows of one of these lengths."""
    return cut_anywhere(batch, lengths[int(torch.randint(len(lengths), ()))])


def cut_as_a_bot_sees(model: TrajectoryVAE, batch: TrajectoryBatch) -> Windows:
    """Windows of a bot's length, cut at a random offset."""
    return cut_anywhere(batch, model.bot_window)


def evaluate(
    model: TrajectoryVAE,
    demonstrations: Demonstrations,
    seen: Callable[[TrajectoryVAE, TrajectoryBatch], Windows] = cut_as_a_bot_sees,
    *,
    batch_size: int = 64,
    seed: int = 0,
) -> Terms:
    """Mean terms of the bound over all trajectories, one posterior sample each, without dropout.

    `seen` gives the windows of the policy; those of the training are cut. `tvae.model.windows.policy_windows` gives
    each step the past that a bot has there.
    """
    weighted: list[Terms] = []
    with inferring(model), seeded(seed, model.device):
        for episodes in ordered_batches(demonstrations, batch_size):
            batch = batch_of(demonstrations, episodes, model.device)
            windows = {"policy": seen(model, batch), "state": cut_anywhere(batch, model.window)}
            weighted.extend([Terms.of(elbo(model, batch, **windows))] * len(episodes))
    return Terms.average(weighted)


def _finite(held_out: Terms, step: int) -> Terms:
    if not math.isfinite(held_out.value(1.0)):
        raise TrainingError(
            f"step {step}: the bound on held-out demonstrations is not finite; its terms are {held_out}. "
            "Look for extreme values in the demonstrations."
        )
    return held_out


def _judge(progress: Progress, record: Record, last_kl: float, settled: float, state_weight: float) -> Progress:
    """The progress after one more evaluation; before step `settled`, the latest counts as the best."""
    held_out, best = (terms.value(record.beta, state_weight) for terms in (record.held_out, progress.best.held_out))
    improved = progress.best_step < settled or held_out > best
    return replace(
        progress,
        step=record.step,
        beta=record.beta,
        last_kl=last_kl,
        best_step=record.step if improved else progress.best_step,
        stale=0 if improved else progress.stale + 1,
        records=(*progress.records, record),
    )
