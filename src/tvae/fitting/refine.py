"""What the policy is told while it learns alone: z of styles, as bots get it, unless z holds more of how to act."""

from __future__ import annotations

from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.model.tvae import TrajectoryVAE
from tvae.train.latents import OfStyles
from tvae.train.observer import Observer
from tvae.train.policy import Lessons, log_likelihoods, train_policy

_WORTH = 0.5
"""Nats of an episode."""
_MOST_STEPS, _MOST_JUDGED_STEPS = 1_000_000, 20_000
"""Of demonstrations that are learnt from, and by which that is judged; of more, evenly spaced episodes."""


def refine_policy(
    model: TrajectoryVAE,
    training: Demonstrations,
    held_out: Demonstrations,
    *,
    num_steps: int,
    batch_size: int = 1_024,
    learning_rate: float = 5e-3,
    seed: int = 0,
    observer: Observer = Observer(),  # noqa: B008 - frozen
) -> None:
    """Train the policy decoder of `model` alone, in place, for `num_steps`, as its demonstrations allow.

    A bot's z is that of any episode of its style. So the policy is told such a z, if another episode's serves as well:
    where z holds a style and little else, what else it holds of an episode is about the world, and a policy that was
    told it is misled when a bot acts elsewhere. Where z holds more than the style of how to act, such as the goal of a
    walk, the policy would unlearn that, and is told z of each episode itself. Which it is, the policy as it is shows:

        d_i = log pi(a_1:T of trajectory i at z ~ q_k, k its style) - log pi(a_1:T of it at z ~ q(z | tau_i))

    over held-out trajectories, and it is the style where their mean is at least -0.5 nats. A style that falls into two
    halves which act differently in all would be worth ln 2.

    The weights are kept under which held-out actions are most likely, and these may be those from before.
    """
    training, held_out = evenly(training, _MOST_STEPS), evenly(held_out, _MOST_JUDGED_STEPS)
    theirs, others = encode(model, training), encode(model, held_out)
    styles = find_playstyles(theirs, seed=seed)
    assigned, _ = styles.assign(others)
    lessons = Lessons(training, OfStyles(styles.styles, styles.assignment))
    judged = Lessons(held_out, OfStyles(styles.styles, assigned))
    by_episode = Lessons(held_out, others)
    gained = log_likelihoods(model, judged, seed=seed) - log_likelihoods(model, by_episode, seed=seed)
    lost = f"with z of another one, an episode's actions lose {max(-gained.mean(), 0.0):.1f} nats"
    if gained.mean() < -_WORTH:
        observer.on_note(f"the policy learns further from z of each episode itself: {lost}")
        lessons, judged = Lessons(training, theirs), by_episode
    else:
        observer.on_note(f"the policy learns further from z of any episode of a style, as bots get it: {lost}")
    train_policy(
        model,
        lessons,
        judged,
        num_steps=num_steps,
        batch_size=batch_size,
        learning_rate=learning_rate,
        seed=seed,
        on_step=observer.on_policy_step,
    )
