"""Estimates the work of a sweep in runs, steps, time, memory and disk; refuses sweeps that must be a mistake."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from torquebench.experiment.sweep_section import Worst
from torquebench.sweep.executors import Executor
from torquebench.sweep.plan import Plan
from torquebench.sweep.table import empty_columns
from torquebench.sweep.worker import Worker

SHARD_STEPS = 250_000
"""Control instants in a shard, about: half a second's work, which is all that a power cut costs."""
LEAST_SHARDS, MOST_SHARDS = 16, 4000
"""Least and greatest number of shards: enough for all workers, few enough for a folder."""
SAMPLES = 5
"""Pairs that are timed."""
SLOWEST = 2_000_000
"""Control instants in a pair from which no pair is timed."""
USUAL_RATE = 3e5
"""Control instants a second, assumed where no pair is timed."""
ARRAYS = 24
"""(N, n) arrays of 8-byte numbers alive at once in a worker."""
PROCESS_BYTES = 250 << 20
"""Memory of an idle process."""
STORED = 12
"""(N, n) arrays in a trajectory's file, about."""
CSV_NUMBER = 20
"""Characters of a number in the CSV file, about."""
SUMMING_UP, SUMMING_UP_ROW = 0.4, 5e-5
"""Time of table, summary and page: in what it takes to import this package, and in seconds a row."""
MOST_STEPS, MOST_HOURS, MEMORY_SHARE, DISK_SHARE = 2e10, 12.0, 0.8, 0.9
"""Caps: control instants, time, and shares of the machine's memory and of the disk's free space."""


class Estimate(NamedTuple):
    """Work and resources that a sweep takes."""

    runs: int
    steps: int
    seconds: float
    """Time of the whole command [s]."""
    so_far: float
    """Of it what has passed already, compilation in it [s]."""
    running: float
    """Of it the time that the workers run [s]."""
    memory: int
    """Bytes on this machine."""
    disk: int
    """Bytes."""

    def refusals(self, folder: Path) -> list[str]:
        """Return the caps that the sweep exceeds, in words.

        Args:
            folder: Where the sweep would be stored.
        """
        found = []
        if self.steps > MOST_STEPS:
            found.append(f"{self.steps:.3g} steps, at most {MOST_STEPS:.0e} are run")
        if self.seconds > 3600.0 * MOST_HOURS:
            found.append(f"about {duration(self.seconds)}, at most {MOST_HOURS:g} h are spent")
        if hasattr(os, "sysconf"):  # not on Windows, where memory has no cap
            memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
            if self.memory > MEMORY_SHARE * memory:
                found.append(f"{size(self.memory)} of memory, there are {size(memory)}")
        while not folder.exists():
            folder = folder.parent
        free = shutil.disk_usage(folder).free
        if self.disk > DISK_SHARE * free:
            found.append(f"{size(self.disk)} on disk, {size(free)} are free")
        return found


def shard_size(plan: Plan, steps: Sequence[int]) -> int:
    """Return the number of (case, draw) pairs in a shard; it depends on the sweep alone.

    Args:
        plan: The sweep.
        steps: Number of control instants of a loop of each case.
    """
    each = len(plan.controllers) * sum(steps) / len(steps)
    least, most = -(-plan.pairs // MOST_SHARDS), max(1, plan.pairs // LEAST_SHARDS)
    return max(least, min(most, max(1, round(SHARD_STEPS / each))))


def estimate(
    plan: Plan, steps: Sequence[int], executor: Executor, begun: float = math.nan, ready: float = 0.0
) -> Estimate:
    """Time a few runs of a sweep, and return what all of it takes.

    Args:
        plan: The sweep.
        steps: Number of control instants of a loop of each case.
        executor: What is to run it.
        begun: When the command began, on the clock `time.perf_counter` [s]; now by default.
        ready: Time that this process took to import what a worker needs [s].
    """
    begun = time.perf_counter() if math.isnan(begun) else begun
    controllers = len(plan.controllers)
    total, trajectory = controllers * plan.draws * sum(steps), 8 * plan.first.n * max(steps)
    columns = empty_columns(plan, 0).values()
    row = sum(column.dtype.itemsize for column in columns)
    keep = plan.keys.keep
    kept = min(plan.rows, keep.worst * controllers) if isinstance(keep, Worst) else plan.rows * (keep == "all")
    work, shards = seconds_per_step(plan, steps) * total, -(-plan.pairs // shard_size(plan, steps))
    running = running_time(work, shards, executor, os.cpu_count() or 1, ready)
    so_far = time.perf_counter() - begun
    return Estimate(
        runs=plan.rows,
        steps=total,
        seconds=so_far + running + SUMMING_UP * ready + SUMMING_UP_ROW * plan.rows,
        so_far=so_far,
        running=running,
        memory=PROCESS_BYTES * (1 + executor.processes) + max(1, executor.here) * ARRAYS * trajectory + plan.rows * row,
        disk=plan.rows * (2 * row + CSV_NUMBER * len(columns)) + kept * STORED * trajectory,
    )


def running_time(work: float, shards: int, executor: Executor, cores: int, ready: float) -> float:
    """Return how long the workers of a sweep take from their start to the last shard [s].

    Workers of this machine share its cores, and each process has to get ready first. Shards take equally long: those
    that are left over in the end leave some workers idle.

    Args:
        work: Time of all shards on one worker [s].
        shards: Number of shards.
        executor: What runs them.
        cores: Number of processors of this machine.
        ready: Time that a process takes to get ready on a core of its own [s].
    """
    at_once = max(1, min(executor.count, cores) if executor.here else executor.count)
    return ready * -(-executor.processes // cores) + work / shards * -(-shards // at_once)


def seconds_per_step(plan: Plan, steps: Sequence[int]) -> float:
    """Return the time that a control instant takes on one worker [s], from a few pairs spread over the sweep.

    Args:
        plan: The sweep.
        steps: Number of control instants of a loop of each case.
    """
    if len(plan.controllers) * max(steps) > SLOWEST:
        return 1.0 / USUAL_RATE
    worker, spent, run = Worker(plan), 0.0, 0
    list(worker.pair(0, 0))  # whatever has to be compiled is compiled now
    for pair in np.linspace(0, plan.pairs - 1, min(SAMPLES, plan.pairs), dtype=int).tolist():
        case, draw = divmod(pair, plan.draws)
        start = time.perf_counter()
        run += steps[case] * len(list(worker.pair(case, draw)))
        spent += time.perf_counter() - start
    return spent / run


def duration(seconds: float) -> str:
    """Return a time in words."""
    if seconds < 90.0:
        return f"{math.ceil(seconds)} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.3g} h"


def size(count: float) -> str:
    """Return a number of bytes in words."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} TB"
