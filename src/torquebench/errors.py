"""Every error the package raises on purpose, under one root."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import NamedTuple


class TorquebenchError(Exception):
    """Root of all errors raised on purpose by this package."""


class ModelError(TorquebenchError):
    """A robot model is missing, malformed, or has something the analytic side cannot represent."""


class ControllerError(TorquebenchError):
    """A control law is unknown, registered wrongly, or was given gains it cannot use."""


class InconsistentReferenceError(TorquebenchError):
    """A reference is not consistent: its rates are not the derivatives of its positions."""


class SimulationError(TorquebenchError):
    """A run did not complete; `trajectory` holds what happened up to the failing instant."""

    def __init__(self, message: str, trajectory: object) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class ResultError(TorquebenchError):
    """A run directory is missing, incomplete or does not match its manifest."""


class Problem(NamedTuple):
    """One mistake in a user's input."""

    where: str
    """Place of the mistake: ``file:line:column``, or the command-line option."""
    key: str
    """Dotted path of the offending key; empty when the mistake concerns the whole input."""
    message: str
    """What was wrong, what was wanted, and the nearest valid name where there is one."""

    def __str__(self) -> str:
        return ": ".join(part for part in self if part)


class ConfigError(TorquebenchError):
    """Bad input; carries every mistake found, not just the first one."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


def did_you_mean(name: object, valid: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the valid name nearest to `name`, or the list of valid names.

    Args:
        name: What the user wrote; upper and lower case count as the same.
        valid: Names that would have been accepted.
    """
    names, wrote = list(valid), str(name)
    close = difflib.get_close_matches(wrote.lower(), {known.lower() for known in names}, n=1, cutoff=0.5)
    if close:
        alike = [known for known in names if known.lower() == close[0]]
        best = max(alike, key=lambda known: difflib.SequenceMatcher(None, wrote, known).ratio())
        return f" (did you mean '{best}'?)"
    return f" (one of: {', '.join(names)})" if names else ""
