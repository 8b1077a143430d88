"""A sweep's worker: it runs the rows of a shard one after the other and fills their columns."""

from __future__ import annotations

import math
import threading
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from torquebench.certificates import Phases
from torquebench.errors import ConfigError, ModelError
from torquebench.experiment.build import Builder, Loop
from torquebench.experiment.certify import certificate_of, truth_of
from torquebench.experiment.controllers import Controller
from torquebench.experiment.predict import predicted_to_shake
from torquebench.experiment.run import recorded, trial_of
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import atomic_write
from torquebench.experiment.sweep_section import with_number
from torquebench.experiment.yaml_tree import KeyPath
from torquebench.keys import altered
from torquebench.metrics import METRICS, JointRecord, headlines_of
from torquebench.metrics.shaking import is_still
from torquebench.robot import RobotModel
from torquebench.sim.session import Session
from torquebench.sim.trajectory import Trajectory
from torquebench.sweep.border import COLUMNS, find_border
from torquebench.sweep.plan import Plan, Source, pairs_of
from torquebench.sweep.repeats import Known, keys_of
from torquebench.sweep.table import REFUSED, Table, empty_columns, key_values

KEPT = 31 << 20
"""Bytes of freed memory that glibc is to keep, which it does once so much was freed: else each array of a run costs
the operating system's handing out of its pages, which takes longer than to fill it."""


class Ended(NamedTuple):
    """Outcome of one run."""

    outcome: str
    failed_at: float
    """Control instant at which it failed; NaN when it did not."""
    run: Trajectory | None
    """None of a run that could not be built."""
    record: JointRecord | None = None
    """The run as metrics see it, if it completed."""
    figures: Mapping[str, float] = MappingProxyType({})
    """Figures of its certificates and of its border, where the sweep asks for them and the law has them."""
    key: bytes | None = None
    """Key of everything that decides its numbers, where loops that repeat are run once; see `keys_of`."""


class Stopped(Exception):
    """A worker was told to stop before its shard was done."""


class Task(NamedTuple):
    """All that a worker needs to know of a sweep; small and plain, so that it can be sent to another machine."""

    source: Source
    shard_size: int
    """Number of (case, draw) pairs in a shard."""
    trajectories: Path | None = None
    """Folder for the trajectory of every run, shared by all workers; None for none."""


class Runner:
    """Runs experiments one after the other, with its own plants and buffers; each thread needs its own.

    Args:
        controllers: Most controllers of one.
        steps: Control steps that will be asked for.
        certificates: Whether runs have the figures of their certificates.
    """

    def __init__(self, controllers: int, steps: int, certificates: bool = False) -> None:
        np.empty(KEPT, dtype=np.uint8)  # freed at once, which is what tells the C library
        self._build, self._certificates = Builder(), certificates
        self._last_truth: tuple[Any, RobotModel | Phases] | None = None
        self._sessions = [Session(overwrite=True, steps=steps) for _ in range(controllers)]

    def ended(
        self,
        experiment: Experiment,
        seen: Mapping[bytes, Ended] | None = None,
        more: Callable[[int], Mapping[str, float]] = lambda place: {},
    ) -> Iterator[Ended]:
        """Run every controller; a yielded trajectory lasts until the next experiment.

        Args:
            experiment: What is run.
            seen: Loops that are not run again, by their key; None to run all.
            more: Number of the controller -> further figures of it, found before it is run.
        """
        try:
            loop = self._build(experiment)
        except (ConfigError, ModelError):
            # what is drawn is at fault, not the file: every case has been built before
            yield from (Ended(REFUSED, 0.0, None) for _ in experiment.controllers)
            return
        decided: Iterable[bytes | None] = [None] * len(loop.controllers)
        if seen is not None:
            decided = keys_of(experiment, loop, self._certificates)
        sessions = self._sessions[: len(loop.controllers)]
        own = zip(experiment.controllers, loop.controllers, sessions, decided, strict=True)
        for place, (keys, controller, session, key) in enumerate(own):
            if seen is not None and key is not None and key in seen:
                yield seen[key]
                continue
            figures = more(place)
            run = session.run(loop.plant, trial_of(experiment, loop, controller))
            if run.completed:
                record = recorded(experiment, loop, keys, run)
                figures = {**figures, **self._certify(experiment, loop, keys, run)}
                yield Ended(run.outcome.name, math.nan, run, record, figures, key)
            else:
                yield Ended(run.outcome.name, float(run.failed_at or 0), run, None, figures, key)

    def _certify(self, experiment: Experiment, loop: Loop, keys: Controller, run: Trajectory) -> Mapping[str, float]:
        """Return the figures of a run's certificates, where the sweep asks for them and the law has them."""
        if not self._certificates:
            return {}
        found = certificate_of(experiment, loop, keys, run, self._truth(experiment))
        return {} if found is None else found.figures

    def _truth(self, experiment: Experiment) -> RobotModel | Phases:
        """Return the true arm, the last one again where the plant is the same."""
        run, plant = experiment.run, experiment.plant
        key = plant, run.control_period, None if plant.perturb is None else (run.seed, run.draw)
        if self._last_truth is None or self._last_truth[0] != key:
            self._last_truth = key, truth_of(experiment)
        return self._last_truth[1]


