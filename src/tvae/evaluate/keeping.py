"""Does what a bot did look, to the encoder, like the style that it was asked for?

A bot plays with z of a style, and its episodes are encoded as if a person had played them:

    consistency = share of the bot's episodes whose posterior mean is told as that style

It is 1 where z decides how the bot plays and the encoder reads the style off what was done, and lower where the bot
drifts into another style, or fails in ways that no demonstration shows.
"""

from __future__ import annotations

from tvae.data.demonstrations import Demonstrations
from tvae.evaluate.encoding import encode
from tvae.evaluate.styles import Playstyles, Style
from tvae.model.tvae import TrajectoryVAE


def style_consistency(
    model: TrajectoryVAE, playstyles: Playstyles, style: Style, episodes: Demonstrations
) -> float:
    """The share of `episodes`, played by the bot of `style`, that are told as that style.

    >>> import numpy as np
    >>> from tvae.evaluate.playstyles import find_playstyles
    >>> from tvae.data.trajectory import Trajectory
    >>> from tvae.spaces import Continuous, Space
    >>> x, dx = Space((Continuous("x"),)), Space((Continuous("dx"),))
    >>> walks = Demonstrations.from_trajectories([Trajectory(np.zeros((9, 1)), np.ones((8, 1)))] * 9, x, dx)
    >>> model = TrajectoryVAE(x, dx)
    >>> playstyles = find_playstyles(encode(model, walks))
    >>> style_consistency(model, playstyles, playstyles.styles[0], walks)
    1.0
    """
    told, _ = playstyles.assign(encode(model, episodes))
    return float((told == style.index).mean())
