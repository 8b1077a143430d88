"""Many closed loops, one after the other on each of several threads."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from torquebench.kernel import Array
from torquebench.references import Reference, ReferenceSource
from torquebench.robot.arm import RobotModel
from torquebench.sim.again import Again
from torquebench.sim.chain import IDEAL, Chain
from torquebench.sim.loop import Controller, PathName, simulate
from torquebench.sim.plant import Plant
from torquebench.sim.result import Watch
from torquebench.sim.trajectory import Trajectory

AHEAD = 2
"""Runs asked for in advance for each thread: enough to keep it busy, few enough to keep memory flat."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The arguments of one `simulate`, but for the plant; see there."""

    controller: Controller
    model: RobotModel
    reference: ReferenceSource | Reference
    duration: float
    control_period: float = 0.001
    chain: Chain = IDEAL
    position_noise: Array | None = None
    disturbance: Array | None = None
    initial_q: Array | None = None


class Workers:
    """Threads with a plant each, to keep from one batch of closed loops to the next; a context manager.

    Args:
        plant: The truth, as it is now: what is changed in it later does not reach the threads. With more than one
            worker it must have a method ``replica()``.
        count: Number of threads. Compiled runs do not hold the interpreter's lock; interpreted ones do.

    Raises:
        ValueError: `count` is less than 1.
    """

    def __init__(self, plant: Plant, count: int) -> None:
        if count < 1:
            raise ValueError(f"workers is {count}, wanted at least 1")
        self._plant, self._count = plant, count
        self._plants: queue.SimpleQueue[Plant] = queue.SimpleQueue()
        if count > 1:
            for _ in range(count):
                self._plants.put(plant.replica())
        self._pool = ThreadPoolExecutor(count)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown()

    def simulate(self, trials: Iterable[Trial], path: PathName = "auto") -> Iterator[Trajectory]:
        """Run closed loops and yield their trajectories; see `simulate_many`."""
        if self._count == 1:
            for trial in trials:
                yield run_trial(self._plant, trial, path)
            return
        pending: deque[Future[Trajectory]] = deque()
        try:
            for trial in trials:
                pending.append(self._pool.submit(self._run, trial, path))
                if len(pending) >= AHEAD * self._count:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()

    def _run(self, trial: Trial, path: PathName) -> Trajectory:
        own = self._plants.get()
        try:
            return run_trial(own, trial, path)
        finally:
            self._plants.put(own)


def simulate_many(
    plant: Plant, trials: Iterable[Trial], *, workers: int = 1, path: PathName = "auto"
) -> Iterator[Trajectory]:
    """Run closed loops and yield their trajectories in the order of the trials; a failed run is one of them.

    Results do not depend on `workers`, to the byte: each thread has a plant, and each run all else, of its own. At
    most a few trials per thread are taken from `trials` before their turn, and no trajectory is kept.

    Args:
        plant: The truth; with more than one worker it must have a method ``replica()``.
        trials: What to run.
        workers: Number of threads; see `Workers`, which keeps them for many batches.
        path: As for `simulate`.

    Raises:
        ValueError: `workers` is less than 1, or a trial's arguments do not fit.
        ControllerError: `path` is ``native`` and a trial cannot be compiled.
    """
    with Workers(plant, workers) as own:
        yield from own.simulate(trials, path)


def run_trial(
    plant: Plant,
    trial: Trial,
    path: PathName = "auto",
    progress: Callable[[int], None] | None = None,
    watch: Watch | None = None,
    again: Again | None = None,
) -> Trajectory:
    """Run one trial; a failure is returned, not raised. Arguments as of `simulate`."""
    return simulate(
        plant,
        trial.controller,
        trial.model,
        trial.reference,
        duration=trial.duration,
        control_period=trial.control_period,
        chain=trial.chain,
        position_noise=trial.position_noise,
        disturbance=trial.disturbance,
        initial_q=trial.initial_q,
        path=path,
        throw=False,
        progress=progress,
        watch=watch,
        again=again,
    )
