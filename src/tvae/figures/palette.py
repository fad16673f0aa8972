"""Colours and markers of playstyles, told apart also by colour-blind eyes and in black-and-white print.

The hues are those of Okabe and Ito ("Color Universal Design", 2008) without black and yellow, which vanish on
a dark and on a light page. A style has its own marker besides, so no colour ever carries a meaning alone.

>>> style_colour(0), style_marker(0)
('#0072b2', 'o')
>>> len({(style_colour(k), style_marker(k)) for k in range(42)})
42
"""

from __future__ import annotations

STYLE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
STYLE_MARKERS = ("o", "^", "s", "D", "v", "P", "X")

INK = "#1d2126"
"""Text and whatever matters most."""
MUTED = "#6b7178"
"""Axes, captions, and whatever matters less."""
RULE = "#d9dbde"
"""Hairlines."""
PAPER = "#ffffff"
"""Behind everything."""
ALERT = "#b3261e"
"""Failures, always with a word beside it."""


def style_colour(style: int) -> str:
    """The colour of style 0, 1, ..."""
    return STYLE_COLOURS[style % len(STYLE_COLOURS)]


def style_marker(style: int) -> str:
    """The matplotlib marker of style 0, 1, ..."""
    return STYLE_MARKERS[style % len(STYLE_MARKERS)]
