"""Timing: medians of rounds, ratios within one run, and nothing else counted."""

from __future__ import annotations

from itertools import count

import pytest

from benchmarks import timing
from benchmarks.timing import Case, measure


class Clock:
    """A clock that goes on only when work is done."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        """Tell the time [s]."""
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Put a clock of the test's own in the place of the machine's."""
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    return clock


def case(clock: Clock, name: str, seconds: list[float], **options: object) -> Case:
    """Return a case whose k-th call takes seconds[k]; the first is the one that does not count."""
    calls = count()

    def run() -> None:
        clock.now += seconds[next(calls)]

    return Case(name, run, 100, **options)  # type: ignore[arg-type]


def test_the_first_round_does_not_count_and_the_median_of_the_others_does(clock: Clock) -> None:
    """100 units in 1, 2 and 5 s are 50 units/s at the median, however long the warm-up took."""
    (row,) = measure([case(clock, "a", [1000.0, 1.0, 5.0, 2.0])], 3)
    assert (row.value, row.rounds, row.ratio, row.against) == (50.0, 3, None, "")
    assert row.spread[0] <= row.value <= row.spread[1]


def test_the_ratio_is_of_medians_with_as_many_threads(clock: Clock) -> None:
    """A case of two threads is held against the case of two threads, not against its namesake of one."""
    rows = measure(
        [
            case(clock, "open", [1.0] * 4),
            case(clock, "open", [0.5] * 4, threads=2),
            case(clock, "closed", [2.0] * 4, against="open"),
            case(clock, "closed", [0.25] * 4, against="open", threads=2),
        ],
        3,
    )
    assert [row.ratio for row in rows] == [None, None, 0.5, 2.0]
    assert [row.threads for row in rows] == [1, 2, 1, 2]


def test_slow_cases_run_fewer_rounds(clock: Clock) -> None:
    """A case with at most two rounds runs three times in all, warm-up included."""
    fast, slow = measure([case(clock, "f", [1.0] * 9), case(clock, "s", [1.0] * 3, most=2)], 8)
    assert (fast.rounds, slow.rounds) == (8, 2)


def test_cases_take_turns_in_changing_order(clock: Clock) -> None:
    """Every round runs every case once, and not always in the same order."""
    seen: list[str] = []
    cases = [Case(name, lambda name=name: seen.append(name), 1) for name in "abcd"]  # type: ignore[misc]
    for c in cases:
        assert c.amount == 1
    ticking = count()
    clock.perf_counter = lambda: float(next(ticking))  # type: ignore[method-assign]
    measure(cases, 5)
    rounds = [tuple(seen[i : i + 4]) for i in range(0, 24, 4)]
    assert all(sorted(r) == list("abcd") for r in rounds)
    assert len(set(rounds)) > 1
