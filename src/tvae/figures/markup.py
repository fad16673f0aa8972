"""A figure as a small piece of SVG for a web page, in the page's own font and colours.

matplotlib's own SVG is a document; many of them in one page repeat each other's ids and weigh ten times as
much. The house's inks become the page's variables (`--ink`, `--muted`, `--rule`, `--paper`, `--alert`,
`--style-0`, ...), so that one picture serves a light and a dark page.
"""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backend_bases import GraphicsContextBase, RendererBase
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.image import imsave
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Affine2D, Transform

from tvae.figures.palette import ALERT, INK, MUTED, PAPER, RULE, STYLE_COLOURS

_INKS = {INK: "ink", MUTED: "muted", RULE: "rule", PAPER: "paper", ALERT: "alert", "#000000": "ink"} | {
    colour: f"style-{index}" for index, colour in enumerate(STYLE_COLOURS)
}
_COMMANDS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}
_ANCHORS = {"left": "start", "center": "middle", "right": "end"}


def to_markup(figure: Figure, label: str, only: Sequence[Artist] | None = None) -> str:
    """The figure, or `only` these artists of it, as one `<svg>` element whose coordinates are points.

    `label` says in words what it shows; an empty one hides it from those who listen. The page's background
    shows through. Filled shapes are not cut where their axes end.

    >>> from tvae.figures.canvas import new_figure
    >>> figure = new_figure(1, 1)
    >>> _ = figure.text(0.5, 0.5, "a < b", color=INK)
    >>> to_markup(figure, 'a "sum"')[:77]
    '<svg viewBox="0 0 72 72" role="img" aria-label="a &quot;sum&quot;"><text x="3'
    """
    if figure.dpi != 72:
        figure.set_dpi(72)
    figure.patch.set_visible(False)
    width, height = (float(size) for size in figure.bbox.size)
    renderer = _Renderer(width, height)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)  # the page's fonts may have it
        for artist in [figure] if only is None else sorted(only, key=Artist.get_zorder):
            artist.draw(renderer)
    shapes = "".join(renderer.shapes)
    role = f'role="img" aria-label="{escape(label)}"' if label else 'aria-hidden="true"'
    return f'<svg viewBox="0 0 {width:g} {height:g}" {role}>{shapes}</svg>'


def _colour(rgba: Any) -> str:
    code = to_hex(rgba[:3])
    return f"var(--{_INKS[code]},{code})" if code in _INKS else code


def _number(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


class _Renderer(RendererBase):
    """Collects SVG elements while a figure draws itself."""

    def __init__(self, width: float, height: float) -> None:
        super().__init__()
        self.shapes: list[str] = []
        self.size = width, height

    def get_canvas_width_height(self) -> tuple[float, float]:
        return self.size

    def _outline(self, path: Path, transform: Transform, gc: GraphicsContextBase, *, filled: bool) -> str:
        """The `d` of a path; a line is cut where its axes end."""
        height = self.size[1]
        rectangle = gc.get_clip_rectangle()
        clip = None if rectangle is None or filled else rectangle.extents
        words = []
        for vertices, code in path.iter_segments(transform, clip=clip):
            if code == Path.CLOSEPOLY:
                words.append("Z")
                continue
            pairs = np.asarray(vertices, dtype=float).reshape(-1, 2)
            words.append(_COMMANDS[code] + " ".join(f"{_number(x)},{_number(height - y)}" for x, y in pairs))
        return "".join(words)

    def _style(self, gc: GraphicsContextBase, face: Any) -> str:
        forced = gc.get_forced_alpha()
        stroke, width = gc.get_rgb(), gc.get_linewidth()
        properties = [f"fill:{'none' if face is None else _colour(face)}"]
        opacity = gc.get_alpha() if forced or face is None or len(face) < 4 else face[3]
        if face is not None and opacity < 1:
            properties.append(f"fill-opacity:{opacity:.2g}")
        if width > 0 and (len(stroke) < 4 or stroke[3] > 0):
            properties.append(f"stroke:{_colour(stroke)};stroke-width:{width:.2g}")
            alpha = gc.get_alpha() if forced or len(stroke) < 4 else stroke[3]
            if alpha < 1:
                properties.append(f"stroke-opacity:{alpha:.2g}")
            dashes = gc.get_dashes()[1]
            if dashes is not None:
                properties.append("stroke-dasharray:" + " ".join(_number(d) for d in np.asarray(dashes, float)))
        return ";".join(properties)

    def _add(self, outline: str, gc: GraphicsContextBase, face: Any) -> None:
        if outline:
            self.shapes.append(f'<path style="{self._style(gc, face)}" d="{outline}"/>')

    def draw_path(self, gc: GraphicsContextBase, path: Path, transform: Transform, rgbFace: Any = None) -> None:
        face = rgbFace if rgbFace is not None and (len(rgbFace) < 4 or rgbFace[3] > 0) else None
        self._add(self._outline(path, transform, gc, filled=face is not None), gc, face)

    def draw_markers(
        self,
        gc: GraphicsContextBase,
        marker_path: Path,
        marker_trans: Transform,
        path: Path,
        trans: Transform,
        rgbFace: Any = None,
    ) -> None:
        places = np.array([vertices[-2:] for vertices, _ in path.iter_segments(trans, simplify=False)])
        outlines = [
            self._outline(marker_path, marker_trans + Affine2D().translate(x, y), gc, filled=True)
            for x, y in places.reshape(-1, 2)
        ]
        self._add("".join(outlines), gc, rgbFace)

    def draw_image(self, gc: GraphicsContextBase, x: float, y: float, im: Any, transform: Any = None) -> None:
        buffer = io.BytesIO()
        imsave(buffer, im[::-1], format="png")
        rows, columns = im.shape[:2]
        data = base64.b64encode(buffer.getvalue()).decode()
        place = f'x="{_number(x)}" y="{_number(self.size[1] - y - rows)}" width="{columns}" height="{rows}"'
        self.shapes.append(f'<image {place} href="data:image/png;base64,{data}"/>')

    def draw_text(
        self,
        gc: GraphicsContextBase,
        x: float,
        y: float,
        s: str,
        prop: FontProperties,
        angle: float,
        ismath: bool | str = False,
        mtext: Text | None = None,
    ) -> None:
        anchor = "start"
        if mtext is not None and angle == 0:
            x = float(mtext.get_transform().transform(mtext.get_unitless_position())[0])
            anchor = _ANCHORS[mtext.get_horizontalalignment()]
        turn = f' transform="rotate({-angle:g} {_number(x)} {_number(y)})"' if angle else ""
        self.shapes.append(
            f'<text x="{_number(x)}" y="{_number(y)}" text-anchor="{anchor}"{turn} '
            f'style="font-size:{prop.get_size_in_points():g}px;fill:{_colour(gc.get_rgb())}">{escape(s)}</text>'
        )
