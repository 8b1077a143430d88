"""The folders of runs that ``report``, ``video`` and ``view`` are given: what is wrong with one, and what to do."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from torquebench.errors import ConfigError, Problem, ResultError

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
