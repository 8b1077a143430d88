"""Every error the package raises on purpose, under one root."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple


class TorquebenchError(Exception):
    """Root of all errors raised on purpose by this package."""


class ModelError(TorquebenchError):
    """A robot model is missing, malformed, or has something the analytic side cannot represent."""


class ControllerError(TorquebenchError):
    """A control law is unknown, registered wrongly, or was given gains it cannot use."""


class RegistryError(TorquebenchError):
    """A metric, figure or other registered thing is unknown, or was registered wrongly."""


class Finding(NamedTuple):
    """Something noteworthy about a fuzzy system."""

    code: str
    """Kind of finding, a slug."""
    severity: str
    """``error``: the system has no meaning; ``warning``: it does, but perhaps not the one intended."""
    where: tuple[str | int, ...]
    """Place in the definition, as in a config below the system's name: ``("inputs", 0, "terms", "NB")``."""
    message: str
    """What was found, and what to do about it."""

    def __str__(self) -> str:
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.where).lstrip(".")
        return f"{self.severity}: {place + ': ' if place else ''}{self.message} ({self.code})"


class FuzzyError(TorquebenchError):
    """A fuzzy system cannot be used; carries every reason found."""

    def __init__(self, name: str, findings: Iterable[Finding]) -> None:
        self.findings = tuple(findings)
        super().__init__("\n".join(f"fuzzy system '{name}': {finding}" for finding in self.findings))


class InconsistentReferenceError(TorquebenchError):
    """A reference is not consistent: its rates are not the derivatives of its positions."""


class SimulationError(TorquebenchError):
    """A run did not complete; `trajectory` holds what happened up to the failing instant."""

    def __init__(self, message: str, trajectory: object) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class ResultError(TorquebenchError):
    """A run directory is missing, incomplete or does not match its manifest."""


class VideoError(TorquebenchError):
    """A film or picture could not be made."""


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

    def to_json(self) -> dict[str, str | int | None]:
        """Return the mistake with its place taken apart.

        Returns:
            `file`, `line`, `column` (None where the mistake is in no file, or has no line), `option` (the command-line
            option or argument; None where it is in a file), `key`, `message`, and `wanted`: what would have been right,
            None where the message does not say.
        """
        place = _PLACE.fullmatch(self.where)
        file, line, column = (place[1], int(place[2]), int(place[3])) if place else (None, None, None)
        option = None if file or not self.where else self.where
        if option is not None and not _OPTION.match(option):
            file, option = option, None
        wanted = _WANTED.search(self.message)
        return {
            "file": file,
            "line": line,
            "column": column,
            "option": option,
            "key": self.key or None,
            "message": self.message,
            "wanted": next((text for text in wanted.groups() if text), None) if wanted else None,
        }


_PLACE = re.compile(r"(.*):(\d+):(\d+)", flags=re.DOTALL)
_OPTION = re.compile(r"-|[A-Z][A-Z0-9]*$")
"""An option, or the name of an argument in the help."""
_WANTED = re.compile(r"\(did you mean '(.*?)'\?\)|\(one of: (.*)\)|\bwanted (.*?)\)?$", flags=re.DOTALL)


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
    names = list(valid)
    best = nearest(str(name), names)
    if best is not None:
        return f" (did you mean '{best}'?)"
    return f" (one of: {', '.join(names)})" if names else ""


def did_you_mean_path(path: Path, ending: str = "") -> str:
    """Return `` (did you mean 'x'?)`` for what is there and nearest to a path that is not; nothing where none is near.

    Args:
        path: What the user wrote.
        ending: That of the files that would have been accepted, a regular expression; empty where folders would.
    """
    found, parts = Path(path.anchor), path.relative_to(path.anchor).parts
    try:
        for i, part in enumerate(parts):
            file = ending if i == len(parts) - 1 else ""
            if not _is_like(found / part, file):
                shown = sorted(there.name for there in found.iterdir() if _is_like(there, file))
                names = {Path(name).stem if file else name: name for name in reversed(shown) if name[0] != "."}
                best = nearest(Path(part).stem if file else part, names)
                if best is None:
                    return ""
                part = names[best]
            found /= part
    except (OSError, ValueError):
        return ""
    return f" (did you mean '{found}'?)" if found != path and str(found).isprintable() else ""


def _is_like(path: Path, ending: str) -> bool:
    return path.is_file() and re.fullmatch(ending, path.suffix) is not None if ending else path.is_dir()


def nearest(wrote: str, names: Collection[str]) -> str | None:
    """Return the name nearest to what a user wrote, whatever the case of letters; None where none is near."""
    close = difflib.get_close_matches(wrote.lower(), {known.lower() for known in names}, n=1, cutoff=0.5)
    alike = [known for known in names if known.lower() in close]
    return max(alike, key=lambda known: difflib.SequenceMatcher(None, wrote, known).ratio(), default=None)
