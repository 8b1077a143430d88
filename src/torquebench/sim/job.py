"""One closed loop as both paths see it: what goes in, where it stands, and what it leaves behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from torquebench.chain import Chain, Drawn
from torquebench.chain.drives import Drives
from torquebench.chain.sensors import Sensors
from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import Structure
from torquebench.laws.law import Law, Nothing
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.plants import NativePlant, Plant


@dataclass(frozen=True, eq=False)
class Job(Structure):
    """A closed loop of N control instants on n joints.

    An array of no rows stands for a signal that is not there: no noise, no disturbance, or a record that would
    repeat another (exact measurement, ideal drives).
    """

    substeps: int
    """Physics steps in a control period."""
    control_period: float
    """Time between control instants [s]."""
    tau_max: Array
    """Torque limits, (n,) [N m]."""
    ends: Annotated[Array, 2]
    """Least and greatest position of each joint, (2, n) [rad], beyond which the run ends; (0, n) for no such end."""

    q_ref: Annotated[Array, 2]
    """Desired position, (N, n) [rad]."""
    qd_ref: Annotated[Array, 2]
    """Desired velocity, (N, n) [rad/s]."""
    qdd_ref: Annotated[Array, 2]
    """Desired acceleration, (N, n) [rad/s^2]."""
    disturbance: Annotated[Array, 2]
    """Torque added to what the drives give, (N, n) or (0, n) [N m]."""

    sensors: Sensors
    drives: Drives

    q: Array
    """The plant's position now, (n,) [rad]."""
    qd: Array
    """The plant's velocity now, (n,) [rad/s]."""
    motors: Annotated[Array, 2]
    """Position [rad] and velocity [rad/s] of motors that move relative to the links, (2, n); (0, n) for none."""
    motor_qd: Array
    """Velocity of the motors, (n,) [rad/s]; `qd` itself where they are the links'."""
    sensed_q: Array
    """Position that is measured, (n,) [rad]: `q`, or that of the motors."""
    sensed_qd: Array
    """Velocity that is measured, likewise, (n,) [rad/s]."""
    fresh_q: Array
    """Position measured last, (n,) [rad]; the array that the law sees where it sees it at once."""
    fresh_qd: Array
    """Velocity measured last, (n,) [rad/s]; likewise."""
    late: Annotated[Array, 3]
    """Positions and velocities measured last but not seen yet, in a ring, (d, 2, n), d the delay in control periods."""
    measured_q: Array
    """What the law sees, (n,) [rad]; `q` itself where measurement is exact."""
    measured_qd: Array
    """What the law sees, (n,) [rad/s]; `qd` itself where measurement is exact."""
    output: Array
    """Torque the actuators give now, (n,) [N m]."""
    torque: Annotated[Array, 2]
    """Torque on the joints at the start, in the middle and at the end of a physics step, (3, n) [N m]."""
    memory: Annotated[Array, 2]
    """The law's memory, a row a channel, (m, n)."""

    record_q: Annotated[Array, 2]
    record_qd: Annotated[Array, 2]
    record_q_meas: Annotated[Array, 2]
    record_qd_meas: Annotated[Array, 2]
    record_tau_law: Annotated[Array, 2]
    record_tau: Annotated[Array, 2]
    record_tau_applied: Annotated[Array, 2]
    record_motor_q: Annotated[Array, 2]
    record_motor_qd: Annotated[Array, 2]
    record_memory: Annotated[Array, 3]
    """Signals at each control instant, (N, n) or (0, n); of the memory (m, N, n)."""

    at: IntArray
    """Control instant reached, (1,)."""
    call: IntArray
    """Native path: addresses of the law, its gains, belief and memory, of the plant's step and the plant, and the
    number of joints, (7,)."""


@dataclass(frozen=True, slots=True)
class Setup:
    """One run, ready to go."""

    law: Law
    gains: Any
    belief: Model
    memory: Any
    """The law's memory: a NamedTuple of rows of ``job.memory``."""
    plant: Plant
    native: NativePlant | None
    """The plant's native form when the run is to be compiled."""
    job: Job


