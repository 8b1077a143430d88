"""Output to the terminal: lines, tables, colour, progress; and how much of it is shown."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import timedelta
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID
    from rich.text import Text

LEAST = 28
"""Narrowest column that text is broken into."""
USUAL_HEIGHT = 60
"""Lines of a screen where there is none."""


@dataclass
class Voice:
    """Output settings of the running command, and everything that it has reported so far."""

    quiet: bool = False
    """Errors and nothing else."""
    as_json: bool = False
    """One JSON document on standard output instead of lines and tables."""
    verbose: bool = False
    """Tracebacks of errors."""
    command: str | None = None
    """Name of the command, once it is understood."""
    facts: dict[str, Any] = field(default_factory=dict)
    """What the document says of this command."""
    remarks: list[str] = field(default_factory=list)
    """Warnings, in order."""


_VOICES = [Voice()]


def voice() -> Voice:
    """Return the voice of the running command."""
    return _VOICES[-1]


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
    voice().facts.update(facts)


def say(text: str = "", fold: bool = True) -> None:
    """Write lines to standard output unless silence or JSON is asked for.

    Args:
        text: One line or several.
        fold: Whether lines too long for the terminal are broken between words.
    """
    if not (voice().quiet or voice().as_json):
        emit("\n".join(_folded(line) for line in text.split("\n")) if fold else text)


def answer(text: str) -> None:
    """Write a line that the user needs while the command goes on, such as the address of a page.

    It goes to standard output even with ``--quiet``. With ``--json``, whose document has standard output for itself,
    it goes to standard error unless ``--quiet`` is given too.
    """
    if not voice().as_json:
        emit(text)
    elif not voice().quiet:
        complain(text)


def emit(text: str) -> None:
    """Write a line to standard output, if there is one, whatever the voice."""
    _BEAT.clear()
    if sys.stdout is not None:
        sys.stdout.write(text + "\n")


def warn(text: str) -> None:
    """Write a warning to standard error unless only errors are wanted, and keep it for the document."""
    voice().remarks.append(text)
    if not voice().quiet:
        complain(text)


def complain(text: str) -> None:
    """Write a line to standard error, if there is one that takes it: the exit status says the rest."""
    _BEAT.clear()
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


def height() -> int:
    """Return how many lines the terminal shows at once; where standard output is none, `USUAL_HEIGHT`."""
    if sys.stdout is None or not sys.stdout.isatty():
        return USUAL_HEIGHT
    return shutil.get_terminal_size().lines


def coloured(stream: TextIO | None) -> bool:
    """Return whether what is written to `stream` has colour.

    NO_COLOR (https://no-color.org), set and not empty, forbids it; else FORCE_COLOR asks for it; else a terminal that
    is not TERM=dumb has it.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def good(text: str) -> Text:
    """Return a table's cell for something that is as it should be."""
    from rich.text import Text

    return Text(text, "green")


def bad(text: str) -> Text:
    """Return a table's cell for something that is not as it should be."""
    from rich.text import Text

    return Text(text, "red")


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    left: int = 1,
    keys: int = 1,
    prose: bool = False,
) -> str:
    """Return a table with a rule under the header, coloured where standard output is.

    One too wide for the terminal is continued below in as many parts as it takes, each with the columns that name the
    row. Where standard output is no terminal, the table is as wide as it needs to be.

    Args:
        header: Titles of the columns.
        rows: Their cells, text; `good` and `bad` make coloured ones.
        left: How many columns, from the first, are left-aligned; the others are right-aligned.
        keys: How many columns, from the first, name the row.
        prose: Whether the last column is text that may be broken over several lines.
    """
    from rich.cells import cell_len

    limit = width()
    sizes = [max(cell_len(str(row[i])) for row in (header, *rows)) for i in range(len(header))]
    least = [*sizes[:-1], min(sizes[-1], LEAST)] if prose else sizes
    parts = [list(range(keys))]
    for column in range(keys, len(header)):
        across = sum(least[i] + 2 for i in parts[-1]) + least[column]
        if limit is not None and across > limit and len(parts[-1]) > keys:
            parts.append(list(range(keys)))
        parts[-1].append(column)
    return "\n\n".join(_part(header, rows, part, left, limit) for part in parts)


