"""How Sphinx makes the site: `make docs`. It opens from disk, and loads nothing from anywhere else."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
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

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "fieldlist"]
myst_heading_anchors = 4
html_math_renderer = "mathml"

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
    """Docstrings show tables and formulas as Markdown does: `|` cells and blocks that are indented by four."""
    told: list[str] = []
    for index, line in enumerate(lines):
        if re.match(r"\|-", line):
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
            told.append(line)
    lines[:] = told


def inline_math(writer: HTML5Translator, node: nodes.math) -> None:
    """MathML, which browsers draw by themselves."""
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def block_math(writer: HTML5Translator, node: nodes.math_block) -> None:
    """The same on lines of its own."""
    writer.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", within_the_site)
    app.connect("autodoc-process-docstring", as_rst)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
