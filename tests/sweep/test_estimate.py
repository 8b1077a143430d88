"""Estimates of what a sweep takes: the arithmetic, whatever the machine."""

from __future__ import annotations

import time

import pytest

from tests.sweep.examples import SMALL, plan_of
from torquebench.sweep import estimate as module
from torquebench.sweep.checking import check_plan
from torquebench.sweep.estimate import SUMMING_UP, SUMMING_UP_ROW, estimate, running_time
from torquebench.sweep.executors import Executor, Processes, Threads

WORK, SHARDS = 120.0, 12


@pytest.mark.parametrize(
    ("executor", "cores", "wanted"),
    [
        (Threads(1), 8, 120.0),
        (Threads(4), 8, 30.0),
        (Threads(4), 2, 60.0),  # threads beyond the cores gain nothing
        (Threads(5), 8, 30.0),  # three rounds of shards: 5, 5, 2
        (Threads(24), 24, 10.0),  # no more at once than there are shards
        (Processes(4), 8, 32.0),  # each is ready after 2 s, side by side
        (Processes(4), 2, 64.0),  # two after two
    ],
)
def test_running_takes_the_rounds_of_shards_and_the_start_of_processes(
    executor: Executor, cores: int, wanted: float
) -> None:
    """Shards of 10 s each; workers beyond the cores only cost their start."""
    assert running_time(WORK, SHARDS, executor, cores, 2.0) == pytest.approx(wanted, rel=1e-12)


def test_the_whole_is_what_has_passed_the_runs_and_what_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compilation, which comes before the estimate, is in it: a command that began 100 s ago takes longer than that."""
    plan = plan_of(SMALL)
    steps = check_plan(plan).steps
    monkeypatch.setattr(module, "seconds_per_step", lambda plan, steps: 1e-3)
    found = estimate(plan, steps, Threads(1), begun=time.perf_counter() - 100.0, ready=3.0)
    assert found.steps == 72 * 600
    assert found.running == pytest.approx(43.2, rel=1e-12)
    assert found.so_far >= 100.0
    after = SUMMING_UP * 3.0 + SUMMING_UP_ROW * 72
    assert found.seconds == pytest.approx(found.so_far + found.running + after, rel=1e-12)
