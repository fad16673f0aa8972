"""What the policy is told while it learns alone: z of styles, as bots get it, if nothing is lost by that."""

from __future__ import annotations

from tvae.data.batches import evenly
from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.playstyles import find_playstyles
from tvae.model.tvae import TrajectoryVAE
from tvae.train.latents import OfEpisodes, OfStyles
from tvae.train.loop import Observer, copy_of_weights
from tvae.train.memory import is_lossless
from tvae.train.policy import Lessons, log_likelihoods, train_policy

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

    Where z holds a style and little else, what it does hold of each episode is about the world, and a policy that was
    told it is misled when a bot acts elsewhere. So the policy is first told z of any episode of the same style. That
    is kept unless held-out actions are thereby clearly less likely than they were before, each at z of its own episode
    (`tvae.train.memory.is_lossless`): then z holds more than the style of how to act, such as the goal of a walk, and
    the policy learns anew from z of each episode itself. Either way the weights are kept under which held-out actions
    are most likely, and these may be those from before.
    """

    def further(lessons: Lessons, judged: Lessons) -> None:
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

    training, held_out = evenly(training, _MOST_STEPS), evenly(held_out, _MOST_JUDGED_STEPS)
    theirs, others = encode(model, training), encode(model, held_out)
    of_episodes = Lessons(held_out, OfEpisodes(others.means, others.scales))
    before, weights = log_likelihoods(model, of_episodes, seed=seed), copy_of_weights(model)
    styles = find_playstyles(theirs, seed=seed)
    of_styles = Lessons(held_out, OfStyles(styles.styles, styles.assign(others)[0]))
    further(Lessons(training, OfStyles(styles.styles, styles.assignment)), of_styles)
    after = log_likelihoods(model, of_styles, seed=seed)
    if is_lossless(after - before, held_out.lengths):
        observer.on_note("The policy learnt alone from z of the styles, as its bots get it.")
        return
    model.load_state_dict(weights)
    observer.on_note("z holds more than styles of how to act: the policy learnt alone from z of each episode.")
    further(Lessons(training, OfEpisodes(theirs.means, theirs.scales)), of_episodes)
