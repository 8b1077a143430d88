"""Findings of an import on the parts of a published arm: kept, mapped, dropped or refused, with place and reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

from torquebench.errors import ConfigError, Problem
from torquebench.robot.mjcf_text import named_places

Verdict = Literal["kept", "mapped", "dropped", "refused"]
VERDICTS: tuple[Verdict, ...] = ("kept", "mapped", "dropped", "refused")

LIMITS = "torque limits"
"""Name of torque limits among findings."""


class Part(NamedTuple):
    """Finding on parts of a published arm that share one verdict and one reason."""

    verdict: Verdict
    what: str
    """Kind of part, as ``joint damping``."""
    places: tuple[str, ...]
    """Names of the parts in the file."""
    reason: str
    flags: tuple[str, ...] = ()
    """Flags of ``torquebench import`` that take a refused part: ``("--fix", "left_finger")``."""


class RefusedArmError(ConfigError):
    """A published arm cannot be made into a plain chain; `findings` has all that was found, not the refused alone."""

    def __init__(self, path: Path, findings: Iterable[Part]) -> None:
        self.findings = tuple(findings)
        refused = [part for part in self.findings if part.verdict == "refused"]
        places = named_places(path)
        super().__init__(_mistake(path, part, places) for part in refused)

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags that take all that was refused, as far as flags can: ``("--fix", "left_finger")``."""
        return tuple(word for pair in dict.fromkeys(part.flags for part in self.findings) for word in pair)

    @property
    def without_limit(self) -> tuple[str, ...]:
        """Joints whose torque limit nothing states, in the arm's order."""
        return next((part.places for part in self.findings if part[:2] == ("refused", LIMITS)), ())


_OF_BODIES = ("branches", "inertia", "gravity", "free joint", "ball joint")
"""Words that mark a finding as one about bodies; a joint may have the same name."""


def _mistake(path: Path, part: Part, places: Mapping[str, Sequence[Problem]]) -> Problem:
    """Return what is refused of a published arm, at the place of the first of its parts that has a name.

    Args:
        path: The file.
        part: What is refused.
        places: Elements of the file by their names.
    """
    text = f"{part.what} of {', '.join(part.places)}" if part.places else part.what
    problem = Problem(str(path), text=text, note=part.reason)
    names = [name.removeprefix("body ") for name in part.places]
    found = next((places[name] for name in names if name in places), ())
    wanted = ("body", "link") if any(word in part.what for word in _OF_BODIES) else ("joint",)
    for element in sorted(found, key=lambda element: element.text not in wanted)[:1]:
        return replace(problem, source=element.source, line=element.line, column=element.column)
    return problem
