"""The closed loop, to be read: measure, law, clip, disturb, step."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from torquebench.errors import SimulationError
from torquebench.kernel import Array
from torquebench.laws import Law, find_law
from torquebench.references import Reference, ReferenceSource
from torquebench.robot.arm import RobotModel
from torquebench.robot.model import own_copy
from torquebench.sim.calling import call_law
from torquebench.sim.plant import Plant, substeps_per_period
from torquebench.sim.trajectory import SIGNALS, Outcome, Trajectory

MAX_POSITION = 1e4
"""A joint position beyond this [rad] counts as diverged."""
MAX_VELOCITY = 1e4
"""A joint velocity beyond this [rad/s] counts as diverged."""


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
    ) -> Controller:
        """Return a controller of a registered law.

        Args:
            law: Name of the law.
            n: Number of joints.
            gains: Gain name -> a number, or one for each joint.
            options: Option name -> value; those left out take their defaults.
            name: Name in results; None for the law's.

        Raises:
            ControllerError: no such law, or gains or options it cannot use.
        """
        found = find_law(law)
        return cls(name or law, found, found.pack_gains(n, gains, options or {}))


def simulate(
    plant: Plant,
    controller: Controller,
    model: RobotModel,
    reference: ReferenceSource | Reference,
    *,
    duration: float,
    control_period: float = 0.001,
    disturbance: Array | None = None,
    initial_q: Array | None = None,
    throw: bool = True,
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Run one closed loop from rest and return what happened.

    At control instant k, time k control_period: the law computes a torque from the measured state, the desired
    motion and its `model`; the torque is clipped to the plant's limits; the disturbance is added; the plant is
    integrated to the next instant with that torque held.

    Args:
        plant: The truth; reset here, so one plant serves many runs.
        controller: The law and its gains.
        model: The law's belief about the plant; another object than the plant, right or wrong.
        reference: Desired motion as a function of time, or sampled at the control instants (see `from_samples`).
        duration: Length of the run [s]; N = duration / control_period instants.
        control_period: Time between control instants [s], a whole multiple of ``plant.timestep``.
        disturbance: Torque added after clipping, (N, n) [N m]; None for none.
        initial_q: Position at rest at t = 0, (n,) [rad]; None for zero.
        throw: Raise when the run does not complete, instead of returning the truncated trajectory.
        progress: Called with each k.

    Raises:
        ValueError: durations, shapes or joint counts that do not fit.
        SimulationError: the run did not complete, and `throw` is set; it carries the trajectory.
    """
    n = plant.n
    substeps = substeps_per_period(control_period, plant.timestep)
    n_steps = substeps_per_period(duration, control_period, ("duration", "control_period"))
    t: Array = np.arange(n_steps, dtype=np.float64) * control_period
    desired = _each_joint(reference if isinstance(reference, Reference) else reference(t), n)
    start = np.zeros(n) if initial_q is None else np.array(initial_q, dtype=np.float64)
    _check_shapes(n, n_steps, controller, model, desired, disturbance, start)

    record = {name: np.full((n_steps, n), np.nan) for name in SIGNALS}
    # the law gets copies, so that one that writes to its arguments changes neither the plant nor the next run
    belief = own_copy(model.flat)._replace(control_period=control_period)
    gains = type(controller.gains)(*copy.deepcopy(tuple(controller.gains)))
    call = partial(call_law, controller.law, gains, belief)
    memory = controller.law.new_memory(n)
    kept = {name: np.full((n_steps, n), np.nan) for name in memory._fields if name not in ("s", "nothing")}
    has_s = "s" in memory._fields
    outcome, detail, failed_at = Outcome.COMPLETED, "", None
    plant.reset(start, np.zeros(n))

    for k in range(n_steps):
        q, qd = plant.state()
        ref = Reference(desired.q[k].copy(), desired.qd[k].copy(), desired.qdd[k].copy())
        record["q"][k], record["qd"][k] = q, qd
        record["q_meas"][k], record["qd_meas"][k] = q, qd
        record["q_ref"][k], record["qd_ref"][k], record["qdd_ref"][k] = ref

        tau_law, outcome, detail = call(k * control_period, q, qd, ref, memory)
        record["tau_law"][k] = tau_law
        if outcome is not Outcome.CONTROLLER_ERROR:
            if has_s:
                record["s"][k] = memory.s
            for name, channel in kept.items():
                channel[k] = getattr(memory, name)
        if outcome is not Outcome.COMPLETED:
            failed_at = k
            break
        tau = np.clip(tau_law, -plant.tau_max, plant.tau_max)
        applied = tau if disturbance is None else tau + disturbance[k]
        record["tau"][k], record["tau_applied"][k] = tau, applied

        plant.step(applied, substeps)
        outcome, detail = _check_state(*plant.state())
        if outcome is not Outcome.COMPLETED:
            failed_at = k
            break
        if progress is not None:
            progress(k)

    end = n_steps if failed_at is None else failed_at + 1
    trajectory = Trajectory(
        t=t[:end].copy(), **{name: array[:end].copy() for name, array in record.items()}, outcome=outcome,
        failed_at=failed_at, detail=detail, extra={name: array[:end].copy() for name, array in kept.items()},
    )  # fmt: skip
    if throw and not trajectory.completed:
        raise SimulationError(
            f"controller '{controller.name}', t = {trajectory.t[-1]:g} s (step {failed_at}): {outcome.value}: {detail}",
            trajectory,
        )
    return trajectory


def _check_state(q: Array, qd: Array) -> tuple[Outcome, str]:
    # written so that NaN fails too
    inside = (np.abs(q) <= MAX_POSITION) & (np.abs(qd) <= MAX_VELOCITY)
    if np.all(inside):
        return Outcome.COMPLETED, ""
    joint = int(np.argmin(inside))
    return Outcome.DIVERGED, f"joint {joint + 1}: q = {q[joint]:g} rad, qd = {qd[joint]:g} rad/s after the step"


def _each_joint(desired: Reference, n: int) -> Reference:
    """Repeat a reference of one column, made from plain numbers, for every joint."""
    return Reference(*(np.repeat(x, n, axis=1) if np.ndim(x) == 2 and x.shape[1] == 1 else x for x in desired))


def _check_shapes(
    n: int,
    n_steps: int,
    controller: Controller,
    model: RobotModel,
    desired: Reference,
    disturbance: Array | None,
    start: Array,
) -> None:
    if not isinstance(model, RobotModel):
        raise TypeError(f"model is a {type(model).__name__}, wanted a RobotModel: what the law believes, not the plant")
    if model.n != n:
        raise ValueError(f"the model has {model.n} joints, the plant {n}")
    for gain in controller.gains:
        if np.ndim(gain) == 1 and len(gain) != n:
            raise ValueError(f"controller '{controller.name}' has gains for {len(gain)} joints, the plant has {n}")
    for name, array in desired._asdict().items():
        if array.shape != (n_steps, n):
            raise ValueError(f"reference {name} has shape {array.shape}, wanted {(n_steps, n)}")
        if not np.all(np.isfinite(array)):
            raise ValueError(f"reference {name} has values that are not finite")
    if start.shape != (n,) or not np.all(np.isfinite(start)):
        raise ValueError(f"initial_q is {start}, wanted {n} finite numbers")
    if disturbance is not None and (disturbance.shape != (n_steps, n) or not np.all(np.isfinite(disturbance))):
        raise ValueError(f"disturbance has shape {disturbance.shape}, wanted {(n_steps, n)}, all finite")
