"""How much is trained where nothing is asked: what the demonstrations say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tvae.data.batches import suitable_batch_size
from tvae.model.arguments import counted
from tvae.spaces import IntArray

_PASSES = 60
_FEWEST_STEPS, _MOST_STEPS = 2_200, 6_000
_MOST_POLICY_STEPS = 2_500


@dataclass(frozen=True)
class Amounts:
    """Of a training by the bound, and of the policy alone."""

    batch_size: int
    """Trajectories in a step of the bound's."""
    num_steps: int
    """By the bound, at most."""
    policy_steps: int
    """Of the policy alone."""

    @classmethod
    def of(
        cls, lengths: IntArray, *, batch_size: int | None, num_steps: int | None, policy_steps: int | None
    ) -> Amounts:
        """For training trajectories of these lengths (E,): what is asked, and where that is None what suits them.

        That is `suitable_batch_size` trajectories; 60 passes over all of them, but 2,200 steps at least and 6,000 at
        most; and as many steps of the policy alone, at most 2,500. Raises `ValueError` for numbers that cannot be.

        >>> Amounts.of(np.full(1_350, 100), batch_size=None, num_steps=None, policy_steps=None)
        Amounts(batch_size=32, num_steps=2531, policy_steps=2500)
        >>> Amounts.of(np.full(1_350, 100), batch_size=None, num_steps=40, policy_steps=None)
        Amounts(batch_size=32, num_steps=40, policy_steps=40)
        """
        batch_size = suitable_batch_size(lengths) if batch_size is None else counted("batch_size", batch_size)
        if num_steps is None:
            num_steps = int(np.clip(round(_PASSES * len(lengths) / batch_size), _FEWEST_STEPS, _MOST_STEPS))
        num_steps = counted("num_steps", num_steps)
        if policy_steps is None:
            policy_steps = min(num_steps, _MOST_POLICY_STEPS)
        return cls(batch_size, num_steps, counted("policy_steps", policy_steps, least=0))
