"""Syntax trees of Python source: one parser at a time, whatever the thread."""

from __future__ import annotations

import ast
import threading

_PARSING = threading.Lock()
"""Python 3.11 counts how deep it is in a tree for all threads together, and ends with a SystemError where two parse."""


def parse_python(text: str) -> ast.Module:
    """Return the syntax tree of a file's text.

    Raises:
        SyntaxError: it is not Python.
    """
    with _PARSING:
        return ast.parse(text)