def set_up(
    law: Law,
    gains: Any,
    belief: Model,
    plant: Plant,
    desired: Reference,
    chain: Chain,
    *,
    control_period: float,
    substeps: int,
    drawn: Drawn,
    disturbance: Array | None,
    native: NativePlant | None,
) -> Setup:
    """Allocate a run.

    Args:
        law, gains: The law and its gains, which an interpreted law may write to.
        belief: What the law believes, for this run alone: it may write to the scratch space.
        plant: The truth.
        desired: Desired motion at the control instants, (N, n).
        chain: Sensors and actuators.
        control_period: Time between control instants [s].
        substeps: Physics steps in it.
        drawn: What the chain draws for the run.
        disturbance: Sampled at the control instants, (N, n), or None.
        native: The plant's native form, when the run is to be compiled.
    """
    n_steps, n = desired.q.shape
    none = np.zeros((0, n))
    fields = law.memory_type._fields if law.memory_type is not None else ()
    block = np.zeros((len(fields), n))
    memory = law.memory_type(*block) if law.memory_type is not None and fields else Nothing(np.zeros(0))

    sensors = chain.sensors(n, control_period, drawn)
    drives = chain.drives(n, n_steps, plant.timestep, control_period, drawn)
    delay = min(chain.measurement_steps(control_period), n_steps)
    motors, by_motor = motors_of(plant, native), getattr(plant, "sensor", "link") == "motor"
    geared = len(motors) > 0
    measured = not sensors.exact or delay > 0 or by_motor
    acting = drives.active or len(drives.decay) > 0 or disturbance is not None
    # one block for all records: the operating system hands out its pages, which is slow, only once
    records = np.empty((4 + 2 * measured + acting + 2 * geared + len(fields), n_steps, n))
    one = iter(records)
    # copies: they become the trajectory's, which nobody may write to, and the caller's own arrays stay the caller's
    inputs = [x if is_fixed(x) else np.array(x, dtype=np.float64, order="C") for x in desired]
    q, qd = (np.zeros(n), np.zeros(n)) if native is None else (native.q, native.qd)
    measured_q, measured_qd = (np.zeros(n), np.zeros(n)) if measured else (q, qd)
    fresh_q, fresh_qd = (np.zeros(n), np.zeros(n)) if delay > 0 else (measured_q, measured_qd)
    job = Job(
        substeps=substeps,
        control_period=control_period,
        tau_max=np.array(plant.tau_max),
        ends=none if (ends := getattr(plant, "range", None)) is None else np.array(ends),
        q_ref=inputs[0],
        qd_ref=inputs[1],
        qdd_ref=inputs[2],
        disturbance=none if disturbance is None else np.ascontiguousarray(disturbance, dtype=np.float64),
        sensors=sensors,
        drives=drives,
        q=q,
        qd=qd,
        motors=motors,
        motor_qd=motors[1] if geared else qd,
        sensed_q=motors[0] if by_motor else q,
        sensed_qd=motors[1] if by_motor else qd,
        fresh_q=fresh_q,
        fresh_qd=fresh_qd,
        late=np.zeros((delay, 2, n)),
        measured_q=measured_q,
        measured_qd=measured_qd,
        output=np.zeros(n),
        torque=np.zeros((3, n)),
        memory=block,
        record_q=next(one),
        record_qd=next(one),
        record_q_meas=next(one) if measured else none,
        record_qd_meas=next(one) if measured else none,
        record_tau_law=next(one),
        record_tau=next(one),
        record_tau_applied=next(one) if acting else none,
        record_motor_q=next(one) if geared else none,
        record_motor_qd=next(one) if geared else none,
        record_memory=records[len(records) - len(fields) :],
        at=np.zeros(1, dtype=np.int64),
        call=np.zeros(7, dtype=np.int64),
    )
    return Setup(law, gains, belief, memory, plant, native, job)


def motors_of(plant: Plant, native: NativePlant | None) -> Array:
    """Return where a run finds the state of motors that move relative to the links, (2, n); (0, n) for none.

    Args:
        plant: The truth.
        native: Its native form, when the run is to be compiled: then it is the plant's own state.
    """
    if not hasattr(plant, "motors"):
        return np.zeros((0, plant.n))
    return np.array(plant.motors()) if native is None or native.motors is None else native.motors


def is_fixed(x: Array) -> bool:
    """True if an array is immutable and can be shared."""
    flags = x.flags
    return not flags.writeable and flags.c_contiguous and x.base is None and x.dtype == np.float64
