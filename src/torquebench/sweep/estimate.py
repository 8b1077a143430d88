"""How much work a sweep is: runs, steps, time, memory and disk; refuses what must be a mistake."""

from __future__ import annotations

import math
import os
import shutil
import time
from pathlib import Path
from typing import NamedTuple

from torquebench.experiment.sweep_section import Worst
from torquebench.sweep.checking import Survey
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
MOST_STEPS, MOST_HOURS, MEMORY_SHARE, DISK_SHARE = 2e10, 12.0, 0.8, 0.9
"""Caps: control instants, time, and shares of the machine's memory and of the disk's free space."""


class Estimate(NamedTuple):
    """Work and resources that a sweep takes."""

    runs: int
    steps: int
    seconds: float
    """Time on the given number of workers [s]."""
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


def shard_size(plan: Plan, survey: Survey) -> int:
    """Return the number of (case, draw) pairs in a shard; it depends on the sweep alone.

    Args:
        plan: The sweep.
        survey: What checking it found out.
    """
    each = len(plan.controllers) * sum(survey.steps) / len(survey.steps)
    size = max(1, round(SHARD_STEPS / each))
    size = min(size, max(1, plan.pairs // LEAST_SHARDS))
    return max(size, -(-plan.pairs // MOST_SHARDS))


def estimate(plan: Plan, survey: Survey, workers: int, processes: int, here: int) -> Estimate:
    """Time a few runs of a sweep, and return what all of it takes.

    Args:
        plan: The sweep.
        survey: What checking it found out.
        workers: Number of shards that run at once.
        processes: Number of worker processes on this machine.
        here: Number of shards that run at once on this machine.
    """
    controllers = len(plan.controllers)
    steps = controllers * plan.draws * sum(survey.steps)
    longest, n = max(survey.steps), plan.first.n
    row = sum(column.dtype.itemsize for column in empty_columns(plan, 0).values())
    text = CSV_NUMBER * len(empty_columns(plan, 0))
    kept = {"none": 0, "all": plan.rows}.get(str(plan.keys.keep), 0)
    if isinstance(plan.keys.keep, Worst):
        kept = min(plan.rows, plan.keys.keep.worst * controllers)
    return Estimate(
        runs=plan.rows,
        steps=steps,
        seconds=seconds_per_step(plan, survey) * steps / workers,
        memory=PROCESS_BYTES * (1 + processes) + max(1, here) * ARRAYS * 8 * n * longest,
        disk=plan.rows * (2 * row + text) + kept * STORED * 8 * n * longest,
    )


def seconds_per_step(plan: Plan, survey: Survey) -> float:
    """Return the time that a control instant takes on one worker [s], from a few pairs spread over the sweep."""
    controllers = len(plan.controllers)
    if controllers * max(survey.steps) > SLOWEST:
        return 1.0 / USUAL_RATE
    worker, spent, steps = Worker(plan), 0.0, 0
    count = min(SAMPLES, plan.pairs)
    pairs = [i * (plan.pairs - 1) // max(1, count - 1) for i in range(count)]
    for _ in worker.pair(0, 0):  # whatever has to be compiled is compiled now
        pass
    for pair in pairs:
        case, draw = divmod(pair, plan.draws)
        start = time.perf_counter()
        steps += survey.steps[case] * sum(1 for _ in worker.pair(case, draw))
        spent += time.perf_counter() - start
    return spent / steps


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
