"""How people share the ring: what z says of whole pairs that the model has not seen, and bots that go their way.

    pip install ".[overcooked]"
    python scripts/overcooked_laps.py --out results/overcooked --seeds 5

With the configuration of `tvae demo overcooked`, but trained to the end on all that a fold has, since nothing is held
out beside it:

- seven folds leave two or three whole pairs out, an eighth the only pair that goes round counter-clockwise. Encoder,
  styles and probe see the others alone. Measured on the segments of 200 steps that are left out: R2 of a ridge
  regression that tells net laps from the mean of z, and from a sample of it, its penalty chosen by leaving pairs of the
  training out; and the adjusted Rand index of the found styles, each called what most of its training segments do,
  against what the segments do (clockwise, counter-clockwise, or none where net laps are below 2 either way);
- a model of all pairs; 100 games of 400 steps of a bot for each thing that its styles do: net laps and soups. As the
  bound leaves the policy, with sampled actions (`bound`); after 2,000 steps of the policy alone (`alone`); then with
  the temperature 0.7 (`cooler`), and `Restless` too (`restless`), which also plays games of 1,200 steps (`whole`), as
  long as people's, given as in 400 steps. The policy's nets are twice as wide here as in `tvae demo overcooked`;
- what people of these styles do in 400 steps: of their whole games (`whole`), and of their first 400 (`beginning`); and
  how many of their segments do what the style is called. A game begins with empty pots, so that the first soup takes
  its time: bots' games compare with people's first 400.

Each part is a file under OUT/parts, beside the models of the bots, and skipped when it is there. Of a fold it holds
what the encoder says of each segment, so that styles and probe are made again each time, without training.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray
from sklearn.linear_model import RidgeCV
from sklearn.metrics import adjusted_rand_score, r2_score
from sklearn.model_selection import LeaveOneGroupOut
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tvae.config import RunConfig
from tvae.data.demonstrations import Demonstrations
from tvae.device import resolve_device
from tvae.envs.overcooked import SOUP_REWARD, OvercookedEnv, net_laps
from tvae.evaluate.encoding import Posteriors, encode
from tvae.evaluate.over_seeds import over_seeds
from tvae.evaluate.playstyles import find_playstyles
from tvae.evaluate.styles import AnyStyle, Playstyles
from tvae.experiments.fitting import amounts_of, schedule_of
from tvae.experiments.tasks import overcooked
from tvae.files import appearing
from tvae.fitting.fit import new_model
from tvae.generate.closed_loop import LatentPolicy
from tvae.generate.restless import Restless
from tvae.model.decoding import Tempered
from tvae.model.tvae import TrajectoryVAE
from tvae.rollouts import Policy, rollout
from tvae.spaces import FloatArray, IntArray
from tvae.train.latents import OfStyles
from tvae.train.loop import evaluate, train
from tvae.train.policy import Lessons, train_policy

ALONE = "19"
"""The only pair that goes round counter-clockwise."""
FOLDS = 7
NAMES = {1: "clockwise", -1: "counter-clockwise", 0: "none"}
PENALTIES = np.logspace(-1, 3, 9)
GAMES, STEPS, WHOLE, LAPS = 100, 400, 1_200, 4
SEGMENT, STRIDE = 200, 50
"""Of `tvae.experiments.tasks.overcooked`."""
POLICY_FEATURES, POLICY_STEPS, POLICY_RATE, TEMPERATURE = 256, 2_000, 3e-3, 0.7


def does(laps: FloatArray) -> IntArray:
    """1 clockwise, -1 counter-clockwise, 0 for fewer than 2 net laps."""
    return np.where(np.abs(laps) < 2, 0, np.sign(laps)).astype(np.int64)


def of_pairs(demonstrations: Demonstrations, pairs: Sequence[str], *, left_out: bool) -> Demonstrations:
    """The episodes of these pairs, or of all others."""
    theirs = np.isin(demonstrations.attributes["pair"].astype(str), pairs)
    return demonstrations.select(np.flatnonzero(theirs == left_out))


def judged(demonstrations: Demonstrations) -> Demonstrations:
    """Segments that neither overlap nor come twice: what is measured."""
    once = ~demonstrations.attributes["exchanged"] & (demonstrations.attributes["segment"] % 4 == 0)
    return demonstrations.select(np.flatnonzero(once))


def fitted(demonstrations: Demonstrations, config: RunConfig, device: str) -> TrajectoryVAE:
    """The model of a configuration, trained to the end on all of the demonstrations."""
    settings, amounts = config.training, amounts_of(config, demonstrations)
    model = new_model(demonstrations, seed=config.seed, device=device, **vars(config.model))
    train(
        model,
        demonstrations,
        judged(demonstrations),
        schedule=schedule_of(settings),
        num_steps=amounts.num_steps,
        batch_size=amounts.batch_size,
        learning_rate=settings.learning_rate,
        state_weight=settings.state_weight,
        evaluate_every=amounts.num_steps,
        seed=config.seed,
    )
    return model


def told(known: FloatArray, laps: FloatArray, pairs: NDArray[Any], asked: FloatArray) -> FloatArray:
    """Net laps told from z by ridge regression."""
    folds = list(LeaveOneGroupOut().split(known, laps, pairs))
    found: FloatArray = make_pipeline(StandardScaler(), RidgeCV(PENALTIES, cv=folds)).fit(known, laps).predict(asked)
    return found


def names_of(playstyles: Playstyles, laps: FloatArray) -> list[int]:
    """What most of the segments of each style do."""
    labels = does(laps)
    return [
        int(np.bincount(labels[playstyles.assignment == style.index] + 1, minlength=3).argmax()) - 1
        for style in playstyles.styles
    ]


def fold(pairs: list[str], *, seed: int, device: str) -> dict[str, NDArray[Any]]:
    """What a model that has not seen these pairs says of segments of the others, `known`, and of theirs, `asked`."""
    recipe = overcooked(None, seed)
    demonstrations = recipe.demonstrations()
    seen, others = (of_pairs(demonstrations, pairs, left_out=left_out) for left_out in (False, True))
    model = fitted(seen, recipe.config, device)
    found: dict[str, NDArray[Any]] = {"kl": np.array(evaluate(model, judged(seen)).kl)}
    for name, some in (("known", judged(seen)), ("asked", judged(others))):
        posteriors = encode(model, some)
        found |= {
            f"{name}.means": posteriors.means,
            f"{name}.scales": posteriors.scales,
            f"{name}.laps": net_laps(some),
            f"{name}.pairs": some.attributes["pair"].astype(str),
        }
    return found


def judgement(found: Mapping[str, NDArray[Any]], seed: int) -> dict[str, Any]:
    """What styles and a probe that have seen what is known say of what is asked."""
    known, asked = (Posteriors(found[f"{name}.means"], found[f"{name}.scales"]) for name in ("known", "asked"))
    laps, groups, random = found["known.laps"], found["known.pairs"], np.random.default_rng(seed)
    playstyles = find_playstyles(known, seed=seed)
    names, (style, _) = names_of(playstyles, laps), playstyles.assign(asked)
    return {
        "pairs": sorted(set(found["asked.pairs"].tolist())),
        "laps": found["asked.laps"],
        "from_mean": told(known.means, laps, groups, asked.means),
        "from_sample": told(known.sample(random), laps, groups, asked.sample(random)),
        "named": [names[index] for index in style],
        "styles": len(names),
        "kl": float(found["kl"]),
    }


def soups(episodes: Demonstrations) -> FloatArray:
    """(E,) delivered in each episode."""
    return np.array([episode.steps["reward"].sum() / SOUP_REWARD for episode in episodes])


def stored(home: Path, train: Callable[[], TrajectoryVAE]) -> TrajectoryVAE:
    """The model that is there, or one that is trained and put there."""
    if not home.exists():
        train().save(home)
    return TrajectoryVAE.load(home)


def bots(home: Path, *, seed: int, device: str) -> dict[str, Any]:
    """Games of the bots of a model of all pairs, which lies at `home`, one for each thing that the found styles do."""
    recipe = overcooked(None, seed)
    demonstrations = recipe.demonstrations()
    wide = replace(recipe.config, model=replace(recipe.config.model, policy_features=POLICY_FEATURES))
    bound = stored(home / "bound", partial(fitted, demonstrations, wide, device))
    people = judged(demonstrations)
    playstyles = find_playstyles(encode(bound, people), seed=seed)
    names = np.array(names_of(playstyles, net_laps(people)))

    def taught() -> TrajectoryVAE:
        model = TrajectoryVAE.load(home / "bound").to(resolve_device(device))
        assignment, _ = playstyles.assign(encode(model, demonstrations))
        lessons = Lessons(demonstrations, OfStyles(playstyles.styles, assignment))
        train_policy(model, lessons, num_steps=POLICY_STEPS, learning_rate=POLICY_RATE, seed=seed)
        return model

    alone = stored(home / "alone", taught)
    found: dict[str, Any] = {}
    for name in sorted(set(names.tolist()), reverse=True):
        z = AnyStyle([style for style, does_this in zip(playstyles.styles, names == name, strict=True) if does_this])
        restless = Restless(alone, z, demonstrations, temperature=TEMPERATURE)
        policies = {
            "bound": LatentPolicy(bound, z),
            "alone": LatentPolicy(alone, z),
            "cooler": LatentPolicy(alone, z, choice=Tempered(TEMPERATURE)),
            "restless": restless,
        }
        found[NAMES[name]] = {
            "people": of_people(people.select(np.flatnonzero(names[playstyles.assignment] == name)), name),
            **{way: games(policy, name, STEPS, seed) for way, policy in policies.items()},
            "whole": games(restless, name, WHOLE, seed),
        }
    return found


def in_a_game(values: FloatArray, lengths: IntArray) -> float:
    """What there is of something in 400 steps."""
    return float(values.sum() * STEPS / lengths.sum())


def of_people(theirs: Demonstrations, name: int) -> dict[str, Any]:
    """What people of these styles do: how many of their segments what the styles are called, net laps and soups.

    The last two in 400 steps, of their whole games and of the first 400 of them.
    """
    first = theirs.attributes["segment"] * STRIDE <= STEPS - SEGMENT
    parts = {"whole": theirs, "beginning": theirs.select(np.flatnonzero(first))}
    return {
        part: {
            "segments": len(some),
            "as_asked": float((does(net_laps(some)) == name).mean()),
            "laps": in_a_game(net_laps(some), some.lengths),
            "soups": in_a_game(soups(some), some.lengths),
        }
        for part, some in parts.items()
        if len(some)
    }


def games(policy: Policy, name: int, steps: int, seed: int) -> dict[str, float]:
    """What comes of games of a bot that is to do this: net laps and soups in 400 steps, and how often it did it."""
    envs = SyncVectorEnv([partial(OvercookedEnv, "coordination_ring", steps)] * 50)
    try:
        episodes = rollout(envs, policy, GAMES, seed=seed)
    finally:
        envs.close()
    laps = net_laps(episodes) * STEPS / steps
    reached = np.abs(laps) < LAPS if name == 0 else name * laps >= LAPS
    return {
        "as_asked": float(reached.mean()),
        "laps": float(laps.mean()),
        "soups": in_a_game(soups(episodes), episodes.lengths),
    }


def make_fold(path: Path, pairs: list[str], seed: int, device: str) -> None:
    """One fold, into a file."""
    torch.set_num_threads(1)
    found = fold(pairs, seed=seed, device=device)
    path.parent.mkdir(parents=True, exist_ok=True)
    with appearing(path) as partial_path, partial_path.open("wb") as file:
        np.savez_compressed(file, **found)
    print(path, flush=True)


def make_bots(path: Path, seed: int, device: str) -> None:
    """The games of the bots of a seed, into a file."""
    torch.set_num_threads(1)
    path.parent.mkdir(parents=True, exist_ok=True)
    found = bots(path.parent, seed=seed, device=device)
    with appearing(path) as partial_path:
        partial_path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    print(path, flush=True)


def summary(folds: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The numbers of all folds together, and those of the pair that is alone apart."""
    found: dict[str, Any] = {}
    for name, chosen in (
        ("left_out", [fold for fold in folds if fold["pairs"] != [ALONE]]),
        ("counter_clockwise", [fold for fold in folds if fold["pairs"] == [ALONE]]),
    ):
        laps, mean, sample, named = (
            np.concatenate([fold[key] for fold in chosen]) for key in ("laps", "from_mean", "from_sample", "named")
        )
        found[name] = {
            "segments": len(laps),
            "kl": float(np.mean([fold["kl"] for fold in chosen])),
            "styles": float(np.mean([fold["styles"] for fold in chosen])),
            "root_mean_square_error": float(np.sqrt(np.mean((mean - laps) ** 2))),
            "named_rightly": float((named == does(laps)).mean()),
        }
        if name == "left_out":
            found[name] |= {
                "r2_mean": float(r2_score(laps, mean)),
                "r2_sample": float(r2_score(laps, sample)),
                "ari": float(adjusted_rand_score(does(laps), named)),
            }
    return found


