"""What is trained for each of the paper's tasks: our default, the paper's own reading, and what they are compared with.

`paper` is the most faithful reading of what survives of the paper: z in two dimensions with the prior N(0, I),
decoders that are an LSTM over [s_t; z] and a linear head, whole trajectories, the plain evidence lower bound with
beta = 1, no term for the end of an episode. Sizes, optimiser and number of demonstrations were never given; sizes and
demonstrations are those of our default, and Adam takes 3,000 steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tvae.config import ModelConfig, RunConfig, TrainingConfig

EVIDENCE = ((0.0, 1.0),)
"""beta = 1 throughout."""

_NAVIGATION = RunConfig(
    model=ModelConfig(window=4, action_components=2),
    training=TrainingConfig(num_steps=6_000, batch_size=32, learning_rate=1e-2, kl_points=EVIDENCE),
)
_CIRCLE = RunConfig(
    model=ModelConfig(window=4, stop=False),
    training=TrainingConfig(num_steps=3_500, batch_size=32, learning_rate=1e-2, kl_points=EVIDENCE),
)
_ZOMBIE = RunConfig()


def _as_the_paper(config: RunConfig) -> RunConfig:
    return replace(
        config,
        model=replace(
            config.model, prior_components=1, action_components=1, window=None, stop=False, reactive=False
        ),
        training=replace(config.training, num_steps=3_000, learning_rate=5e-3, kl_points=EVIDENCE),
    )


def _behavioural_cloning(config: RunConfig, window: int | None) -> RunConfig:
    """A policy decoder without z, trained on actions alone; its laws are mixtures of three, one for each style."""
    return replace(
        config,
        model=replace(config.model, latent_features=0, action_components=3, stop=False, window=window),
        training=replace(
            config.training, num_steps=2_000, learning_rate=5e-3, state_weight=0.0, kl_points=EVIDENCE
        ),
    )


DEFAULT: Mapping[str, RunConfig] = {"navigation": _NAVIGATION, "circle": _CIRCLE, "zombie": _ZOMBIE}

PRESETS: Mapping[str, Mapping[str, RunConfig]] = {
    task: {"default": config, "paper": _as_the_paper(config)} for task, config in DEFAULT.items()
}
"""By task and name: the two that a reproduction is about."""

BESIDE: Mapping[str, Mapping[str, RunConfig]] = {
    "navigation": {
        "cloning_lstm": _behavioural_cloning(_NAVIGATION, None),
        "cloning_memoryless": _behavioural_cloning(_NAVIGATION, 1),
    },
    "circle": {
        "cloning_lstm": _behavioural_cloning(_CIRCLE, None),
        "cloning_memoryless": _behavioural_cloning(_CIRCLE, 1),
    },
    "zombie": {"windows": replace(_ZOMBIE, model=replace(_ZOMBIE.model, window=8))},
}
"""What a figure shows beside them: behavioural cloning (errors by horizon), training on windows (figure 8)."""

ABLATIONS: Mapping[str, Mapping[str, RunConfig]] = {
    "navigation": {},
    "circle": {},
    "zombie": {
        "no_state_decoder": replace(
            _ZOMBIE,
            model=replace(_ZOMBIE.model, stop=False),
            training=replace(_ZOMBIE.training, state_weight=0.0),
        ),
        "no_actions_in_encoder": replace(_ZOMBIE, model=replace(_ZOMBIE.model, encode_actions=False)),
        "dynamics": replace(_ZOMBIE, model=replace(_ZOMBIE.model, dynamics=True)),
        "one_gaussian_prior": replace(_ZOMBIE, model=replace(_ZOMBIE.model, prior_components=1)),
        "plain_decoders": replace(_ZOMBIE, model=replace(_ZOMBIE.model, reactive=False)),
    },
}
"""One thing changed in our default at a time; the term of the end goes with the state decoder, which it reads."""
