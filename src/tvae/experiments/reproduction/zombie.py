"""Zombie attack: success in known and unknown worlds, by window, and what the latent tells of the world."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from tvae.data.demonstrations import Demonstrations
from tvae.data.trajectory import Trajectory
from tvae.envs.zombie import (
    HELD_OUT_WORLDS,
    AttackExpert,
    AvoidExpert,
    TwoStepAttacker,
    ZombieAttackVectorEnv,
    success,
    zombie_demonstrations,
)
from tvae.envs.zombie_dynamics import NUM_STEPS
from tvae.evaluate.keeping import style_consistency
from tvae.evaluate.leakage import leakage
from tvae.evaluate.paths import apart, earth_mover
from tvae.experiments.arenas import Arena
from tvae.experiments.reproduction.subject import (
    TEST,
    WORLDS,
    Subject,
    acted,
    first_observations,
)
from tvae.figures.outcomes import Outcomes
from tvae.figures.zombie import zombie_paths
from tvae.generate.open_loop import imagine
from tvae.model.decoding import Choice, Fixed, LatentSource, most_likely, sampled
from tvae.rollouts import Policy, rollout
from tvae.spaces import FloatArray

ENV = "tvae/ZombieAttack-v0"
EXPERTS: dict[str, Callable[[], Policy]] = {"attack": AttackExpert, "avoid": AvoidExpert}
LABELS = tuple(EXPERTS)
WINDOWS = (1, 2, 3, 5, 8, 10, 15, 20, 30)
FIELDS = ("attacked", "zombie_dead", "closest_goal", "closest_zombie")
_DRAWS = 5
"""Draws of z for each test demonstration in `success_from`."""
NUM_TEST = 200
"""Test demonstrations of each style; those of the two styles meet the same zombies."""


def demonstrations(seed: int) -> Demonstrations:
    """2,000 episodes."""
    return zombie_demonstrations(2000, seed)


def test_demonstrations() -> Demonstrations:
    """200 attacks, then 200 avoidances in the same worlds."""

    def episodes() -> Iterator[Trajectory]:
        for label, expert in EXPERTS.items():
            for episode in rollout(ZombieAttackVectorEnv(NUM_TEST), expert(), NUM_TEST, seed=TEST):
                yield replace(episode, attributes={"label": label})

    one = zombie_demonstrations(2)
    return Demonstrations.from_trajectories(episodes(), one.observation_space, one.action_space)


def measure(subject: Subject) -> dict[str, Any]:
    """All of `measure_briefly`, `success_by_window`, and:

    `held_out`: success in worlds that no demonstration was recorded in, beside the scripted experts'.
    `two_step_bot`: success of the hand-written attacker that sees two observations.
    `wasserstein`: distance of what came of the bots' episodes, at one z a style, from the demonstrations' (figure 7).
    `success_from`: success in the worlds of the test demonstrations, with z from the demonstration of the `same_start`
    and from `another_start` of its style: what z remembers of its own world would help the former alone.
    """
    return {
        **measure_with_windows(subject),
        "success_from": _success_from(subject),
        "two_step_bot": two_step_bot(subject.seed),
        "held_out": _held_out(subject),
        "wasserstein": _distances(subject),
    }


def measure_with_windows(subject: Subject) -> dict[str, Any]:
    """All of `measure_briefly`, and success by the window W at test time."""
    by_window = {
        str(window): {
            label: _rate(_play(subject, label, window=_window(subject, window)), label) for label in LABELS
        }
        for window in WINDOWS
    }
    return {**measure_briefly(subject), "success_by_window": by_window}


def measure_briefly(subject: Subject) -> dict[str, Any]:
    """Success as the docs define it, attacks, decoder consistency and leakage.

    `found`: 1 where a found style bears the label; where none does, z comes from training episodes that carry it.

    `decoder_consistency`: mean distance of the agent's path as the state decoder imagines it and as the policy
    decoder walks it, from the same start and z, both most likely. `leakage_r2`, `leakage_nats`: of the zombie's start,
    from a sample of z, within the style that tells most; `..._from_mean` from the posterior mean. `active_units`:
    features of z that tell episodes apart. `style_consistency`: share of a bot's episodes that the encoder tells as
    its style; 0 where no style bears the label.
    """
    return {
        **measure_bots(subject),
        "decoder_consistency": _consistency(subject),
    }


def measure_bots(subject: Subject) -> dict[str, Any]:
    """`measure_briefly` without what needs a state decoder."""
    played = {label: _play(subject, label) for label in LABELS}
    likely = {label: _play(subject, label, choice=most_likely) for label in LABELS}
    _, zombie = zombie_paths(first_observations(subject.test))
    true = np.array([LABELS.index(label) for label in subject.test.attribute("label").tolist()])
    told = leakage(subject.posteriors, zombie, true, seed=subject.seed)
    return {
        **subject.common(),
        "found": {label: int(subject.is_found(label)) for label in LABELS},
        "success": {label: _rate(played[label], label) for label in LABELS},
        "success_most_likely": {label: _rate(likely[label], label) for label in LABELS},
        "attacks_per_episode": {label: _attacks(played[label]) for label in LABELS},
        "leakage_r2": told.from_sample.r2,
        "leakage_r2_from_mean": told.from_mean.r2,
        "leakage_nats": told.from_sample.nats,
        "leakage_nats_from_mean": told.from_mean.nats,
        "active_units": len(subject.playstyles.active),
        "style_consistency": {label: _consistent(subject, label, played[label]) for label in LABELS},
    }


def _consistent(subject: Subject, label: str, episodes: Demonstrations) -> float:
    if not subject.is_found(label):
        return 0.0
    return style_consistency(subject.model, subject.playstyles, subject.findings.style(label), episodes)


def _play(
    subject: Subject,
    label: str,
    *,
    choice: Choice = sampled,
    window: int | None = None,
    latents: LatentSource | None = None,
    world: dict[str, Any] | None = None,
) -> Demonstrations:
    arena = Arena(ENV, world or {}, subject.episodes)
    return subject.play(latents or subject.latents(label), arena, choice=choice, window=window)


def _window(subject: Subject, window: int) -> int | None:
    """The window as a bot takes it; a model that knows none remembers the longest episode anyway."""
    return None if subject.model.window is None and window >= NUM_STEPS else window


def _rate(episodes: Demonstrations, label: str) -> float:
    return float(success(episodes)[label].mean())


def _attacks(episodes: Demonstrations) -> float:
    return float(last(episodes, "info.attacks").mean())


def last(episodes: Demonstrations, name: str) -> FloatArray:
    """(E,) a step column's last value of each episode."""
    return episodes.steps[name][episodes.action_starts + episodes.lengths - 1].astype(np.float64)


