"""The folders that ``report``, ``figures``, ``video`` and ``view`` are given: what is wrong with one, what to do."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from torquebench.cli.parameters import refuse
from torquebench.errors import ConfigError, Problem, ResultError

if TYPE_CHECKING:
    from torquebench.sweep.folder import StoredSweep

T = TypeVar("T")


def read_run(folder: Path, command: str, read: Callable[[Path], T]) -> T:
    """Return what `read` makes of a run's folder.

    Args:
        folder: What the user gave.
        command: The command it was given to.
        read: Reads it, or raises ResultError.

    Raises:
        ConfigError: it is missing, unfinished, no run's folder, a sweep's, or altered; says which and what to do.
    """
    from torquebench.sweep.folder import PLAN

    try:
        return read(folder)
    except ResultError as error:
        text = sweep_text(folder, command) if os.path.isfile(folder / PLAN) else str(error)
        raise ConfigError([Problem("RUN", "", text)]) from error


def read_sweep(folder: Path, plugins: Sequence[Path]) -> StoredSweep:
    """Return a finished sweep.

    Args:
        folder: What the user gave, a sweep's folder.
        plugins: Files that are loaded for it.

    Raises:
        ConfigError: it is not finished, or altered; says which and what to do.
    """
    from torquebench.sweep.folder import open_sweep, verify

    stored = open_sweep(folder, tuple(path.absolute() for path in plugins), "RUN", to_read=True)
    if not stored.finished:
        refuse([("RUN", f"{folder} is not a finished sweep: torquebench sweep --resume {folder} goes on with it")])
    try:
        verify(stored)
    except ResultError as error:
        raise ConfigError([Problem("RUN", "", str(error))]) from error
    return stored


def sweep_text(folder: Path, command: str) -> str:
    """Return that a folder is a sweep's, and the commands that bring what was asked for.

    Args:
        folder: The sweep.
        command: The command it was given to, which takes single runs.
    """
    row = shlex.join(["torquebench", "run", "--from-sweep", str(folder), "--index", "K", "--out", "OUT"])
    page = f"; torquebench report {shlex.quote(str(folder))}, with nothing else, is for its page"
    return (
        f"{folder}: is a sweep, which is many runs; for its row K, counted from 0: {row}, "
        f"then torquebench {command} OUT{page if command == 'report' else ''}"
    )
