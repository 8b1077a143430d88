"""What the user sees in the terminal: lines, tables, progress bars; and how much of it."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from torquebench.cli.colour import HEAD, RULE, Cell, paint, visible

LEAST = 28
"""Narrowest column that text is broken into."""


class Bar(Protocol):
    """A progress bar."""

    total: float | None
    """Number of units of work, when it is known."""

    def update(self, n: float | None = 1) -> bool | None:
        """Advance by `n`."""
        ...

    def set_description_str(self, desc: str | None = None, refresh: bool | None = True) -> None:
        """Say what is being done."""
        ...


@dataclass
class Voice:
    """How the running command speaks, and what it has told."""

    quiet: bool = False
    """Errors and nothing else."""
    as_json: bool = False
    """One JSON document on standard output instead of lines and tables."""
    facts: dict[str, Any] = field(default_factory=dict)
    """What the document says of this command."""
    remarks: list[str] = field(default_factory=list)
    """Warnings, in order."""


_VOICES = [Voice()]


@contextmanager
def speaking(quiet: bool, as_json: bool) -> Iterator[Voice]:
    """Speak in a voice of its own for as long as this context lasts, and yield the voice.

    Args:
        quiet: Errors and nothing else.
        as_json: One document instead of lines and tables.
    """
    _VOICES.append(Voice(quiet, as_json))
    try:
        yield _VOICES[-1]
    finally:
        _VOICES.pop()


def tell(**facts: Any) -> None:
    """Add to the document that ``--json`` prints: numbers as they are, paths, mappings, sequences, named tuples."""
    _VOICES[-1].facts.update(facts)


def say(text: str = "", fold: bool = True) -> None:
    """Write lines to standard output, if there is one and nobody asked for silence or for JSON.

    Args:
        text: One line or several.
        fold: Whether lines too long for the terminal are broken between words.
    """
    voice = _VOICES[-1]
    if not (voice.quiet or voice.as_json):
        emit("\n".join(_folded(line) for line in text.split("\n")) if fold else text)


def answer(text: str) -> None:
    """Write a line that the command was asked for, and needed while it goes on.

    It goes to standard output though ``--quiet`` was asked for; with ``--json``, whose document comes at the end and
    has standard output for itself, to standard error unless only errors are wanted there.
    """
    voice = _VOICES[-1]
    if not voice.as_json:
        emit(text)
    elif not voice.quiet:
        complain(text)


def emit(text: str) -> None:
    """Write a line to standard output, if there is one, whatever the voice."""
    if sys.stdout is not None:
        sys.stdout.write(text + "\n")


def warn(text: str) -> None:
    """Write a line to standard error that is no error, unless only errors are wanted."""
    voice = _VOICES[-1]
    voice.remarks.append(text)
    if not voice.quiet:
        complain(text)


def complain(text: str) -> None:
    """Write a line to standard error, if there is one that takes it: the exit status says the rest."""
    try:
        if sys.stderr is not None:
            sys.stderr.write(text + "\n")
            sys.stderr.flush()
    except OSError:
        sys.stderr = None


def width() -> int | None:
    """Return how many characters a line may have, None where standard output is no terminal."""
    if sys.stdout is None or not sys.stdout.isatty():
        return None
    return max(1, shutil.get_terminal_size().columns)


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1, keys: int = 1, prose: bool = False
) -> str:
    """Return a table with a rule under the header.

    One too wide for the terminal is continued below in as many parts as it takes, each with the columns that name the
    row; where not even that fits, each row becomes a list.

    Args:
        header: Titles of the columns.
        rows: Their cells; `colour.good` and `colour.bad` make coloured ones.
        left: How many columns, from the first, are left-aligned; the others are right-aligned.
        keys: How many columns, from the first, name the row.
        prose: Whether the last column is text that may be broken over several lines.
    """
    limit, whole = width(), rows
    if limit is not None and prose:
        rest = sum(w + 2 for w in _widths(header, rows)[:-1])
        if limit - rest >= LEAST:
            rows = broken(rows, limit - rest)
    widths = _widths(header, rows)
    columns = list(range(len(header)))
    if limit is None or _across(widths, columns) <= limit:
        return _block(header, rows, widths, columns, left)
    parts = [columns[:keys]]
    for column in columns[keys:]:
        if _across(widths, [*columns[:keys], column]) > limit:
            return _lists(header, whole)
        if _across(widths, [*parts[-1], column]) > limit:
            parts.append(columns[:keys])
        parts[-1] = [*parts[-1], column]
    return "\n\n".join(_block(header, rows, widths, part, left) for part in parts)


def broken(rows: Sequence[Sequence[str]], room: int) -> list[list[str]]:
    """Return rows whose last cell is at most `room` wide where words allow it: the rest of it stands in rows below."""
    found = []
    for row in rows:
        first, *more = _wrapped(row[-1], room) or [""]
        found.append([*row[:-1], first])
        found += [[*[""] * (len(row) - 1), line] for line in more]
    return found


def _wrapped(text: str, room: int, **more: Any) -> list[str]:
    return textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False, **more)


def _widths(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(len(str(row[i])) for row in (header, *rows)) for i in range(len(header))]


def _across(widths: Sequence[int], columns: Sequence[int]) -> int:
    return sum(widths[i] + 2 for i in columns) - 2


def _block(
    header: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[int], columns: Sequence[int], left: int
) -> str:
    def line(cells: Sequence[str], tone: str) -> str:
        padded = []
        for i in columns:
            cell = cells[i]
            room = " " * (widths[i] - len(cell))
            painted = paint(cell, tone or (cell.tone if isinstance(cell, Cell) else ""))
            padded.append(painted + room if i < left else room + painted)
        return "  ".join(padded).rstrip()

    rule = paint("  ".join("-" * widths[i] for i in columns), RULE)
    return "\n".join([line(header, HEAD), rule, *(line(row, "") for row in rows)])


def _lists(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n\n".join("\n".join(f"{title}: {cell}" for title, cell in zip(header, row, strict=True)) for row in rows)


def _folded(line: str) -> str:
    limit = width()
    if limit is None or len(visible(line)) <= limit:
        return line
    indent = " " * min(len(line) - len(line.lstrip()), limit // 2)
    return "\n".join(_wrapped(line.strip(), limit, initial_indent=indent, subsequent_indent=indent + "  "))


@contextmanager
def progress_bar(total: int, unit: str, begin: str, done: int = 0) -> Iterator[Bar]:
    """Show progress and the time left on standard error, and clear it at the end.

    Silent when standard error is not a terminal, or only errors are wanted.

    Args:
        total: Number of units of work; 0 while it is not known.
        unit: What one unit is called.
        begin: What is being done until the first unit is finished.
        done: Units that were finished before.
    """
    from tqdm import tqdm

    hidden = _VOICES[-1].quiet or sys.stderr is None or not sys.stderr.isatty()
    with tqdm(
        total=total or None,
        initial=done,
        desc=begin,
        unit=unit,
        unit_scale=True,
        leave=False,
        disable=hidden,
        file=sys.stderr,
        dynamic_ncols=True,
    ) as bar:
        yield bar


def following(bar: Bar, every: int = 1) -> Callable[[str, int, int], None]:
    """Return what shows the progress that a function of the library reports on a bar.

    Args:
        bar: The bar.
        every: Units of work that must be done before the bar moves.
    """
    shown = 0

    def progress(what: str, done: int, whole: int) -> None:
        nonlocal shown
        if done - shown >= every or done >= whole:
            bar.total = whole or None
            bar.set_description_str(what, refresh=False)
            bar.update(done - shown)
            shown = done

    return progress
