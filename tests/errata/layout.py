"""Pieces the page is laid out with: numbers, tables, wrapped text, and the comparison of two pages."""

from __future__ import annotations

import re
import textwrap


def num(x: float) -> str:
    """Three significant digits, always with a point: numbers with a point are compared with a tolerance."""
    return f"{x:#.3g}"


def table(head: str, rows: list[list[str]]) -> str:
    """A Markdown table; the column names in `head` are separated by |."""
    columns = [column.strip() for column in head.split("|")]
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def reflow(block: str) -> str:
    """Wrap a paragraph or a list at 110 columns; leave headings, tables and code alone."""
    if block.startswith(("#", "|", "```")):
        return block
    items = block.replace("\n* ", "\0* ").replace(" - ", " -\1").split("\0")  # a line must not begin with "- "
    return "\n".join(
        textwrap.fill(
            " ".join(item.split()),
            110,
            subsequent_indent="  " if item.startswith("* ") else "",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for item in items
    ).replace("\1", " ")


_NUMBER = re.compile(r"(\d+\.\d*(?:e[+-]?\d+)?)")


def differences(found: str, stored: str, relative: float = 0.01) -> list[str]:
    """Return the blocks in which two pages differ: words exactly, numbers with a point by more than `relative`.

    Inside code blocks everything counts; elsewhere it does not matter where a line is broken.
    """
    first, second = found.strip().split("\n\n"), stored.strip().split("\n\n")
    if len(first) != len(second):
        return [f"{len(first)} blocks computed, {len(second)} stored"]
    return [
        f"computed: {mine}\nstored:   {theirs}"
        for mine, theirs in zip(first, second, strict=True)
        if not (mine == theirs if mine.startswith("```") else _alike(mine, theirs, relative))
    ]


def _alike(mine: str, theirs: str, relative: float) -> bool:
    a, b = (_NUMBER.split(" ".join(block.split())) for block in (mine, theirs))
    if a[::2] != b[::2]:
        return False
    pairs = [(float(x), float(y)) for x, y in zip(a[1::2], b[1::2], strict=True)]
    return all(abs(x - y) <= relative * max(abs(x), abs(y)) for x, y in pairs)
