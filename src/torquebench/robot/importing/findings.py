"""What an import says of the parts of a published arm: kept, mapped, dropped or refused, each with place and reason."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

from torquebench.errors import ConfigError, Problem

Verdict = Literal["kept", "mapped", "dropped", "refused"]
VERDICTS: tuple[Verdict, ...] = ("kept", "mapped", "dropped", "refused")


class Part(NamedTuple):
    """What became of some parts of a published arm, all for the same reason."""

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
        super().__init__(
            Problem(str(path), "", f"{part.what} of {', '.join(part.places)}" if part.places else part.what, note=note)
            for part in refused
            for note in [part.reason]
        )

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags that take all that was refused, as far as flags can: ``("--fix", "left_finger")``."""
        return tuple(word for pair in dict.fromkeys(part.flags for part in self.findings) for word in pair)
