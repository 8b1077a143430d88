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
from torquebench.sim.chain import IDEAL, Chain
from torquebench.sim.loop import Controller, PathName, simulate
from torquebench.sim.plant import Plant
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


def simulate_many(
    plant: Plant, trials: Iterable[Trial], *, workers: int = 1, path: PathName = "auto"
) -> Iterator[Trajectory]:
    """Run closed loops and yield their trajectories in the order of the trials; a failed run is one of them.

    Results do not depend on `workers`, to the byte: each thread has a plant, and each run all else, of its own. At
    most a few trials per thread are taken from `trials` before their turn, and no trajectory is kept.

    Args:
        plant: The truth; with more than one worker it must have a method ``replica()``.
        trials: What to run.
        workers: Number of threads. Compiled runs do not hold the interpreter's lock; interpreted ones do.
        path: As for `simulate`.

    Raises:
        ValueError: `workers` is less than 1, or a trial's arguments do not fit.
        ControllerError: `path` is ``native`` and a trial cannot be compiled.
    """
    if workers < 1:
        raise ValueError(f"workers is {workers}, wanted at least 1")
    if workers == 1:
        for trial in trials:
            yield run_trial(plant, trial, path)
        return
    plants: queue.SimpleQueue[Plant] = queue.SimpleQueue()
    for _ in range(workers):
        plants.put(plant.replica())

    def work(trial: Trial) -> Trajectory:
        own = plants.get()
        try:
            return run_trial(own, trial, path)
        finally:
            plants.put(own)

    pending: deque[Future[Trajectory]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for trial in trials:
                pending.append(pool.submit(work, trial))
                if len(pending) >= AHEAD * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def run_trial(
    plant: Plant, trial: Trial, path: PathName = "auto", progress: Callable[[int], None] | None = None
) -> Trajectory:
    """Run one trial; a failure is returned, not raised. Arguments as of `simulate`."""
    return simulate(
        plant, trial.controller, trial.model, trial.reference, duration=trial.duration,
        control_period=trial.control_period, chain=trial.chain, position_noise=trial.position_noise,
        disturbance=trial.disturbance, initial_q=trial.initial_q, path=path, throw=False,
        progress=progress,
    )  # fmt: skip
