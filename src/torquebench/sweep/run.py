"""Running a sweep from wherever it stands: the shards that are missing, the final table, the worst trajectories."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.errors import ResultError
from torquebench.experiment.store import atomic_write, check_run
from torquebench.experiment.sweep_schema import Worst
from torquebench.metrics import METRICS
from torquebench.sweep.executors import Executor
from torquebench.sweep.form import REFUSED
from torquebench.sweep.results import finish, read_column, write_results
from torquebench.sweep.shards import Shards
from torquebench.sweep.store import TRAJECTORIES, Stored
from torquebench.sweep.work import Task, Worker, keep


class State(NamedTuple):
    """How far a sweep is."""

    complete: frozenset[int]
    """Shards that are there."""
    damaged: frozenset[int]
    """Shards that are there, but not as they were written; they are run again."""
    missing: tuple[int, ...]
    """Shards to run, the damaged ones among them."""


def state_of(stored: Stored) -> State:
    """Return how far a sweep is; every shard that is there is read and verified."""
    good, bad = Shards(stored.folder, stored.digest).complete(stored.shards)
    missing = tuple(shard for shard in range(stored.shards) if shard not in good)
    return State(frozenset(good), frozenset(bad), missing)


def rows_in(stored: Stored, shard: int) -> int:
    """Return the number of rows of a shard."""
    pairs = min((shard + 1) * stored.shard_size, stored.plan.pairs) - shard * stored.shard_size
    return pairs * len(stored.plan.controllers)


def run_missing(
    stored: Stored, state: State, executor: Executor, progress: Callable[[int], None] = lambda rows: None
) -> None:
    """Run the shards that are missing and store each as soon as it is done.

    Args:
        stored: The sweep.
        state: How far it is.
        executor: What runs them.
        progress: Called with the number of rows of each shard that has been stored.

    Raises:
        ResultError: a worker died.
        OSError: a shard could not be written.
    """
    folder = None
    if stored.plan.keys.keep == "all":
        folder = stored.folder.resolve() / TRAJECTORIES
        folder.mkdir(exist_ok=True)
    shards = Shards(stored.folder, stored.digest)
    shards.sweep_up()
    for shard, table in executor.run(Task(stored.plan.source, stored.shard_size, folder), state.missing):
        shards.write(shard, table)
        progress(rows_in(stored, shard))


Also: TypeAlias = Callable[[Stored], Iterable[tuple[str, bytes]]]
"""Makes further files of a sweep that has its final table: name and content of each."""


def conclude(stored: Stored, also: Also = lambda stored: ()) -> None:
    """Write the final table from the shards, run the worst rows again for their trajectories, and write the manifest.

    Args:
        stored: The sweep, all of whose shards are complete.
        also: What else to write before the manifest.

    Raises:
        ResultError: a shard is missing or damaged.
    """
    outcomes = write_results(stored, Shards(stored.folder, stored.digest))
    kept = stored.plan.keys.keep
    worst = worst_rows(stored, kept) if isinstance(kept, Worst) else []
    (stored.folder / TRAJECTORIES).mkdir(exist_ok=True) if worst else None
    worker = Worker(stored.plan)
    for index in worst:
        row = stored.plan.row(index)
        for i, ended in enumerate(worker.pair(row.case, row.draw)):
            if i == row.controller and ended.run is not None:
                keep(stored.folder / TRAJECTORIES, index, stored.plan.controllers[i], ended.run)
    more = []
    for name, content in also(stored):
        (stored.folder / name).parent.mkdir(exist_ok=True)
        atomic_write(stored.folder / name, content)
        more.append(name)
    finish(stored, {"outcomes": outcomes, "worst": worst}, more)


def worst_rows(stored: Stored, kept: Worst) -> list[int]:
    """Return the rows whose trajectories are to be kept, controller by controller, the worst first.

    A failed run is worse than any other, the earlier it fails the worse; then come runs for which the metric is not
    defined; of equal ones the first. Rows that could not be built never ran, and are left out.

    Args:
        stored: The sweep, with its final table.
        kept: How many, and by which metric.
    """
    count, failed_at, value = (
        len(stored.plan.controllers),
        read_column(stored, "failed_at"),
        read_column(stored, kept.by),
    )
    higher = METRICS[kept.by].better == "higher"
    badness = np.where(np.isnan(value), np.inf, -value if higher else value)
    early = np.where(np.isnan(failed_at), np.inf, failed_at)
    order = np.lexsort((np.arange(len(value)), -badness, early))
    order = order[read_column(stored, "outcome")[order] != REFUSED]
    return [int(i) for own in range(count) for i in order[order % count == own][: kept.worst]]


def refuse_others(stored: Stored) -> None:
    """Refuse a finished folder whose manifest belongs to another plan, or whose files are not what it says.

    Raises:
        ResultError: it is such a folder.
    """
    if check_run(stored.folder).get("digest") != stored.digest:
        raise ResultError(f"{stored.folder}: its manifest is another sweep's")
