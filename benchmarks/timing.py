"""Timing of several cases in turn, so that a noisy machine is noisy for all of them alike."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

Speeds: TypeAlias = dict[tuple[str, int], list[float]]
"""Speeds of each round, by a case's name and threads."""


@dataclass(frozen=True, slots=True)
class Case:
    """Something whose speed is measured."""

    name: str
    """Unique together with `threads`."""
    run: Callable[[], None]
    """Do the work once."""
    amount: int
    """Units of work one call of `run` does: steps, or calls."""
    against: str = ""
    """Name of the case with as many threads that it is compared with; empty for none."""
    threads: int = 1
    """Threads the work is spread over."""
    note: str = ""
    """What exactly is done, in words."""
    unit: str = "steps/s"
    """``steps/s``, ``calls/s`` or ``loops/s``."""
    most: int = 1_000_000
    """Rounds at most, for cases too slow for all of them."""


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one case."""

    name: str
    value: float
    """Median speed."""
    unit: str
    against: str
    """What it is compared with; empty for none."""
    ratio: float | None
    """Median speed over the median speed of `against`, both in this run."""
    spread: tuple[float, float]
    """Quartiles of the speed over the rounds."""
    threads: int
    rounds: int
    note: str


def measure(cases: Sequence[Case], rounds: int, progress: Callable[[str], None] | None = None) -> list[Row]:
    """Time every case once a round, in an order drawn anew each round, after one round that does not count.

    Args:
        cases: What to time; `Case.against` names another of them.
        rounds: How often.
        progress: Called with each case's name before it runs.
    """
    speeds: Speeds = {(case.name, case.threads): [] for case in cases}
    order, shuffle = list(cases), random.Random(0).shuffle
    for turn in range(rounds + 1):
        shuffle(order)
        for case in order:
            if turn > case.most:
                continue
            if progress is not None:
                progress(case.name)
            start = time.perf_counter()
            case.run()
            elapsed = time.perf_counter() - start
            if turn > 0:
                speeds[case.name, case.threads].append(case.amount / elapsed)
    return [_row(case, speeds) for case in cases]


def _row(case: Case, speeds: Speeds) -> Row:
    own = speeds[case.name, case.threads]
    median = statistics.median(own)
    ratio = median / statistics.median(speeds[case.against, case.threads]) if case.against else None
    low, _, high = statistics.quantiles(own, n=4) if len(own) > 1 else (median, median, median)
    return Row(case.name, median, case.unit, case.against, ratio, (low, high), case.threads, len(own), case.note)
