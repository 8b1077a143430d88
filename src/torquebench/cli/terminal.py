"""What the user sees in the terminal: lines, tables, progress bars."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol


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


def say(text: str = "") -> None:
    """Write a line to standard output, if there is one."""
    if sys.stdout is not None:
        sys.stdout.write(text + "\n")


def complain(text: str) -> None:
    """Write a line to standard error, if there is one that takes it: the exit status says the rest."""
    try:
        if sys.stderr is not None:
            sys.stderr.write(text + "\n")
            sys.stderr.flush()
    except OSError:
        sys.stderr = None


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Return a table: the first `left` columns left-aligned, the others right-aligned, a rule under the header."""
    widths = [max(len(str(row[i])) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        padded = [
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
        ]
        return "  ".join(padded).rstrip()

    return "\n".join([line(header), "  ".join("-" * w for w in widths), *map(line, rows)])


@contextmanager
def progress_bar(total: int, unit: str, begin: str, done: int = 0) -> Iterator[Bar]:
    """Show progress on standard error, and clear it at the end; silent when that is not a terminal.

    Args:
        total: Number of units of work.
        unit: What one unit is called.
        begin: What is being done until the first unit is finished.
        done: Units that were finished before.
    """
    from tqdm import tqdm

    hidden = sys.stderr is None or not sys.stderr.isatty()
    with tqdm(
        total=total, initial=done, desc=begin, unit=unit, unit_scale=True, leave=False, disable=hidden, file=sys.stderr
    ) as bar:  # fmt: skip
        yield bar
