"""Running a sweep from wherever it stands: the missing shards, the final table, the worst trajectories."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.experiment.store import RunDirectory, atomic_write, claim_folder
from torquebench.experiment.sweep_section import Worst
from torquebench.metrics import METRICS
from torquebench.sweep.checking import check_plan
from torquebench.sweep.estimate import shard_size
from torquebench.sweep.executors import Executor, Processes
from torquebench.sweep.folder import (
    PLAN,
    TRAJECTORIES,
    StoredSweep,
    create_sweep,
    lock_folder,
    open_sweep,
    read_column,
    refuse_changes,
    seal_sweep,
    verify,
    write_table,
)
from torquebench.sweep.plan import Plan
from torquebench.sweep.table import REFUSED
from torquebench.sweep.worker import Task, Worker, write_trajectory

MoreFiles: TypeAlias = Callable[[StoredSweep], Iterable[tuple[str, bytes]]]
"""Makes further files of a sweep that has its final table: name and content of each."""


class State(NamedTuple):
    """Progress of a sweep."""

    complete: frozenset[int]
    """Shards that are complete."""
    damaged: frozenset[int]
    """Shards whose files are not as they were written; they are run again."""
    missing: tuple[int, ...]
    """Shards to run, the damaged ones among them."""
    rows: int
    """Number of rows that are done."""


def state_of(stored: StoredSweep) -> State:
    """Return how far a sweep is; every shard that is there is read and verified."""
    there = [shard for shard in range(stored.shards) if stored.shard_path(shard).is_file()]
    complete = frozenset(shard for shard in there if stored.read_shard(shard) is not None)
    missing = tuple(shard for shard in range(stored.shards) if shard not in complete)
    return State(complete, frozenset(there) - complete, missing, sum(map(stored.rows_in, complete)))


def run_sweep(
    plan: Plan,
    folder: Path | None = None,
    executor: Executor | None = None,
    *,
    progress: Callable[[int, int], None] = lambda done, rows: None,
    more: MoreFiles = lambda stored: (),
) -> StoredSweep:
    """Check and run a sweep, or what is left of it; a finished one is verified and returned.

    Args:
        plan: The sweep.
        folder: Where to store it: a new or empty folder, or one in which this sweep was started; None for a temporary
            one, which is removed when the interpreter ends.
        executor: What runs the shards; None for a process per core.
        progress: Called with the number of rows that are done, and of all rows.
        more: Makes further files from the final table.

    Raises:
        ConfigError: the plan has mistakes, or the folder holds something else.
        ResultError: a worker died, another process is running this sweep, or a file of a finished one was altered.
        OSError: a file could not be written; what is stored is kept, and running the sweep again goes on with it.
    """
    executor = Processes(os.cpu_count() or 1) if executor is None else executor
    survey = check_plan(plan)
    if folder is not None and (folder / PLAN).is_file():
        stored = open_sweep(folder, plan.source.plugins, "folder")
        refuse_changes(stored, plan, "folder")
        if stored.finished:
            verify(stored)
            return stored
    else:
        if folder is None:
            folder = Path(tempfile.mkdtemp(prefix="torquebench-sweep-"))
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
        stored = create_sweep(RunDirectory(claim_folder(folder, plan.first.name)), plan, shard_size(plan, survey.steps))
    executor.prepare(plan.source)
    state = state_of(stored)
    done = state.rows

    def report(rows: int) -> None:
        nonlocal done
        done += rows
        progress(done, plan.rows)

    report(0)
    finish(stored, state, executor, report, more)
    return stored


def finish(
    stored: StoredSweep,
    state: State,
    executor: Executor,
    progress: Callable[[int], None] = lambda rows: None,
    more: MoreFiles = lambda stored: (),
) -> None:
    """Run the missing shards, write the table and what is made of it, and last the manifest.

    Args:
        stored: The sweep.
        state: How far it is.
        executor: What runs the shards; each is stored as soon as it is done.
        progress: Called with the number of rows of each shard that has been stored.
        more: Makes further files from the final table.

    Raises:
        ResultError: a worker died, another process is running this sweep, or a shard was altered.
        OSError: a file could not be written.
    """
    trajectories, keep = stored.folder / TRAJECTORIES, stored.plan.keys.keep
    with lock_folder(stored):
        for torn in stored.folder.rglob(".*.tmp"):  # unfinished files of a killed process
            torn.unlink(missing_ok=True)
        if keep != "none":
            trajectories.mkdir(exist_ok=True)
        task = Task(stored.plan.source, stored.facts.shard_size, trajectories.resolve() if keep == "all" else None)
        for shard, table in executor.run(task, state.missing):
            stored.write_shard(shard, table)
            progress(stored.rows_in(shard))
        outcomes = write_table(stored)
        worst = worst_rows(stored, keep) if isinstance(keep, Worst) else []
        worker = Worker(stored.plan)
        for index in worst:
            row = stored.plan.row(index)
            for i, ended in enumerate(worker.pair(row.case, row.draw)):
                if i == row.controller and ended.run is not None:
                    write_trajectory(trajectories, index, stored.plan.controllers[i], ended.run)
        names = []
        for name, content in more(stored):
            (stored.folder / name).parent.mkdir(exist_ok=True)
            atomic_write(stored.folder / name, content)
            names.append(name)
        seal_sweep(stored, {"outcomes": outcomes, "worst": worst}, names)


def worst_rows(stored: StoredSweep, keep: Worst) -> list[int]:
    """Return the rows whose trajectories are to be kept, controller by controller, the worst first.

    A failed run is worse than any other, the earlier it fails the worse; then come runs for which the metric is not
    defined; of equal ones the first. Rows that could not be built never ran, and are left out.

    Args:
        stored: The sweep, with its final table.
        keep: How many, and by which metric.
    """
    count, failed_at, value = (
        len(stored.plan.controllers),
        read_column(stored, "failed_at"),
        read_column(stored, keep.by),
    )
    higher = METRICS[keep.by].better == "higher"
    badness = np.where(np.isnan(value), np.inf, -value if higher else value)
    early = np.where(np.isnan(failed_at), np.inf, failed_at)
    order = np.lexsort((np.arange(len(value)), -badness, early))
    order = order[read_column(stored, "outcome")[order] != REFUSED]
    return [int(i) for own in range(count) for i in order[order % count == own][: keep.worst]]
