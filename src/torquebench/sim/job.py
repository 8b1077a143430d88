"""One closed loop as both paths see it: what goes in, where it stands, and what it leaves behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import Structure


@dataclass(frozen=True, eq=False)
class Job(Structure):
    """A closed loop of N control instants on n joints.

    An array of no rows stands for a signal that is not there: no noise, no disturbance, or a record that would
    repeat another (exact measurement, an ideal actuator).
    """

    substeps: int
    """Physics steps in a control period."""
    control_period: float
    """Time between control instants [s]."""
    tau_max: Array
    """Torque limits, (n,) [N m]."""

    q_ref: Annotated[Array, 2]
    """Desired position, (N, n) [rad]."""
    qd_ref: Annotated[Array, 2]
    """Desired velocity, (N, n) [rad/s]."""
    qdd_ref: Annotated[Array, 2]
    """Desired acceleration, (N, n) [rad/s^2]."""
    disturbance: Annotated[Array, 2]
    """Torque added after clipping and lag, (N, n) or (0, n) [N m]."""

    position_noise: Annotated[Array, 2]
    """Added to the measured position, (N, n) or (0, n) [rad]."""
    velocity_gain: float
    """Share of a new difference quotient that the velocity filter takes in; 0 for exact velocity."""
    quantum: float
    """The measured position is rounded to a multiple of this; 0 for none [rad]."""
    decay: Annotated[Array, 1]
    """What is left of an actuator's lag after half a physics step, a whole one, and on average over a control
    period, (3,); of no elements for an ideal actuator."""

    q: Array
    """The plant's position now, (n,) [rad]."""
    qd: Array
    """The plant's velocity now, (n,) [rad/s]."""
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
    record_memory: Annotated[Array, 3]
    """Signals at each control instant, (N, n) or (0, n); of the memory (m, N, n)."""

    at: IntArray
    """Control instant reached, (1,)."""
    call: IntArray
    """Native path: addresses of the law, its gains, belief and memory, of the plant's step and the plant, and the
    number of joints, (7,)."""
