"""Colour in the terminal: when there is any, and what it marks."""

from __future__ import annotations

import os
import re
import sys
from typing import TextIO

GOOD, BAD, HEAD, RULE = "32", "31", "1", "2"
"""Green, red, bold, faint: what is as it should be, what is not, headings, and lines between."""
_ESCAPES = re.compile(r"\x1b\[[\d;]*m")


class Cell(str):
    """Text of a table's cell that is coloured where there is colour."""

    tone: str = ""
    """GOOD or BAD."""


def good(text: str) -> Cell:
    """Return a cell that says that something is as it should be."""
    return _cell(text, GOOD)


def bad(text: str) -> Cell:
    """Return a cell that says that something is not as it should be."""
    return _cell(text, BAD)


def _cell(text: str, tone: str) -> Cell:
    cell = Cell(text)
    cell.tone = tone
    return cell


def coloured(stream: TextIO | None) -> bool:
    """Whether what is written to `stream` has colour.

    NO_COLOR (https://no-color.org), set and not empty, forbids it; else FORCE_COLOR asks for it; else a terminal that
    is not TERM=dumb has it.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def paint(text: str, tone: str) -> str:
    """Return `text` in a colour, if there is colour on standard output and `tone` names one."""
    return f"\x1b[{tone}m{text}\x1b[0m" if tone and text and coloured(sys.stdout) else text


def visible(text: str) -> str:
    """Return `text` without what colours it."""
    return _ESCAPES.sub("", text)