def _consistency(subject: Subject) -> float:
    drawn = subject.posteriors.sample(np.random.default_rng(subject.seed))
    starts = first_observations(subject.test)
    thought = imagine(subject.model, starts, drawn, num_steps=NUM_STEPS, choice=most_likely, seed=subject.seed)
    done = acted_as_test(subject, drawn, choice=most_likely)
    return float(apart(agents(thought), agents(done)).mean())


def acted_as_test(subject: Subject, z: FloatArray, *, choice: Choice) -> list[Trajectory]:
    """The bot's episodes in the worlds of the test demonstrations, with a z (E, Z) for each."""
    return [
        episode
        for part in np.split(z, len(LABELS))
        for episode in acted(subject.model, ENV, part, choice=choice, seed=TEST)
    ]


def agents(episodes: Demonstrations | list[Trajectory]) -> list[FloatArray]:
    """The agent's places in each episode, until it reaches the goal."""
    return [zombie_paths(until_goal(episode).observations)[0] for episode in episodes]


def until_goal(episode: Trajectory) -> Trajectory:
    """The episode up to its first observation within the goal; an imagined one may go on."""
    there = np.flatnonzero(episode.observations[:, 0] < 0.5)
    steps = max(1, min(len(episode), int(there[0]) if len(there) else len(episode)))
    return Trajectory(episode.observations[: steps + 1], episode.actions[:steps])


def _success_from(subject: Subject) -> dict[str, dict[str, float]]:
    rng = np.random.default_rng(subject.seed)
    rates: dict[str, dict[str, list[float]]] = {}
    for repeat in range(_DRAWS):
        drawn = np.split(subject.posteriors.sample(rng), len(LABELS))
        for label, own in zip(LABELS, drawn, strict=True):
            for origin, z in (("same_start", own), ("another_start", np.roll(own, repeat + 1, axis=0))):
                episodes = acted(subject.model, ENV, z, choice=sampled, seed=TEST)
                rates.setdefault(origin, {}).setdefault(label, []).append(_rate(episodes, label))
    return {origin: {label: float(np.mean(all_)) for label, all_ in found.items()} for origin, found in rates.items()}


def _held_out(subject: Subject) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for world, options in HELD_OUT_WORLDS.items():
        found[world] = {label: _rate(_play(subject, label, world=options), label) for label in LABELS}
        for label, expert in EXPERTS.items():
            envs = ZombieAttackVectorEnv(min(subject.episodes, 1000), **options)  # the bots' worlds
            episodes = rollout(envs, expert(), subject.episodes, seed=WORLDS + subject.seed)
            found[world][f"expert_{label}"] = _rate(episodes, label)
    return found


def outcomes_of(episodes: Demonstrations) -> Outcomes:
    """What came of each episode."""
    return Outcomes(
        last(episodes, "info.attacks") > 0,
        last(episodes, "info.zombie_dead") == 1,
        last(episodes, "info.closest_goal"),
        last(episodes, "info.closest_zombie"),
    )


def at_one_z(subject: Subject, label: str) -> Demonstrations:
    """Fresh episodes of a style's bot, all at one z that was drawn from the style at random."""
    z = subject.latents(label).sample(1, np.random.default_rng(subject.seed))
    return _play(subject, label, latents=Fixed(z))


def demonstrated(subject: Subject, label: str) -> Demonstrations:
    """The training demonstrations of a style."""
    return subject.demonstrations.select(np.flatnonzero(subject.demonstrations.attribute("label") == label))


def distances_of(bots: Outcomes, shown: Outcomes) -> dict[str, float]:
    """The Wasserstein-1 distance of each field."""
    return {
        name: earth_mover(getattr(bots, name).astype(np.float64), getattr(shown, name).astype(np.float64))
        for name in FIELDS
    }


def _distances(subject: Subject) -> dict[str, dict[str, float]]:
    return {
        label: distances_of(outcomes_of(at_one_z(subject, label)), outcomes_of(demonstrated(subject, label)))
        for label in LABELS
    }


def two_step_bot(seed: int, num_episodes: int = 1000) -> float:
    """Success of the hand-written attacker that sees two observations, in the training world."""
    episodes = rollout(ZombieAttackVectorEnv(num_episodes), TwoStepAttacker(), num_episodes, seed=WORLDS + seed)
    return _rate(episodes, "attack")