def _part(
    header: Sequence[str], rows: Sequence[Sequence[object]], columns: Sequence[int], left: int, limit: int | None
) -> str:
    """Return some columns of a table."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    lines = [[cell if isinstance(cell := row[i], Text) else Text(str(cell)) for i in columns] for row in rows]
    rules = ["-" * max(len(header[i]), *(len(x[k]) for x in lines), 0) for k, i in enumerate(columns)]
    rest = 0 if limit is None else limit - sum(len(rule) + 2 for rule in rules[:-1])
    grid = Table.grid(padding=(0, 2))
    for i in columns:  # where the last one has room, the others are not broken for it
        whole = rest > 0 and i != columns[-1]
        grid.add_column(justify="left" if i < left else "right", overflow="fold", no_wrap=whole)
    if rest > 0:
        rules[-1] = rules[-1][:rest]
    grid.add_row(*(Text(header[i], "bold") for i in columns))
    grid.add_row(*(Text(rule, "dim") for rule in rules))
    for line in lines:
        grid.add_row(*line)
    colour = coloured(sys.stdout)
    console = Console(
        width=limit or 100_000,
        color_system="standard" if colour else None,
        force_terminal=colour,
        no_color=False,
        legacy_windows=False,
        force_jupyter=False,
    )
    with console.capture() as capture:
        console.print(grid)
    return "\n".join(line.rstrip() for line in capture.get().rstrip("\n").split("\n"))


def _folded(line: str) -> str:
    limit = width()
    if limit is None or len(line) <= limit or "\x1b" in line:
        return line
    indent = " " * min(len(line) - len(line.lstrip()), limit // 2)
    return textwrap.fill(
        line.strip(),
        limit,
        initial_indent=indent,
        subsequent_indent=indent + "  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


class Beat:
    """A line on standard error, "torquebench why: working, 3 s", while nothing else tells that a command goes on.

    It is shown once nothing was written for `PATIENCE`, and taken back before anything is.
    """

    PATIENCE = 0.4
    """Longest time without a change on the terminal [s]."""

    def __init__(self) -> None:
        """Show nothing yet."""
        self._lock, self._shown, self._last, self.others = threading.RLock(), False, 0.0, 0

    def clear(self, others: int = 0) -> None:
        """Take the line back, as something else is written.

        Args:
            others: What begins (1) or ends (-1) to tell that the command goes on; nothing is shown meanwhile.
        """
        with self._lock:
            self.others += others
            self._last = time.monotonic()
            if self._shown:
                self._shown = False
                self._write("\x1b[K")

    @contextmanager
    def beating(self, what: str) -> Iterator[None]:
        """Show the line where it is needed for as long as this context lasts.

        Args:
            what: What goes on.
        """
        if not _watched() or os.environ.get("TERM") == "dumb":
            yield
            return
        begun, ended = time.monotonic(), threading.Event()
        self._last, self.others = begun, 0

        def show() -> None:
            while not ended.wait(self.PATIENCE / 3.0):
                with self._lock:
                    now = time.monotonic()
                    idle = not (self.others or ended.is_set() or voice().quiet)
                    if idle and (self._shown or now - self._last > self.PATIENCE):
                        self._shown = True
                        self._write(f"\x1b[K{what}: working, {now - begun:.0f} s\r")

        thread = threading.Thread(target=show, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            self.clear()

    @staticmethod
    def _write(text: str) -> None:
        with suppress(OSError, AttributeError):
            sys.stderr.write(text)
            sys.stderr.flush()


_BEAT = Beat()
beating = _BEAT.beating


def settle() -> None:
    """Say nothing of work from now on: the command waits for the user."""
    _BEAT.clear(1)


def _watched() -> bool:
    """Return whether somebody looks at standard error and wants more than errors."""
    return not voice().quiet and sys.stderr is not None and sys.stderr.isatty()


EVERY = 30.0
"""Time between two lines of progress where standard error is no terminal [s]."""


class Bar:
    """Progress of one piece of work; silent where only errors are wanted."""

    def __init__(self, progress: Progress | None = None, task: TaskID | None = None, total: float | None = None):
        self._progress, self._task, self._total = progress, task, total

    @property
    def total(self) -> float | None:
        """Number of units of work, when it is known."""
        return self._total

    @total.setter
    def total(self, total: float | None) -> None:
        """Set the number of units."""
        self._total = total
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, total=total)

    def update(self, n: float = 1) -> None:
        """Advance by `n`."""
        if self._progress is not None and self._task is not None:
            self._progress.advance(self._task, n)

    def describe(self, text: str) -> None:
        """Say what is being done."""
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, description=text)


class Log(Bar):
    """Progress where standard error is a file or a pipe: a line now and then, with what is done and what is left.

    The time left is told from the second unit on, for ahead of the first laws are compiled.

    Args:
        total: Number of units of work, when it is known.
        unit: What one unit is called.
        what: What is being done.
        done: Units that were finished before.
    """

    def __init__(self, total: float | None, unit: str, what: str, done: float) -> None:
        super().__init__(total=total)
        self._unit, self._what, self._done = unit, what, done
        self._begun = self._told = time.monotonic()
        self._first: tuple[float, float] | None = None

    def update(self, n: float = 1) -> None:
        """Advance by `n`."""
        self._done += n
        if self._first is None and n > 0:
            self._first = time.monotonic(), self._done
        self._tell()

    def describe(self, text: str) -> None:
        """Say what is being done."""
        self._what = text
        self._tell()

    def _tell(self) -> None:
        now = time.monotonic()
        if now - self._told < EVERY:
            return
        self._told, passed = now, now - self._begun
        whole = f" of {self.total:,.0f}" if self.total else ""
        text = f"{self._what}: {self._done:,.0f}{whole} {self._unit}s, {timedelta(seconds=int(passed))} so far"
        if self.total and self._first is not None and self._done > self._first[1]:
            since, done = self._first
            left = (now - since) * max(self.total - self._done, 0.0) / (self._done - done)
            text += f", {timedelta(seconds=int(left))} left"
        complain(text)


_PROGRESS: list[Progress] = []
"""The display that is on the screen; a bar inside another one's work is a second line of it."""


