"""Running one closed loop: checks, the choice between the two paths, and what is left behind."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np

from torquebench.errors import ControllerError, SimulationError, did_you_mean
from torquebench.fuzzy import FuzzySystem
from torquebench.kernel import Array
from torquebench.laws import Law, find_law
from torquebench.references import Reference, ReferenceSource
from torquebench.robot.arm import RobotModel
from torquebench.sim.again import Again
from torquebench.sim.chain import IDEAL, Chain
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.native_path import NativeRun, obstacle
from torquebench.sim.plant import Plant, attached_at, substeps_per_period
from torquebench.sim.python_path import PythonRun
from torquebench.sim.result import Watch, motion_of, trajectory_of
from torquebench.sim.setup import is_fixed, set_up
from torquebench.sim.trajectory import Trajectory

PathName = Literal["auto", "python", "native"]


@dataclass(frozen=True, slots=True)
class Controller:
    """A law with its gains, under the name it has in results."""

    name: str
    law: Law = field(repr=False)
    gains: Any
    """The tuple the law receives; see `Law.pack_gains`."""

    @classmethod
    def of(
        cls,
        law: str,
        n: int,
        gains: Mapping[str, Any],
        options: Mapping[str, str | bool] | None = None,
        name: str | None = None,
        fuzzy: FuzzySystem | str | None = None,
    ) -> Controller:
        """Return a controller of a registered law.

        Args:
            law: Name of the law.
            n: Number of joints.
            gains: Gain name -> a number, or one for each joint.
            options: Option name -> value; those left out take their defaults.
            name: Name in results; None for the law's.
            fuzzy: Fuzzy system of a law that takes one: its definition, or the name of a built-in one.

        Raises:
            ControllerError: no such law, or gains or options it cannot use.
        """
        found = find_law(law)
        return cls(name or law, found, found.pack_gains(n, gains, options or {}, fuzzy))


def simulate(
    plant: Plant,
    controller: Controller,
    model: RobotModel,
    reference: ReferenceSource | Reference,
    *,
    duration: float,
    control_period: float = 0.001,
    chain: Chain = IDEAL,
    position_noise: Array | None = None,
    disturbance: Array | None = None,
    initial_q: Array | None = None,
    path: PathName = "auto",
    throw: bool = True,
    progress: Callable[[int], None] | None = None,
    watch: Watch | None = None,
    again: Again | None = None,
) -> Trajectory:
    """Run one closed loop from rest and return what happened.

    At control instant k, time k control_period: the law computes a torque from the measured state, the desired
    motion and its `model`; the torque is clipped to the plant's limits; the actuators follow it; the disturbance is
    added; the plant is integrated to the next instant with the commanded torque held.

    Args:
        plant: The truth; reset here, so one plant serves many runs.
        controller: The law and its gains.
        model: The law's belief about the plant; another object than the plant, right or wrong.
        reference: Desired motion as a function of time, or sampled at the control instants (see `from_samples`).
        duration: Length of the run [s]; N = duration / control_period instants.
        control_period: Time between control instants [s], a whole multiple of ``plant.timestep``.
        chain: Sensors and actuators.
        position_noise: Added to the measured position, (N, n) [rad]; None for none.
        disturbance: Torque added after clipping and lag, (N, n) [N m]; None for none.
        initial_q: Position at rest at t = 0, (n,) [rad]; None for zero.
        path: ``native`` compiles law, loop and plant; ``python`` interprets law and loop; ``auto`` is native where
            that is possible, and `Trajectory.path_reason` says why where it is not. Both give the same bytes.
        throw: Raise when the run does not complete, instead of returning the truncated trajectory.
        progress: Called with the index of the control instant just finished; on the native path now and then.
        watch: Called after `progress` with the same index and what has been recorded.
        again: Memory of the run before, which this one has again where it can; the trajectory that was returned then
            is overwritten. None for memory of its own.

    Raises:
        ValueError: durations, shapes or joint counts that do not fit, or an unknown path.
        ControllerError: `path` is ``native`` and the run cannot be compiled.
        SimulationError: the run did not complete, and `throw` is set; it carries the trajectory.
    """
    _check_kinds(path, chain)
    n = plant.n
    substeps = substeps_per_period(control_period, plant.timestep)
    n_steps = substeps_per_period(duration, control_period, ("duration", "control_period"))
    t = control_instants(n_steps, control_period)
    desired = _each_joint(reference if isinstance(reference, Reference) else reference(t), n)
    start = np.zeros(n) if initial_q is None else np.array(initial_q, dtype=np.float64)
    _check_shapes(n, n_steps, controller, model, desired, start)
    _check_added(n, n_steps, disturbance=disturbance, position_noise=position_noise)
    attach = attached_at(plant, control_period, n_steps)
    reason = "" if path == "python" else obstacle(plant, controller.law)
    if path == "native" and reason:
        raise ControllerError(f"controller '{controller.name}' cannot run on the native path: {reason}")
    native = None if path == "python" or reason else plant.native()  # type: ignore[attr-defined]
    plant.reset(start, np.zeros(n))
    # an interpreted law gets copies, so that one that writes to its arguments changes neither plant nor next run
    gains = copy.deepcopy(controller.gains) if native is None else controller.gains
    run: PythonRun | NativeRun
    again = again or Again()
    if native is None:
        setup = set_up(
            controller.law,
            gains,
            model.flat,
            plant,
            desired,
            chain,
            control_period=control_period,
            substeps=substeps,
            position_noise=position_noise,
            disturbance=disturbance,
            native=None,
        )
        run = PythonRun(setup)
    else:
        setup, run = again.prepared(
            controller.law,
            gains,
            model.flat,
            plant,
            desired,
            chain,
            control_period=control_period,
            substeps=substeps,
            position_noise=position_noise,
            disturbance=disturbance,
            native=native,
        )
    motion = None if watch is None else motion_of(setup)
    status, done, at_once = COMPLETED, 0, max(1, run.longest // substeps)
    while done < n_steps and status == COMPLETED:
        if done == attach > 0:
            run.attach()
        last = min(done + at_once, attach if done < attach else n_steps)
        status = run(done, last)
        done = last
        if progress is not None and status == COMPLETED:
            progress(last - 1)
        if watch is not None and motion is not None and status == COMPLETED:
            watch(last - 1, motion)
    if native is None:
        trajectory = trajectory_of(setup, t, status, run.detail, "python", reason)
    else:
        trajectory = again.trajectory(setup, t, status, run.detail)
    if throw and not trajectory.completed:
        raise SimulationError(
            f"controller '{controller.name}', t = {trajectory.t[-1]:g} s (step {trajectory.failed_at}): "
            f"{trajectory.outcome.value}: {trajectory.detail}",
            trajectory,
        )
    return trajectory


@lru_cache(maxsize=8)
def control_instants(n_steps: int, control_period: float) -> Array:
    """Return the control instants k control_period, k = 0 .. n_steps - 1, (N,) [s]; read-only."""
    t: Array = np.arange(n_steps, dtype=np.float64) * control_period
    t.setflags(write=False)
    return t


def _check_kinds(path: str, chain: Chain) -> None:
    if path not in get_args(PathName):
        raise ValueError(f"path is {path!r}{did_you_mean(path, get_args(PathName))}")
    if not isinstance(chain, Chain):
        raise TypeError(f"chain is {chain!r}, wanted a Chain, such as CHAINS['fast']")


def _each_joint(desired: Reference, n: int) -> Reference:
    """Repeat a reference of one column, made from plain numbers, for every joint."""
    return Reference(*(np.repeat(x, n, axis=1) if np.ndim(x) == 2 and x.shape[1] == 1 else x for x in desired))


_checked = threading.local()
"""The reference that was checked last in each thread, as far as nobody can change it: most runs have that one again."""


def _check_shapes(
    n: int,
    n_steps: int,
    controller: Controller,
    model: RobotModel,
    desired: Reference,
    start: Array,
) -> None:
    if not isinstance(model, RobotModel):
        raise TypeError(f"model is a {type(model).__name__}, wanted a RobotModel: what the law believes, not the plant")
    if model.n != n:
        raise ValueError(f"the model has {model.n} joints, the plant {n}")
    for gain in controller.gains:
        if isinstance(gain, np.ndarray) and gain.shape != (n,):
            raise ValueError(f"controller '{controller.name}' has gains for {len(gain)} joints, the plant has {n}")
    last = getattr(_checked, "last", (None,) * len(desired))
    for name, array, known in zip(desired._fields, desired, last, strict=True):
        if array.shape != (n_steps, n):
            raise ValueError(f"reference {name} has shape {array.shape}, wanted {(n_steps, n)}")
        if array is not known and not np.all(np.isfinite(array)):
            raise ValueError(f"reference {name} has values that are not finite")
    _checked.last = tuple(array if is_fixed(array) else None for array in desired)
    if start.shape != (n,) or not np.all(np.isfinite(start)):
        raise ValueError(f"initial_q is {start}, wanted {n} finite numbers")


def _check_added(n: int, n_steps: int, **signals: Array | None) -> None:
    for name, array in signals.items():
        if array is not None and (array.shape != (n_steps, n) or not np.all(np.isfinite(array))):
            raise ValueError(f"{name} has shape {array.shape}, wanted {(n_steps, n)}, all finite")