class Worker(Runner):
    """Runs shards of a sweep.

    Args:
        plan: The sweep.
        steps: Control steps that will be asked for, if more than the sweep's own.
    """

    def __init__(self, plan: Plan, steps: int = 0) -> None:
        steps = max(steps, plan.rows * plan.first.n_steps)
        super().__init__(len(plan.controllers), steps, plan.keys.certificates)
        self._plan = plan

    def columns(
        self, task: Task, shard: int, stop: Callable[[], bool] = lambda: False, known: Known | None = None
    ) -> Table:
        """Run the rows of a shard and return them.

        Args:
            task: The sweep.
            shard: Number of the shard.
            stop: Called before each pair; true to stop.
            known: Loops that need not be run again, to which those of this shard are added; None to run all.

        Raises:
            Stopped: `stop` returned true.
        """
        plan, pairs = self._plan, pairs_of(task.shard_size, self._plan.pairs, shard)
        count = len(plan.controllers)
        columns = empty_columns(plan, len(pairs) * count)
        metrics = np.full((len(pairs) * count, len(METRICS)), math.nan)
        outcome, failed_at = columns["outcome"], columns["failed_at"]
        columns["index"][:] = np.arange(pairs.start * count, pairs.stop * count)
        columns["case"][:], columns["draw"][:] = np.divmod(columns["index"] // count, plan.draws)
        columns["controller"][:] = np.tile(plan.controllers, len(pairs))

        known = None if task.trajectories is not None or plan.keys.border is not None else known
        seen = None if known is None else ChainMap({}, known.ended)
        keyed = list[tuple[int, bytes]]()

        def completed() -> Iterator[tuple[int, JointRecord]]:
            for first, pair in zip(range(0, len(metrics), count), pairs, strict=True):
                if stop():
                    raise Stopped
                case, draw = divmod(pair, plan.draws)
                for key, values in key_values(plan, case, draw).items():
                    columns[key][first : first + count] = values
                for at, ended in enumerate(self.pair(case, draw, seen), first):
                    if seen is not None and ended.key is not None:
                        keyed.append((at, ended.key))
                        seen.setdefault(ended.key, ended._replace(run=None, record=None))
                    outcome[at], failed_at[at] = ended.outcome, ended.failed_at
                    for key in plan.figures:
                        columns[key][at] = ended.figures.get(key, math.nan)
                    if task.trajectories is not None and ended.run is not None:
                        row, name = int(columns["index"][at]), plan.controllers[at - first]
                        write_trajectory(task.trajectories, row, name, ended.run)
                    if ended.record is not None:
                        yield at, ended.record

        for at, found in headlines_of(completed()):
            metrics[at] = found
        if known is not None and seen is not None:
            for at, key in keyed:  # a row that was not run follows the one that was
                metrics[at] = known.metrics.setdefault(key, metrics[at].copy())
                known.ended.setdefault(key, seen[key])
        columns |= {key: metrics[:, i].copy() for i, key in enumerate(METRICS.names()) if key in columns}
        return columns

    def pair(self, case: int, draw: int, seen: Mapping[bytes, Ended] | None = None) -> Iterator[Ended]:
        """Run every controller of a case in a draw; a yielded trajectory lasts until the controller's next run.

        Args:
            case: The case.
            draw: The draw.
            seen: Loops that are not run again, by their key; None to run all.
        """
        experiment, border = self._plan.experiment(case, draw), self._plan.bordered(case, draw)

        def found(place: int) -> Mapping[str, float]:
            return self._border(experiment, place, border[place]) if place in border else {}

        yield from self.ended(experiment, seen, found)

    def _border(self, experiment: Experiment, place: int, path: KeyPath) -> dict[str, float]:
        """Return where a law starts to shake, and where it is predicted to.

        Args:
            experiment: The row's experiment.
            place: Number of the controller.
            path: Place of the gain.
        """
        keys, session = self._plan.keys.border, self._sessions[place]
        if keys is None:
            return {}
        alone = altered(experiment, controllers=(experiment.controllers[place],))
        path, truth = ("controllers", 0, *path[2:]), self._truth(experiment)

        def at(value: float) -> tuple[Experiment, Loop]:
            tried = with_number(alone, path, value)
            return tried, self._build(tried)

        def shakes(value: float) -> bool:
            tried, loop = at(value)
            run = session.run(loop.plant, trial_of(tried, loop, loop.controllers[0]))
            if not run.completed:
                return True
            size = METRICS["chattering"].formula(recorded(tried, loop, tried.controllers[0], run))
            return not is_still(float(np.mean(size)))

        found, predicted = find_border(shakes, keys.start, keys.stop, keys.within), math.nan
        if predicted_to_shake(*at(keys.start), truth) is not None:
            search = find_border(lambda x: bool(predicted_to_shake(*at(x), truth)), keys.start, keys.stop, 0.01)
            predicted = search.border
        return dict(zip(COLUMNS, (*found, predicted), strict=True))


def write_trajectory(folder: Path, index: int, controller: str, run: Trajectory) -> None:
    """Write the trajectory of a row atomically.

    Args:
        folder: The folder of trajectories.
        index: Number of the row.
        controller: Name of its controller.
        run: The trajectory.
    """
    atomic_write(folder / f"{index}-{controller}.npz", run.to_bytes())


_thread = threading.local()


def run_shard(task: Task, shard: int, stop: Callable[[], bool] = lambda: False, known: Known | None = None) -> Table:
    """Run one shard in this thread, which keeps its worker for the sweep's next shard.

    Args:
        task: The sweep.
        shard: Number of the shard.
        stop: Called before each pair; true to stop.
        known: As of `Worker.columns`.

    Raises:
        Stopped: `stop` returned true.
        ConfigError: the sweep's file or a plug-in cannot be used here.
    """
    if getattr(_thread, "source", None) != task.source:
        steps = 0 if known is None else known.steps
        _thread.worker, _thread.source = Worker(Plan(task.source), steps), task.source
    worker: Worker = _thread.worker
    return worker.columns(task, shard, stop, known)
