"""What a contract test found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from torquebench.dialect.source import Complaint
from torquebench.laws import Law

PASS, FAIL, NOTE = "pass", "FAIL", "note"
"""Held; did not hold; nothing to hold, but worth knowing."""


class Check(NamedTuple):
    """One thing that was tried."""

    name: str
    verdict: str
    """PASS, FAIL or NOTE."""
    detail: str
    """What was tried, or what went wrong and where."""


class Cost(NamedTuple):
    """Time that one call of the law takes, medians [us]."""

    python: float
    native: float | None
    """None for a law that is not compiled."""


@dataclass
class Report:
    """The result of a contract test: its checks in the order in which they were made."""

    law: str
    file: str
    line: int
    """Where the law stands."""
    checks: list[Check] = field(default_factory=list)
    complaints: list[Complaint] = field(default_factory=list)
    """What keeps the law from being compiled."""
    cost: Cost | None = None

    @property
    def held(self) -> bool:
        """Whether everything held."""
        return all(check.verdict != FAIL for check in self.checks)

    def add(self, name: str, wrong: str, right: str, verdict: str = FAIL) -> None:
        """Add a check.

        Args:
            name: Its name.
            wrong: What was wrong; empty when it held.
            right: What was tried.
            verdict: FAIL or NOTE, for when something was wrong.
        """
        self.checks.append(Check(name, verdict if wrong else PASS, wrong or right))

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain data."""
        return {
            "law": self.law,
            "file": self.file,
            "line": self.line,
            "held": self.held,
            "checks": [check._asdict() for check in self.checks],
            "complaints": [{"line": c.line, "what": c.what, "cure": c.cure} for c in self.complaints],
            "cost_us": None if self.cost is None else self.cost._asdict(),
        }

    def __str__(self) -> str:
        width = max((len(check.name) for check in self.checks), default=0)
        rows = [f"{check.verdict}  {check.name:<{width}}  {check.detail}" for check in self.checks]
        places = [f"{Path(self.file).name}:{c.line}: {c.what}: {c.cure}" for c in self.complaints]
        return "\n".join([f"law '{self.law}' ({self.file}, line {self.line})", *rows, *places])


def report_of(law: Law) -> Report:
    """Return an empty report on a law."""
    code = getattr(getattr(law.function, "py_func", law.function), "__code__", None)
    return Report(law.name, getattr(code, "co_filename", "no file"), getattr(code, "co_firstlineno", 0))
