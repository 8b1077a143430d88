"""From figures that are to be drawn to the contents of their files, in several processes where there are several."""

from __future__ import annotations

import io
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

from matplotlib.figure import Figure

from torquebench.errors import ConfigError, Problem, nearest
from torquebench.experiment.run import Progress
from torquebench.report.figures.layout import PAPER, SCREEN, Sheet, on_sheet
from torquebench.report.figures.style import journal_style

Drawn: TypeAlias = Figure | Mapping[str, Figure] | None
"""A figure, several by the rest of their names, or nothing to show."""
Job: TypeAlias = Callable[[], Drawn]
"""Draws one figure or several."""
Format: TypeAlias = Literal["svg", "png", "pdf"]
LEAST = 6
"""Figures below which all are drawn here: to start, another process takes as long as it does for two of them."""


class Wish(NamedTuple):
    """Options for writing figures."""

    pdf: bool = False
    """As PDF too, besides SVG and PNG."""
    paper: bool = False
    """At the width of one column of a journal and of two, without headings, instead of as a page's."""
    workers: int = 1
    """How many processes draw, this one among them; the bytes do not depend on it."""

    @property
    def formats(self) -> tuple[Format, ...]:
        """Endings of the files."""
        return ("svg", "png", "pdf") if self.pdf else ("svg", "png")

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """Sheets to draw on."""
        return PAPER if self.paper else (SCREEN,)


def figure_bytes(fig: Figure, fmt: Format) -> bytes:
    """Return the figure as a file's bytes; the same figure gives the same bytes (PNG at 150 dpi)."""
    buffer = io.BytesIO()
    metadata = {
        "svg": {"Date": None, "Creator": "torquebench"},
        "png": {"Software": "torquebench"},
        "pdf": {"CreationDate": None, "Creator": "torquebench", "Producer": None},
    }[fmt]
    with journal_style():
        fig.savefig(buffer, format=fmt, metadata=metadata)
    return buffer.getvalue()


def figure_files(
    jobs: Mapping[str, Job], wish: Wish, progress: Progress | None = None, only: Sequence[str] = ()
) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files of figures, in order.

    Args:
        jobs: Name -> what draws it.
        wish: How they are written.
        progress: Told each figure when it is drawn.
        only: Names of the figures that are wanted, of those that a job draws; all if left out.
    """
    tasks = [(name, sheet) for name in jobs if may_draw(name, only) for sheet in wish.sheets]
    # A function of a user's file or notebook does not exist in another process.
    far = [k for k, (name, _) in enumerate(tasks) if _is_own(jobs[name])] if wish.workers > 1 else []
    far = far if len(far) >= LEAST else []
    context, own = multiprocessing.get_context("spawn"), {tasks[k][0]: jobs[tasks[k][0]] for k in far}
    pool = ProcessPoolExecutor(min(wish.workers - 1, len(far)), context, _receive, (own,)) if far else None
    try:
        # the others begin at the end, this process at the front, until they meet
        ahead = {k: pool.submit(_draw_far, *tasks[k], wish.formats, only) for k in far[::-1] if pool}
        for k, (name, sheet) in enumerate(tasks):
            here = k not in ahead or ahead[k].cancel()
            yield from _draw(jobs[name], name, sheet, wish.formats, only) if here else ahead[k].result()
            if progress is not None:
                progress(name, k + 1, len(tasks))
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)


_jobs: dict[str, Job] = {}
"""In another process, what draws each figure; it goes there once, and before this process draws."""


def _receive(jobs: Mapping[str, Job]) -> None:
    _jobs.update(jobs)


def _draw_far(name: str, *how: Any) -> list[tuple[str, bytes]]:
    return _draw(_jobs[name], name, *how)


def _is_own(job: Job) -> bool:
    return isinstance(job, partial) and job.func.__module__.startswith("torquebench.")


def _draw(job: Job, name: str, sheet: Sheet, formats: Sequence[Format], only: Sequence[str]) -> list[tuple[str, bytes]]:
    """Draw and return the files of one job on one sheet.

    Args:
        job: What draws.
        name: Name of the figure, or what the names of several begin with.
        sheet: What is drawn on.
        formats: Endings of the files.
        only: As of `figure_files`.
    """
    with on_sheet(sheet):
        return [
            (f"figures/{each}{sheet.suffix}.{fmt}", figure_bytes(fig, fmt))
            for each, fig in named(name, job()).items()
            if wanted(each, only)
            for fmt in formats
        ]


def named(name: str, drawn: Drawn) -> dict[str, Figure]:
    """Return the figures that a job has drawn, by name."""
    if isinstance(drawn, Mapping):
        return {f"{name}-{rest}": fig for rest, fig in drawn.items()}
    return {} if drawn is None else {name: drawn}


def may_draw(name: str, only: Sequence[str]) -> bool:
    """Whether a job may draw any of the wanted figures."""
    return wanted(name, only) or any(one.startswith(f"{name}-") for one in only)


def wanted(name: str, only: Sequence[str]) -> bool:
    """Whether a figure, or a group of figures, is one of those that are wanted, of which none means all."""
    return not only or any(f"{name}-".startswith(f"{one}-") for one in only)


def names_of(files: Iterable[str], wish: Wish) -> list[str]:
    """Return the names of the figures that are in some files."""
    stems = [Path(file).with_suffix("").name for file in files]
    if wish.paper:
        stems = [stem.rpartition("-")[0] for stem in stems]
    return list(dict.fromkeys(stems))


def chosen_files(
    jobs: Mapping[str, Job], only: Sequence[str], wish: Wish, progress: Progress | None, place: str
) -> dict[str, bytes]:
    """Return name and content of the files of the figures that are asked for; all where none is.

    Args:
        jobs, wish, progress: As of `figure_files`.
        only: Names of the figures.
        place: What messages call `only`.

    Raises:
        ConfigError: there is no figure of one of the names.
    """
    check_names(only, list(jobs), wanted, place)
    return dict(figure_files(jobs, wish, progress, only))


def check_names(
    only: Sequence[str], known: Sequence[str], fits: Callable[[str, Sequence[str]], bool], place: str
) -> None:
    """Refuse names of figures that there are not.

    Args:
        only: The names that were asked for.
        known: Those that there are.
        fits: Whether one of them is meant by a name: `wanted`, or `may_draw`.
        place: Where the names stand.

    Raises:
        ConfigError: there are some; each is answered with the nearest.
    """
    wrong = [name for name in only if not any(fits(one, (name,)) for one in known)]
    if wrong:
        raise ConfigError([_problem(place, name, known) for name in wrong])


def _problem(place: str, name: str, known: Sequence[str]) -> Problem:
    near = nearest(name, known)
    others = "" if near else f"one of: {', '.join(known)}" if known else "nothing: there is none"
    return Problem(place, got=f"'{name}'", nearest=near or "", wanted=others)
