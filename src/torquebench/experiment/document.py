"""The raw values of a config, where each of them was written, and the mistakes found so far."""

from __future__ import annotations

import copy
import re
from typing import Any, Literal, NamedTuple, NoReturn, TypeAlias

from torquebench.errors import ConfigError, Problem

KeyPath: TypeAlias = tuple[str | int, ...]

MAX_PROBLEMS = 100
_PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]{1,64}")


class Broken:
    """Stands for a value that could not be read and is already reported; checks pass over it."""


BROKEN = Broken()


class Place(NamedTuple):
    """Where a value was written; places sort in reading order, the file before the command line."""

    override: int
    """0 for the file, else the number of the ``--set`` option, from 1."""
    line: int = 0
    """Line, from 1."""
    column: int = 0
    """Column, from 1."""


def dotted(path: KeyPath) -> str:
    """Return `path` the way users write it, such as ``controllers[0].gains.k``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if _PLAIN_KEY.fullmatch(part) else shortened(part))
    return text


def shortened(text: str, limit: int = 64) -> str:
    """Return `text` quoted, on one line, in at most about `limit` characters."""
    return ascii(text) if len(text) <= limit else ascii(text[:limit]) + "..."


class Document:
    """A config between reading and checking: a tree of plain values that may still be edited."""

    def __init__(self, filename: str) -> None:
        self.filename = filename if filename.isprintable() else ascii(filename)
        self.root: Any = None
        self.overrides: list[str] = []
        self._keys: dict[KeyPath, Place] = {}
        self._values: dict[KeyPath, Place] = {}
        self._found: list[tuple[Place, Problem]] = []
        self._more = False

    def twin(self) -> Document:
        """Return another document of the same content and places, without mistakes so far."""
        other = Document(self.filename)
        other.root, other.overrides = copy.deepcopy(self.root), list(self.overrides)
        other._keys, other._values = dict(self._keys), dict(self._values)
        return other

    def mark(self, path: KeyPath, key: Place | None, value: Place) -> None:
        """Record where a key and its value were written."""
        if key is not None:
            self._keys[path] = key
        self._values[path] = value

    def forget(self, path: KeyPath) -> None:
        """Drop the places of `path` and of everything below it."""
        for places in (self._keys, self._values):
            for known in [p for p in places if p[: len(path)] == path]:
                del places[known]

    def place(self, path: KeyPath, at: Literal["key", "value"] = "value") -> Place:
        """Return where `path` was written, or the nearest enclosing key when it was not written at all."""
        first = self._keys if at == "key" else self._values
        if path in first:
            return first[path]
        for length in range(len(path), -1, -1):
            for places in (self._keys, self._values):
                if path[:length] in places:
                    return places[path[:length]]
        return Place(0, 1, 1)

    def overridden(self, path: KeyPath) -> bool:
        """Whether an override names this very key, so that it may replace what the file gives."""
        return path in self._keys and self._keys[path].override > 0

    def where(self, place: Place) -> str:
        """Return `place` as text: ``file:line:column``, or the command-line option."""
        if place.override:
            return f"--set {self.overrides[place.override - 1]}"
        return f"{self.filename}:{place.line}:{place.column}" if place.line else self.filename

    @property
    def full(self) -> bool:
        """Whether so many mistakes were found that looking for more is no help."""
        return self._more

    def add(
        self, path: KeyPath, message: str, at: Literal["key", "value"] = "value", place: Place | None = None
    ) -> None:
        """Record a mistake.

        Args:
            path: The offending key.
            message: What was got and what was wanted.
            at: Whether the mistake is in the key's name or in its value.
            place: Where it is, when that is not where `path` was written.
        """
        if len(self._found) >= MAX_PROBLEMS:
            self._more = True
            return
        place = self.place(path, at) if place is None else place
        self._found.append((place, Problem(self.where(place), dotted(path), message)))

    def fail(self, message: str, place: Place) -> NoReturn:
        """Record one last mistake and raise them all.

        Raises:
            ConfigError: always.
        """
        self.add((), message, place=place)
        raise ConfigError(self._sorted())

    @property
    def found(self) -> list[tuple[Place, Problem]]:
        """The mistakes found so far, each with its place, in the order they were found."""
        return list(self._found)

    def raise_problems(self) -> None:
        """Raise every mistake found so far, in reading order.

        Raises:
            ConfigError: there is at least one.
        """
        if self._found:
            raise ConfigError(self._sorted())

    def _sorted(self) -> list[Problem]:
        problems = [problem for _, problem in sorted(self._found, key=lambda found: found[0])]
        if self._more:
            problems.append(Problem(self.filename, "", f"there are more mistakes than these {MAX_PROBLEMS}"))
        return problems
