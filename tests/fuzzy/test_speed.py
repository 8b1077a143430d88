"""What inference costs inside a compiled loop; the limit leaves room for a busy machine."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from torquebench.fuzzy import Fis, builtin_system, infer, prepare
from torquebench.kernel import Array, kernel

ROUNDS, INSTANTS, JOINTS = 200, 5000, 6


@kernel
def all_joints(fis: Fis, x: Array, y: Array) -> float:
    """Infer for each joint (a column) at each instant (a row)."""
    total = 0.0
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            total += infer(fis, x[k, i], y[k, i])
    return total


def test_six_joints_with_49_rules(figure: Callable[[str, float, str], None]) -> None:
    """The median over 200 rounds of random inputs, which cross all 49 rules and cannot be guessed by the processor."""
    fis = prepare(builtin_system("pd-49")).fis
    x, y = np.random.default_rng(0).uniform(-1.05, 1.05, (2, INSTANTS, JOINTS))
    all_joints(fis, x, y)
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter_ns()
        all_joints(fis, x, y)
        times.append(time.perf_counter_ns() - start)
    microseconds = statistics.median(times) / INSTANTS / 1e3
    figure("six joints with 49 rules, exact [us]", microseconds, "<= 0.1")
    assert microseconds < 0.3
