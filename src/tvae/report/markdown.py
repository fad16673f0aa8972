"""Text from data on a Markdown page, where none of it is to be a mark, a tag or a link."""

from __future__ import annotations

import html
import re

_MARKS = re.compile(r"[\\`*_{}\[\]#!|~$@]|:(?=\S)|(?<!\d)\.(?=\S)")
_MARK_AT_START = re.compile(r"^(\d*)([-+=.)])(?=[-=\s]|$)")


class Markdown(str):
    """What is Markdown already."""

    __slots__ = ()


def escaped(text: object) -> str:
    """One line of Markdown that shows the text as it is; `Markdown` stays what it is.

    >>> print(escaped("x_1 | <b> at www.example.com, 2.5 *now*"))
    x\\_1 \\| &lt;b&gt; at www\\.example\\.com, 2.5 \\*now\\*
    """
    if isinstance(text, Markdown):
        return text
    line = _MARKS.sub(r"\\\g<0>", " ".join(str(text).split()))
    return html.escape(_MARK_AT_START.sub(r"\1\\\2", line), quote=False)


def fenced(text: str, language: str = "") -> Markdown:
    """A block that shows the text as code.

    >>> print(fenced("tvae fit sessions.csv"))
    ```
    tvae fit sessions.csv
    ```
    """
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    return Markdown(f"{fence}{language}\n{text}\n{fence}")
