"""Every error the package raises on purpose, under one root."""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

UNCHECKED = "what depends on these was not checked: mend them and more may follow"
"""Remark after mistakes that keep others from being looked for."""


MOST_TOLD = 20_000
"""Characters of mistakes beyond which they are shortened."""
MOST_OF_PART = 300
"""Characters that are left of a part of a mistake where they are shortened."""


class TorquebenchError(Exception):
    """Root of all errors raised on purpose by this package."""


class ModelError(TorquebenchError):
    """A robot model is missing, malformed, or has something the analytic side cannot represent.

    Args:
        message: What is wrong.
        problems: All that is wrong, where that is several things; the message has them all if none is given.
    """

    def __init__(self, message: str, problems: Iterable[Problem] = ()) -> None:
        self.problems = tuple(problems) or (Problem(text=message),)
        super().__init__(message)

    @classmethod
    def of_file(cls, where: str, reasons: Iterable[Problem | str]) -> ModelError:
        """Return the error of a file that is refused for several reasons.

        Args:
            where: The file.
            reasons: The reasons; those that name no file of their own are at a place in this one.
        """
        problems = [Problem(text=reason) if isinstance(reason, str) else reason for reason in reasons]
        problems = [one if one.source else replace(one, source=where) for one in problems]
        return cls("\n".join(map(str, problems)), problems)


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


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a user's input; its text and its JSON are made from these parts."""

    source: str = ""
    """The file, or the option or argument of the command; empty when there is neither."""
    key: str = ""
    """Dotted path of the offending key; empty when the mistake concerns the whole input."""
    text: str = ""
    """What is wrong, in words; empty where `got` and `wanted` say it."""
    got: str = ""
    """What the user wrote."""
    wanted: str = ""
    """Value that would have been right, in words."""
    nearest: str = ""
    """The valid name nearest to what the user wrote."""
    note: str = ""
    """Further help."""
    line: int | None = None
    """Line in the file, from 1."""
    column: int | None = None
    """Column in the file, from 1."""

    @property
    def where(self) -> str:
        """Place of the mistake: ``file:line:column``, as far as it is known, or the command-line option."""
        return ":".join(str(part) for part in (self.source, self.line, self.column) if part is not None)

    @property
    def message(self) -> str:
        """Message of what was wrong, what was wanted, and the nearest valid name where there is one."""
        got = f"got {self.got}" if self.got else ""
        parts = [self.text, got, f"wanted {self.wanted}" if self.wanted else ""]
        near = f" (did you mean '{self.nearest}'?)" if self.nearest else ""
        return ", ".join(part for part in parts if part) + near + (f"; {self.note}" if self.note else "")

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.key, self.message) if part)

    def to_json(self) -> dict[str, str | int | None]:
        """Return the mistake with its place taken apart.

        Returns:
            `file`, `line`, `column` (None where the mistake is in no file, or has no line), `option` (the command-line
            option or argument; None where it is in a file), `key`, `message`, and `wanted`: what would have been right,
            None where that is not known.
        """
        is_option = self.line is None and (self.source.startswith("-") or self.source.isupper())
        return {
            "file": None if is_option else self.source or None,
            "line": self.line,
            "column": self.column,
            "option": self.source if is_option else None,
            "key": self.key or None,
            "message": self.message,
            "wanted": self.nearest or self.wanted or None,
        }


class Fault(NamedTuple):
    """A mistake in an object, told by its rules, before its place in a file is known."""

    path: tuple[str | int, ...]
    """The offending key, below the object's own."""
    text: str = ""
    """As of a `Problem`; so are the next four."""
    got: str = ""
    wanted: str = ""
    nearest: str = ""
    note: str = ""
    at: Literal["key", "value"] = "value"
    """Whether the mistake is in the key's name or in its value."""
    unless: tuple[str | int, ...] = ()
    """Another key, from the top: where the offending one is not written but this one is, the mistake is there."""

    def below(self, path: tuple[str | int, ...]) -> Fault:
        """Return the same of an object that stands at a path."""
        return self._replace(path=(*path, *self.path))


class ConfigError(TorquebenchError):
    """Bad input; carries every mistake found, not just the first one.

    Args:
        problems: The mistakes.
        unchecked: Whether something could not be checked because of them.
    """

    def __init__(self, problems: Iterable[Problem], unchecked: bool = False) -> None:
        self.problems, self.unchecked = _bounded(tuple(problems)), unchecked
        super().__init__("\n".join([*map(str, self.problems), *([UNCHECKED] if unchecked else [])]))


def _bounded(problems: tuple[Problem, ...]) -> tuple[Problem, ...]:
    """Return mistakes that are short enough to be read: as they are, up to `MOST_TOLD` characters.

    Of more, the same mistake in several places is told once, with their number; long texts are cut, and those that are
    too many are counted.
    """
    if sum(len(str(problem)) for problem in problems) <= MOST_TOLD:
        return problems
    places: dict[tuple[str, str], list[Problem]] = {}
    for problem in problems:
        places.setdefault((problem.source, problem.message), []).append(problem)
    told, room = list[Problem](), MOST_TOLD
    for same in places.values():
        if room <= 0:
            left = sum(map(len, [*places.values()][len(told) :]))
            return (*told, Problem(same[0].source, "", f"{left} more mistakes are not shown"))
        problem = _cut(same[0])
        if len(same) > 1:
            more = f"the same in {len(same) - 1} more places"
            problem = replace(problem, note=f"{problem.note}; {more}" if problem.note else more)
        told.append(problem)
        room -= len(str(problem))
    return tuple(told)


def _cut(problem: Problem) -> Problem:
    """Return a mistake of which no part is longer than `MOST_OF_PART`, but for the number of what was cut."""
    cut: dict[str, Any] = {}
    for name in ("source", "key", "text", "got", "wanted", "nearest", "note"):
        if len(part := getattr(problem, name)) > MOST_OF_PART:
            cut[name] = f"{part[:MOST_OF_PART]}... ({len(part):,} characters)"
    return replace(problem, **cut)


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
    """Return `` (did you mean 'x'?)`` for the existing path nearest to a missing one; arguments as `nearest_path`."""
    near = nearest_path(path, ending)
    return f" (did you mean '{near}'?)" if near else ""


def nearest_path(path: Path, ending: str = "") -> str:
    """Return the path that exists nearest to one that does not; empty where none is near.

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
    return str(found) if found != path and str(found).isprintable() else ""


def _is_like(path: Path, ending: str) -> bool:
    return path.is_file() and re.fullmatch(ending, path.suffix) is not None if ending else path.is_dir()


MAX_NAME = 64
"""Longer words are near no name."""


def nearest(wrote: str, names: Collection[str], least: float = 0.5) -> str | None:
    """Return the name nearest to what a user wrote, whatever the case of letters; None where none is near.

    Args:
        wrote: What the user wrote.
        names: Names that would have been accepted.
        least: How alike the two must be, 0 to 1.
    """
    return None if len(wrote) > MAX_NAME else _nearest(wrote, tuple(names), least)


@functools.lru_cache(maxsize=256)  # one mistake is often made many times
def _nearest(wrote: str, names: tuple[str, ...], least: float) -> str | None:
    begun = [known for known in names if len(wrote) > 2 and known.lower().startswith(wrote.lower())]
    if len(begun) == 1:
        return begun[0]
    close = difflib.get_close_matches(wrote.lower(), {known.lower() for known in names}, n=1, cutoff=least)
    alike = [known for known in names if known.lower() in close]
    return max(alike, key=lambda known: difflib.SequenceMatcher(None, wrote, known).ratio(), default=None)
