"""Speed against peers, as ratios within one run; `torquebench bench` loads this folder from the checkout."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.loops import closed_loops
from benchmarks.parts import parts
from benchmarks.peers import peers
from benchmarks.timing import Row, measure
from benchmarks.tuning import tunings


def run(
    duration: float, rounds: int, threads: int, started: Callable[[int], None], progress: Callable[[str], None]
) -> tuple[list[Row], list[str]]:
    """Time every case and return the rows, and what was left out and why.

    Args:
        duration: Length of a closed loop [s].
        rounds: How often each case is timed.
        threads: Threads of the largest case.
        started: Called with the number of timings to come.
        progress: Called with a case's name before each timing.
    """
    others, left_out = peers()
    cases = closed_loops(duration, threads) + parts() + tunings(threads) + others
    started(sum(min(case.most, rounds) + 1 for case in cases))
    return measure(cases, rounds, progress), left_out