@contextmanager
def progress_bar(total: int, unit: str, begin: str, done: int = 0) -> Iterator[Bar]:
    """Show progress and the time left on standard error, and clear it at the end.

    Where that is no terminal, it is a line now and then; silent when only errors are wanted.

    Args:
        total: Number of units of work; 0 while it is not known.
        unit: What one unit is called.
        begin: What is being done until the first unit is finished.
        done: Units that were finished before.
    """
    if not _watched():
        yield Bar(total=total or None) if voice().quiet else Log(total or None, unit, begin, done)
        return
    if _PROGRESS:
        task = _PROGRESS[0].add_task(begin, total=total or None, completed=done, unit=unit)
        try:
            yield Bar(_PROGRESS[0], task, total or None)
        finally:
            _PROGRESS[0].remove_task(task)
        return
    display = _display()
    _BEAT.clear(1)
    try:
        with display as progress:
            _PROGRESS.append(progress)
            try:
                task = progress.add_task(begin, total=total or None, completed=done, unit=unit)
                yield Bar(progress, task, total or None)
            finally:
                _PROGRESS.remove(progress)
    finally:
        _BEAT.clear(-1)


def _display() -> Progress:
    """Return an empty display of progress on standard error; warnings written meanwhile appear above it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
    from rich.text import Text

    class Count(ProgressColumn):
        def render(self, task: Task) -> Text:
            """Show how many units are done, once it is known of how many, or one is."""
            known = task.total is not None or task.completed > 0
            return Text(f"{task.completed:,.0f} {task.fields['unit']}s" if known else "")

    class Clock(ProgressColumn):
        def render(self, task: Task) -> Text:
            """Show the time that passed, and the time that is left where that can be told."""
            left = task.time_remaining
            passed = f"{timedelta(seconds=int(task.elapsed or 0.0))} so far"
            return Text(passed if left is None else f"{passed}, {timedelta(seconds=int(left))} left", "cyan")

    console = Console(file=sys.stderr, force_terminal=True, no_color=not coloured(sys.stderr), legacy_windows=False)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        Count(),
        Clock(),
        console=console,
        transient=True,
        redirect_stdout=False,
    )


def following(bar: Bar, every: int = 1) -> Callable[[str, int, int], None]:
    """Return what shows the progress that a function of the library reports on a bar.

    Args:
        bar: The bar.
        every: Units of work that must be done before the bar moves.
    """
    shown, told = 0, ""

    def progress(what: str, done: int, whole: int) -> None:
        nonlocal shown, told
        if what != told or done - shown >= every or done >= whole:
            told = what
            bar.total = whole or None
            bar.describe(what)
            bar.update(done - shown)
            shown = done

    return progress
