"""How Sphinx makes the site: `make docs`. It opens from disk, and loads nothing from anywhere else."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from matplotlib.path import Path as Path2D
from matplotlib.textpath import TextPath
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import tvae

project = "T-VAE"
author = "The T-VAE authors"
release = version = tvae.__version__
html_title = f"T-VAE {version}"
html_theme = "furo"
html_copy_source = False
html_show_copyright = False
html_static_path = ["site"]
html_css_files = ["site.css"]
exclude_patterns = ["site"]

extensions = ["myst_parser", "sphinx.ext.autodoc"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_math_renderer = "drawn"

default_role = "py:obj"
toc_object_entries_show_parents = "hide"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
autodoc_type_aliases = {name: name for name in ("FloatArray", "IntArray", "Attribute", "Choice", "Signal")}
python_use_unqualified_type_names = True


def within_the_site(app: Sphinx, page: str, source: list[str]) -> None:
    """Links to what lies beside `docs`: files come along as downloads, directories are named."""

    def written(link: re.Match[str]) -> str:
        text, target = link.groups()
        inside = (Path(app.srcdir) / page).parent / target
        return text if inside.is_dir() else f"{{download}}`{text} <{target}>`"

    source[0] = re.sub(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+(?:results|examples)[^)#]*)\)", written, source[0])


def as_rst(app: Sphinx, what: str, name: str, found: object, options: Any, lines: list[str]) -> None:
    """Docstrings have tables and formulas as Markdown does, `|` cells and blocks indented by four, and `Args:`."""
    told: list[str] = []
    for index, line in enumerate(lines):
        argument = re.match(r" {4}([a-z_, ]+): (.*)", line)
        if re.match(r"\|-|Args:$", line):
            continue
        if argument and "Args:" in lines[:index]:
            told += [f":param {name}: {argument[2]}" for name in argument[1].split(", ")]
            continue
        if line.startswith("|"):
            if not told or not told[-1].startswith("     "):
                told += [".. list-table::", "   :header-rows: 1", ""]
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            told += [f"   {'* -' if cell == 0 else '  -'} {text}" for cell, text in enumerate(cells)]
        else:
            begins = line.startswith("    ") and index and not lines[index - 1].strip()
            if begins and told and not next((past for past in reversed(told) if past.strip()), "").startswith(" "):
                told += ["::", ""]
            told.append(line if line.startswith((" ", ">>>")) else line.replace("|", r"\|"))
    lines[:] = told


def drawn(tex: str) -> str:
    """A formula as SVG in the colour of the text, drawn by Matplotlib: no script and no font is needed to read it."""
    path = TextPath((0, 0), f"${' '.join(tex.split())}$", size=10)
    box = path.get_extents().padded(0.5)
    letters = {Path2D.MOVETO: "M", Path2D.LINETO: "L", Path2D.CURVE3: "Q", Path2D.CURVE4: "C", Path2D.CLOSEPOLY: "Z"}
    parts = []
    for points, code in path.iter_segments(simplify=False, curves=True):
        places = points.reshape(-1, 2) if code != Path2D.CLOSEPOLY else []
        parts.append(letters[code] + " ".join(f"{x:.2f},{-y:.2f}" for x, y in places))
    return (
        f'<svg class="formula" role="img" aria-label="{escape(tex)}" '
        f'viewBox="{box.x0:.2f} {-box.y1:.2f} {box.width:.2f} {box.height:.2f}" '
        f'style="width: {box.width / 10:.2f}em; height: {box.height / 10:.2f}em; vertical-align: {box.y0 / 10:.2f}em">'
        f'<path fill="currentColor" d="{"".join(parts)}"/></svg>'
    )


def inline_math(writer: HTML5Translator, node: nodes.math) -> None:
    """A formula in a line of text."""
    writer.body.append(drawn(node.astext()))
    raise nodes.SkipNode


def block_math(writer: HTML5Translator, node: nodes.math_block) -> None:
    """A formula on lines of its own."""
    writer.body.append(f'<div class="math">{drawn(node.astext())}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", within_the_site)
    app.connect("autodoc-process-docstring", as_rst)
    app.add_html_math_renderer("drawn", (inline_math, None), (block_math, None))
