"""Many closed loops, one after the other on each of several threads."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

from torquebench.sim.loop import Trial
from torquebench.sim.plant import Plant
from torquebench.sim.session import PathName, SampledTrial, Session
from torquebench.sim.trajectory import Trajectory

AHEAD = 2
"""Runs asked for in advance for each thread: enough to keep it busy, few enough to keep memory flat."""


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
        self._count = count
        self._free: queue.SimpleQueue[tuple[Plant, Session]] = queue.SimpleQueue()
        for _ in range(count):
            self._free.put((plant.replica() if count > 1 else plant, Session()))
        self._pool = ThreadPoolExecutor(count)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.shutdown()

    def simulate(self, trials: Iterable[Trial | SampledTrial], path: PathName = "auto") -> Iterator[Trajectory]:
        """Run closed loops and yield their trajectories; see `simulate_many`."""
        if self._count == 1:
            for trial in trials:
                yield self._run(trial, path)
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

    def _run(self, trial: Trial | SampledTrial, path: PathName) -> Trajectory:
        plant, session = self._free.get()
        try:
            sampled = trial.sampled(plant.n) if isinstance(trial, Trial) else trial
            return session.run(plant, sampled, path)
        finally:
            self._free.put((plant, session))


def simulate_many(
    plant: Plant, trials: Iterable[Trial | SampledTrial], *, workers: int = 1, path: PathName = "auto"
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
