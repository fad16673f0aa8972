"""The report as one self-contained HTML page: no network, no fonts, nothing beside it."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tvae.figures.palette import STYLE_COLOURS
from tvae.files import appearing
from tvae.report.content import ReportContent
from tvae.report.tables import number
from tvae.report.views import view


def render(content: ReportContent) -> str:
    """The page, all text in it escaped; the same content gives the same page."""
    environment = Environment(
        loader=PackageLoader("tvae", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    script = _resource("page.js")
    return environment.get_template("page.html").render(
        content=content,
        view=view(content),
        css=Markup(_resource("page.css")),
        script=Markup(script),
        script_digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        palette=[(colour, _lighter(colour)) for colour in STYLE_COLOURS],
    )


def write(content: ReportContent, path: Path) -> None:
    """Write the page, whole or not at all."""
    with appearing(path, overwrite=True) as partial:
        partial.write_text(render(content), encoding="utf-8")


def _resource(name: str) -> str:
    return (files("tvae.report") / name).read_text(encoding="utf-8")


def _lighter(colour: str) -> str:
    """The colour a third of the way to white, for a dark page."""
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{part + (255 - part) // 3:02x}" for part in parts)
