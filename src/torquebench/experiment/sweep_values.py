"""What a sweep varies: keys with their values, distributions to draw from, and how values stand in tables."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

from torquebench.experiment.document import Place, shortened
from torquebench.experiment.sweep_schema import Worst


class Value(NamedTuple):
    """One value of a key."""

    raw: Any
    """As in a config."""
    word: float | str
    """As in tables."""
    place: Place


class Axis(NamedTuple):
    """A key of the grid."""

    key: str
    place: Place
    values: tuple[Value, ...]

    @property
    def numeric(self) -> bool:
        """Whether tables show it as numbers."""
        return all(isinstance(value.word, float) for value in self.values)


class Random(NamedTuple):
    """A random key."""

    key: str
    place: Place
    kind: str
    """``uniform``, ``log_uniform``, ``normal`` or ``choice``."""
    numbers: tuple[float, ...]
    """Ends, or mean and standard deviation; none of a choice."""
    choices: Axis | None = None


class SweepKeys(NamedTuple):
    """A sweep's section without mistakes."""

    draws: int
    axes: tuple[Axis, ...]
    random: tuple[Random, ...]
    keep: str | Worst

    def plain(self) -> dict[str, Any]:
        """Return what decides results, as plain values."""
        return {
            "draws": self.draws,
            "grid": [[axis.key, [[value.word, value.raw] for value in axis.values]] for axis in self.axes],
            "random": [
                [r.key, r.kind, list(r.numbers), [[v.word, v.raw] for v in r.choices.values] if r.choices else []]
                for r in self.random
            ],
            "keep": self.keep if isinstance(self.keep, str) else self.keep.model_dump(),
        }


def between(low: float, high: float, share: float, log: bool) -> float:
    """Return what lies a share of the way from one number to another, to 15 digits, so that 0.3 is 0.3.

    Args:
        low, high: The ends.
        share: 0 to 1; at the ends the numbers themselves come out.
        log: Whether steps are equal ratios instead of equal differences.
    """
    if share in (0.0, 1.0):
        return high if share else low
    x = math.exp(math.log(low) * (1.0 - share) + math.log(high) * share) if log else low + (high - low) * share
    return float(f"{x:.15g}") + 0.0


def in_tables(value: Any) -> float | str:
    """Return a config's value as it stands in tables: a number, or a word."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return float(value)
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"), default=str)


def in_words(word: float | str) -> str:
    """Return a value of a table in words."""
    return f"{word:.12g}" if isinstance(word, float) else shortened(word)[1:-1]
