"""The closed loop: measure, law, command, drive, disturb, step; the same source interpreted and compiled."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba.extending import register_jitable

from torquebench.chain.drives import command, drive, receive
from torquebench.chain.sensors import measure
from torquebench.kernel import Array, kernel
from torquebench.sim.job import Job

COMPLETED, BAD_TORQUE, CONTROLLER_ERROR, DIVERGED, RAISED, OUT_OF_RANGE = range(6)
"""How a stretch of the loop ended; RAISED: the law left the domain of arithmetic and produced no torque."""

MAX_POSITION = 1e4
"""A joint position beyond this [rad] counts as diverged."""
MAX_VELOCITY = 1e4
"""A joint velocity beyond this [rad/s] counts as diverged."""


@kernel
def hold_back(job: Job, k: int) -> None:
    """Show the law the measurement of len(late) control instants ago, the first one until then; keep that of k."""
    late = job.late
    slot = k % len(late)
    for i in range(len(job.q)):
        if k == 0:
            for j in range(len(late)):
                late[j, 0, i], late[j, 1, i] = job.fresh_q[i], job.fresh_qd[i]
        job.measured_q[i], job.measured_qd[i] = late[slot, 0, i], late[slot, 1, i]
        late[slot, 0, i], late[slot, 1, i] = job.fresh_q[i], job.fresh_qd[i]


@kernel
def actuate(job: Job, k: int) -> None:
    """Record the command of control instant k, with the mean torque that acts on the joints until the next instant.

    A lagging actuator goes from its output u towards the command, u(t) = tau + (u - tau) exp(-t/lag). Of any other
    drive the mean is added up while it acts; here the record begins with the disturbance.
    """
    tau, applied, drives = job.record_tau[k], job.torque[0], job.drives
    command(drives, k, job.record_tau_law[k], job.record_tau[k - 1 if k > 0 else 0], job.tau_max, tau)
    for i in range(len(tau)):
        applied[i] = tau[i]
    if drives.active or len(drives.decay) > 0:
        receive(drives, k, tau)
    if drives.active:
        for i in range(len(tau)):
            applied[i] = 0.0
    elif len(drives.decay) > 0:
        for i in range(len(tau)):
            applied[i] += (job.output[i] - tau[i]) * drives.decay[2]
    if len(job.disturbance) > 0:
        for i in range(len(tau)):
            applied[i] += job.disturbance[k, i]
    if len(job.record_tau_applied) > 0:
        for i in range(len(tau)):
            job.record_tau_applied[k, i] = applied[i]


@kernel
def give(job: Job, k: int, s: int) -> None:
    """Write the torque on the joints at the start, middle and end of physics step s of a control period.

    A late command comes into force at one of them; one that is late by a whole period after the last, and acts if the
    next one is late as well. What the motors give is added to the mean on record, but that of a lag alone, which is
    there already.
    """
    drives, torque, disturbed = job.drives, job.torque, len(job.disturbance) > 0
    late = drives.late[k] if len(drives.late) > 0 and k > 0 else 0
    if s == late:
        for i in range(len(job.q)):
            drives.held[i] = drives.target[i]
    drive(drives, k * job.substeps + s, job.motor_qd, job.tau_max, job.output, torque)
    if s + 1 == late == job.substeps:
        for i in range(len(job.q)):
            drives.held[i] = drives.target[i]
    for i in range(len(job.q)):
        if drives.active:
            mean = (torque[0, i] + 4.0 * torque[1, i] + torque[2, i]) / 6.0
            job.record_tau_applied[k, i] += mean / job.substeps
        if disturbed:
            for stage in range(3):
                torque[stage, i] += job.disturbance[k, i]


@kernel
def inside(q: Array, qd: Array) -> bool:
    """Whether the plant's state is finite and within its bounds; written so that NaN fails."""
    for i in range(len(q)):
        if not (abs(q[i]) <= MAX_POSITION and abs(qd[i]) <= MAX_VELOCITY):
            return False
    return True


@kernel
def within(q: Array, ends: Array) -> bool:
    """Whether every position is between the least and the greatest one of its joint, `ends` (2, n) [rad]."""
    for i in range(len(q)):
        if q[i] < ends[0, i] or q[i] > ends[1, i]:
            return False
    return True


@kernel
def copy_row(source: Array, target: Array) -> None:
    """Copy one row of a signal, (n,)."""
    for i in range(len(source)):
        target[i] = source[i]


@kernel
def sense(job: Job, k: int) -> None:
    """Record the state at control instant k, and show the law what the sensors make of it."""
    copy_row(job.q, job.record_q[k])
    copy_row(job.qd, job.record_qd[k])
    if len(job.motors) > 0:
        copy_row(job.motors[0], job.record_motor_q[k])
        copy_row(job.motors[1], job.record_motor_qd[k])
    if len(job.record_q_meas) > 0:
        measure(job.sensors, k, job.control_period, job.sensed_q, job.sensed_qd, job.fresh_q, job.fresh_qd)
        if len(job.late) > 0:
            hold_back(job, k)
        copy_row(job.measured_q, job.record_q_meas[k])
        copy_row(job.measured_qd, job.record_qd_meas[k])


def closed_loop(
    job: Job,
    first: int,
    last: int,
    law: Callable[[Job, int], int],
    step: Callable[[Job, int, int], None],
    sensed: int = 0,
) -> int:
    """Run control instants `first` .. `last` - 1 and return how that ended; ``job.at[0]`` is the instant reached.

    Args:
        job: The loop; its state and records are written.
        first, last: Range of control instants.
        law: Called with the job and k; fills ``job.record_tau_law[k]`` and returns how that went.
        step: Called with the job, a number of physics steps, and whether the torque varies within them; moves
            ``job.q`` and ``job.qd`` on.
        sensed: Control instants before this one have been through `sense` already.
    """
    memory, record_memory, record_tau_law, at = job.memory, job.record_memory, job.record_tau_law, job.at
    driven = job.drives.active or len(job.drives.decay) > 0
    bounded = len(job.ends) > 0
    for k in range(first, last):
        at[0] = k
        if k >= sensed:
            sense(job, k)
        tau_law = record_tau_law[k]
        for i in range(len(tau_law)):
            tau_law[i] = math.nan  # so that a joint the law forgets is noticed

        status = law(job, k)
        if status == CONTROLLER_ERROR:
            return status
        for c in range(len(memory)):
            copy_row(memory[c], record_memory[c, k])
        if status != COMPLETED:
            return status
        for i in range(len(tau_law)):
            if not math.isfinite(tau_law[i]):
                return BAD_TORQUE

        actuate(job, k)
        if driven:
            for s in range(job.substeps):
                give(job, k, s)
                step(job, 1, 1)
        else:
            step(job, job.substeps, 0)
        if not inside(job.q, job.qd):
            return DIVERGED
        if bounded and not within(job.q, job.ends):
            return OUT_OF_RANGE
    return COMPLETED


compiled_closed_loop = register_jitable(_nrt=False)(closed_loop)
