"""How a command ends: its exit status, and errors as lines instead of tracebacks."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from torquebench.cli.signals import Terminated
from torquebench.cli.terminal import complain
from torquebench.errors import ConfigError, Problem, TorquebenchError

BAD_INPUT, INTERNAL, INTERRUPTED, TERMINATED = 2, 3, 130, 143
"""Exit statuses of commands that ended early; one that did not returns 0, or 1 where something did not hold."""


@dataclass
class Ending:
    """How a command ended before its end, for the document of --json."""

    problems: tuple[Problem, ...] = ()
    error: str | None = None


def guarded(work: Callable[[], int], ending: Ending) -> int:
    """Return the exit status of `work`; errors become lines, an exit status, and `ending`."""
    try:
        status = work()
        if sys.stdout is not None:
            sys.stdout.flush()
        return status
    except ConfigError as error:
        ending.problems = error.problems
        for problem in error.problems:
            complain(str(problem))
        return BAD_INPUT
    except KeyboardInterrupt as error:
        terminated = isinstance(error, Terminated)
        ending.error = "terminated" if terminated else "interrupted"
        complain(f"torquebench: {ending.error}; {str(error) or 'a run directory without manifest.json is unfinished'}")
        return TERMINATED if terminated else INTERRUPTED
    except BrokenPipeError:
        sys.stdout = None  # nobody reads it any more; the interpreter must not complain when it closes it
        return INTERNAL
    except (TorquebenchError, OSError) as error:
        ending.error = str(error)
        complain(f"torquebench: {error}")
        drop_broken_output()
        return INTERNAL
    except Exception as error:  # noqa: BLE001  the last resort: one line, and where to look
        frame = traceback.extract_tb(error.__traceback__)[-1]
        ending.error = f"{type(error).__name__}: {error} ({frame.filename}, line {frame.lineno})"
        complain(f"torquebench: internal error: {ending.error}")
        return INTERNAL


def drop_broken_output() -> None:
    """Forget standard output if it takes nothing, so that the interpreter does not complain when it closes it."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        sys.stdout = None
