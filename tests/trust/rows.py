"""Rows of the table: a promise, how it is attacked, how often; each declares itself with `@row` in one file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from torquebench.registry import docstring

Attack = Callable[[Any, int], Iterator[str]]
"""Called with the workshop and the number of tries; yields for each try what was wrong, or an empty text."""


class Unavailable(Exception):
    """A row cannot be run here; the text says what it lacks."""


@dataclass(frozen=True)
class Row:
    """A promise under attack."""

    name: str
    promise: str
    how: str
    """How it is attacked, in words."""
    sizes: dict[str, int]
    """Tries of the sizes ``tiny`` (a sixth of ``ci``), ``ci``, ``nightly`` (a tenth of a release) and ``release``."""
    attack: Attack


@dataclass(frozen=True)
class Counted:
    """What came of a row."""

    name: str
    promise: str
    how: str
    tried: int
    wrong: int
    findings: list[str] = field(default_factory=list)
    """The first that were wrong, in words."""
    cpu_seconds: float = 0.0
    left_out: str = ""
    """Why the row was not run to its end; empty if it was."""


ROWS: dict[str, Row] = {}


def row(name: str, promise: str, ci: int, release: int) -> Callable[[Attack], Attack]:
    """Declare a row; the docstring of the attack says how.

    Args:
        name: One word.
        promise: What users may rely on, in one sentence.
        ci: Tries of the usual size.
        release: Tries of the large one.
    """

    def declare(attack: Attack) -> Attack:
        how = docstring(attack).partition("\n")[0].rstrip(".")
        sizes = {"tiny": -(-ci // 6), "ci": ci, "nightly": max(ci, release // 10), "release": release}
        ROWS[name] = Row(name, promise, how, sizes, attack)
        return attack

    return declare