def of_seed(home: Path, seed: int) -> dict[str, Any]:
    """The numbers of a seed, from its files."""
    folds = []
    for path in sorted(home.glob("fold-*.npz")):
        with np.load(path) as found:
            folds.append(judgement(found, seed))
    return {**summary(folds), "bots": json.loads((home / "bots.json").read_text(encoding="utf-8"))}


def main() -> None:
    """All parts that are not there yet, then their numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/overcooked"))
    parser.add_argument("--jobs", type=int, default=2, help="processes, one core each")
    parser.add_argument("--seeds", type=int, default=1, help="how many, from 0 on")
    parser.add_argument("--device", default="cpu", help="as in tvae fit: auto, cpu, cuda, mps")
    asked = parser.parse_args()
    pairs = sorted({str(pair) for pair in overcooked(None, 0).demonstrations().attributes["pair"]} - {ALONE}, key=int)
    shuffled = np.random.default_rng(7).permutation(pairs)
    folds = {"fold-0": [ALONE]} | {
        f"fold-{index + 1}": [str(pair) for pair in some] for index, some in enumerate(np.array_split(shuffled, FOLDS))
    }
    homes = [asked.out / "parts" / f"seed-{seed}" for seed in range(asked.seeds)]
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as workers:
        waiting = []
        for seed, home in enumerate(homes):
            if not (path := home / "bots.json").exists():
                waiting.append(workers.submit(make_bots, path, seed, asked.device))
            for name, some in folds.items():
                if not (path := home / f"{name}.npz").exists():
                    waiting.append(workers.submit(make_fold, path, some, seed, asked.device))
        for done in waiting:
            done.result()
    found = over_seeds([of_seed(home, seed) for seed, home in enumerate(homes)])
    with appearing(asked.out / "metrics.json", overwrite=True) as partial_path:
        partial_path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
