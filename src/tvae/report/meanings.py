"""What each number of a run means, in a few words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

MEANINGS = {
    "playstyles.num_found": "number of styles",
    "playstyles.ari": "adjusted Rand index of styles and labels: 1 is equal, 0 is chance",
    "active_units": "features of z that tell episodes apart",
    "nats_per_trajectory.held_out.policy": "log-likelihood of a held-out episode's actions, in nats",
    "nats_per_trajectory.held_out.state": "log-likelihood of its next states",
    "nats_per_trajectory.held_out.stop": "log-likelihood of where it ends",
    "nats_per_trajectory.held_out.kl": "nats that z holds of it: divergence of its posterior from the prior",
    "leakage.start_r2": "what z tells of the first observation within a style, as R2 of a prediction",
    "leakage.start_nats": "the same in nats",
    "held_out_likelihood.with_latent": "importance-weighted bound of a held-out episode, in nats",
    "held_out_likelihood.without_latent": "the same of the model trained again without z",
    "held_out_likelihood.difference": "what z gains in it",
}
"""Of what a model card shows, by the path in `metrics.json`."""
MEANINGS_OF_BOTS = {
    "success": "share of test episodes that succeed, actions drawn",
    "success_most_likely": "the same with the most likely actions",
    "style_consistency": "share of test episodes that the encoder tells as this style",
    "episode_length": "steps of a test episode",
    "return": "sum of rewards of a test episode",
}
MEANING_OF_A_MEASURE = "mean over test episodes, as the environment measures it"
_OTHERS = {
    "train_seconds": "wall clock of the training, in seconds",
    "train_steps": "gradient steps taken",
    "test_environment": "where the bots played",
    "test_episodes": "how many episodes each bot played",
    "playstyles.shares": "share of the sessions",
    "leakage.start_r2_from_mean": "as start_r2, from the mean of z instead of a sample, which is what a bot gets",
    "leakage.start_nats_from_mean": "as start_nats, from the mean of z",
    "nats_per_trajectory.held_out.ahead": "log-likelihood of its states further ahead, of a model with a horizon",
    "nats_per_trajectory.training": "as for a held-out episode, of those that were learnt from",
}


def meaning(path: Sequence[str], metrics: Mapping[str, Any]) -> str:
    """What the number at this path of `metrics` means; empty where nothing more is known than its name.

    >>> meaning(("playstyles", "shares", "style 0"), {}), meaning(("success", "attack"), {"ci95": {"success": {}}})
    ('share of the sessions', 'share of test episodes that succeed, actions drawn')
    """
    known = MEANINGS | _OTHERS
    for depth in range(len(path), 0, -1):
        found = known.get(".".join(path[:depth]))
        if found is not None:
            return found
    of_bots = metrics.get("ci95")
    if path[0] in MEANINGS_OF_BOTS or (isinstance(of_bots, Mapping) and path[0] in of_bots):
        return MEANINGS_OF_BOTS.get(path[0], MEANING_OF_A_MEASURE)
    return ""
