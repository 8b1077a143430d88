"""Run closed loops, one or many on several threads; all random numbers come from a seed."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from torquebench.chain import IDEAL, Chain
from torquebench.errors import SimulationError
from torquebench.kernel import Array
from torquebench.references import Reference, ReferenceSource
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.plants import Plant
from torquebench.sim.session import Controller, PathName, SampledTrial, Session, check_path
from torquebench.sim.signals import Disturbance, check_disturbances, control_instants, total_torque
from torquebench.sim.trajectory import Trajectory
from torquebench.timing import substeps_per_period


@dataclass(frozen=True, slots=True)
class Trial:
    """The arguments of one `simulate`, but for the plant; see there."""

    controller: Controller
    model: RobotModel
    reference: ReferenceSource | Reference
    duration: float
    control_period: float = 0.001
    chain: Chain = IDEAL
    disturbances: Sequence[Disturbance] = ()
    seed: int = 0
    draw: int = 0
    initial_q: Array | None = None

    def sampled(self, n: int) -> SampledTrial:
        """Sample the motion, and draw the chain's noise and the disturbances, for a plant of `n` joints.

        Raises:
            TypeError: the chain, or something in `disturbances`, is nothing of the kind.
            ValueError: durations or shapes that do not fit.
        """
        if not isinstance(self.chain, Chain):
            raise TypeError(f"chain is {self.chain!r}, wanted a Chain, such as CHAINS['fast']")
        disturbances = check_disturbances(self.disturbances)
        n_steps = substeps_per_period(self.duration, self.control_period, ("duration", "control_period"))
        t = control_instants(n_steps, self.control_period)
        desired = self.reference if isinstance(self.reference, Reference) else self.reference(t)
        for name, array in zip(desired._fields, desired, strict=True):
            if np.shape(array) not in ((n_steps, n), (n_steps, 1)):
                raise ValueError(f"reference {name} has shape {np.shape(array)}, wanted {(n_steps, n)}")
        return SampledTrial(
            self.controller,
            self.model,
            desired,
            self.control_period,
            self.chain,
            self.chain.draw(n, n_steps, self.seed, self.draw),
            total_torque(disturbances, n, n_steps, self.control_period, self.seed, self.draw),
            self.initial_q,
        )


def simulate(
    plant: Plant,
    controller: Controller,
    model: RobotModel,
    reference: ReferenceSource | Reference,
    *,
    duration: float,
    control_period: float = 0.001,
    chain: Chain = IDEAL,
    disturbances: Sequence[Disturbance] = (),
    seed: int = 0,
    draw: int = 0,
    initial_q: Array | None = None,
    path: PathName = "auto",
    throw: bool = True,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Run one closed loop from rest and return what happened.

    At control instant k, time k control_period: the law computes a torque from the measured state, the desired
    motion and its `model`; the torque is clipped to the plant's limits; the actuators follow it; the disturbances are
    added; the plant is integrated to the next instant with the commanded torque held.

    Whatever is random in the chain and in the disturbances depend on `seed` and `draw` alone. An experiment
    with the same seed and draw has the same noise, and its trajectory is the same in every byte.

    Args:
        plant: The truth; reset here, so one plant serves many runs.
        controller: The law and its gains.
        model: The law's belief about the plant; another object than the plant, right or wrong.
        reference: Desired motion as a function of time, or sampled at the control instants (see `from_samples`).
        duration: Length of the run [s]; N = duration / control_period instants.
        control_period: Time between control instants [s], a whole multiple of ``plant.timestep``.
        chain: Sensors, with their noise, and actuators.
        disturbances: Torques added after clipping and lag; each samples itself: see `Disturbance`.
        seed: Seed of all random numbers, 0 or greater.
        draw: Which of the seed's independent draws to take, 0 or greater.
        initial_q: Position at rest at t = 0, (n,) [rad]; None for zero.
        path: ``native`` compiles law, loop and plant; ``python`` interprets law and loop; ``auto`` is native where
            that is possible, and `Trajectory.path_reason` says why where it is not. Both give the same bytes.
        throw: Raise when the run does not complete, instead of returning the truncated trajectory.
        progress: Called with the index of the control instant just finished; on the native path now and then.

    Raises:
        TypeError: a chain, model or disturbance that is nothing of the kind.
        ValueError: durations, shapes or joint counts that do not fit, or an unknown path.
        ControllerError: `path` is ``native`` and the run cannot be compiled.
        SimulationError: the run did not complete, and `throw` is set; it carries the trajectory.
    """
    check_path(path)
    substeps_per_period(control_period, plant.timestep)
    trial = Trial(controller, model, reference, duration, control_period, chain, disturbances, seed, draw, initial_q)
    trajectory = Session().run(plant, trial.sampled(plant.n), path, progress)
    if throw and not trajectory.completed:
        raise SimulationError(
            f"controller '{controller.name}', t = {trajectory.t[-1]:g} s (step {trajectory.failed_at}): "
            f"{trajectory.outcome.value}: {trajectory.detail}",
            trajectory,
        )
    return trajectory


AHEAD = 2
"""Runs queued per thread: enough to keep it busy, few enough to keep memory flat."""


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
