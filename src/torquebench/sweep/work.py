"""The work of a sweep: the rows of one shard run, one after the other, and their table filled."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from torquebench.errors import ConfigError, ModelError
from torquebench.experiment.build import Builder
from torquebench.experiment.run import joints_of, trial_of
from torquebench.experiment.store import atomic_write
from torquebench.kernel import Array
from torquebench.laws.plugin import load_plugin
from torquebench.metrics import METRICS, headlines
from torquebench.sim.session import Session
from torquebench.sim.trajectory import Trajectory
from torquebench.sweep.columns import Table
from torquebench.sweep.form import REFUSED, empty_columns, values_of
from torquebench.sweep.plan import Plan, Source, pairs_of


class Ended(NamedTuple):
    """What is left of one run."""

    outcome: str
    failed_at: float
    """Control instant at which it failed; NaN when it did not."""
    metrics: Array
    """Headline of each of `METRICS`; NaN where undefined."""
    run: Trajectory | None
    """None of a run that could not be built."""


class Stopped(Exception):
    """The work was to stop before the shard was done."""


class Task(NamedTuple):
    """A sweep as its workers see it: small, and plain enough to be sent to another process or machine."""

    source: Source
    shard_size: int
    """Number of (case, draw) pairs in a shard."""
    trajectories: Path | None = None
    """Folder for the trajectory of every run, shared by all workers; None for none."""


class Worker:
    """Runs shards, with plants and laws of its own; one for each thread.

    Args:
        plan: The sweep.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._build = plan, Builder()
        self._sessions = [Session(overwrite=True) for _ in plan.controllers]

    def table(self, task: Task, shard: int, stop: Callable[[], bool] = lambda: False) -> Table:
        """Run the rows of a shard and return their table.

        Args:
            task: The sweep.
            shard: Number of the shard.
            stop: Asked before each pair whether to give up.

        Raises:
            Stopped: it was to give up.
        """
        plan, pairs = self._plan, pairs_of(task.shard_size, self._plan.pairs, shard)
        count = len(plan.controllers)
        columns, metrics = empty_columns(plan, len(pairs) * count), np.empty((len(pairs) * count, len(METRICS)))
        outcome, failed_at = columns["outcome"], columns["failed_at"]
        columns["index"][:] = np.arange(pairs.start * count, pairs.stop * count)
        columns["case"][:], columns["draw"][:] = np.divmod(columns["index"] // count, plan.draws)
        columns["controller"][:] = np.tile(plan.controllers, len(pairs))
        at = 0
        for pair in pairs:
            if stop():
                raise Stopped
            case, draw = divmod(pair, plan.draws)
            for key, values in values_of(plan, case, draw).items():
                columns[key][at : at + count] = values
            for ended in self.pair(case, draw):
                outcome[at], failed_at[at], metrics[at] = ended.outcome, ended.failed_at, ended.metrics
                if task.trajectories is not None and ended.run is not None:
                    keep(task.trajectories, pair * count + at % count, plan.controllers[at % count], ended.run)
                at += 1
        columns |= {key: metrics[:, i].copy() for i, key in enumerate(METRICS.names())}
        return columns

    def pair(self, case: int, draw: int) -> Iterator[Ended]:
        """Run every controller of a case in a draw; what is yielded has its trajectory until the controller's next run.

        Args:
            case: The case.
            draw: The draw.
        """
        experiment, undefined = self._plan.experiment(case, draw), np.full(len(METRICS), math.nan)
        try:
            loop = self._build(experiment)
        except (ConfigError, ModelError):
            # the draw, not the file, is at fault: every case has been built before
            yield from (Ended(REFUSED, 0.0, undefined, None) for _ in experiment.controllers)
            return
        for keys, controller, session in zip(experiment.controllers, loop.controllers, self._sessions, strict=True):
            run = session.run(loop.plant, trial_of(experiment, loop, controller))
            if run.completed:
                metrics = headlines(joints_of(experiment, loop, keys, run))
                yield Ended(run.outcome.name, math.nan, metrics, run)
            else:
                yield Ended(run.outcome.name, float(run.failed_at or 0), undefined, run)


def keep(folder: Path, index: int, controller: str, run: Trajectory) -> None:
    """Write the trajectory of a row, whole or not at all.

    Args:
        folder: Where.
        index: The row's number.
        controller: Name of its controller.
        run: The trajectory.
    """
    atomic_write(folder / trajectory_name(index, controller), run.to_bytes())


def trajectory_name(index: int, controller: str) -> str:
    """Return the name of a row's trajectory file."""
    return f"{index}-{controller}.npz"


_own = threading.local()


def run_shard(task: Task, shard: int, stop: Callable[[], bool] = lambda: False) -> Table:
    """Run one shard, anywhere: in this thread, or in a process or on a machine that has just received the task.

    Args:
        task: The sweep.
        shard: Number of the shard.
        stop: Asked now and then whether to give up.

    Raises:
        Stopped: it was to give up.
        ConfigError: the sweep's file or a plug-in cannot be used here.
    """
    last = getattr(_own, "last", None)
    if last is None or last[0] != task.source:
        last = _own.last = task.source, Worker(Plan(task.source))
    worker: Worker = last[1]
    return worker.table(task, shard, stop)


def load_plugins(source: Source) -> None:
    """Register the laws of a sweep's plug-ins in this process.

    Raises:
        ConfigError: one of them cannot be used.
    """
    for path in source.plugins:
        load_plugin(path)
