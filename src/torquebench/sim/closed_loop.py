"""The closed loop: measure, law, clip, actuate, disturb, step; the same source interpreted and compiled."""

from __future__ import annotations

import math
from collections.abc import Callable

from numba.extending import register_jitable

from torquebench.kernel import Array, clip, kernel
from torquebench.sim.job import Job

COMPLETED, BAD_TORQUE, CONTROLLER_ERROR, DIVERGED, RAISED, OUT_OF_RANGE = range(6)
"""How a stretch of the loop ended; RAISED: the law left the domain of arithmetic and produced no torque."""

MAX_POSITION = 1e4
"""A joint position beyond this [rad] counts as diverged."""
MAX_VELOCITY = 1e4
"""A joint velocity beyond this [rad/s] counts as diverged."""


@kernel
def measure(job: Job, k: int) -> None:
    """Measure the state at control instant k where that gives anything else than the state itself.

    The filter takes the backward difference of the measured position, v += a (dq/T - v) with v = 0 at first.
    """
    q, qd, seen_q, seen_qd = job.q, job.qd, job.fresh_q, job.fresh_qd
    noisy, filtered = len(job.position_noise) > 0, job.velocity_gain > 0.0
    for i in range(len(q)):
        position = q[i]
        if noisy:
            position += job.position_noise[k, i]
        if job.quantum > 0.0:
            position = nearest_multiple(position, job.quantum)
        if not filtered:
            seen_qd[i] = qd[i]
        elif k == 0:
            seen_qd[i] = 0.0
        else:
            rate = (position - seen_q[i]) / job.control_period
            seen_qd[i] += job.velocity_gain * (rate - seen_qd[i])
        seen_q[i] = position


@kernel
def nearest_multiple(x: float, quantum: float) -> float:
    """Return the whole multiple of `quantum` nearest to x; x itself where floats lie further apart than multiples."""
    if abs(x) < 4503599627370496.0 * quantum:  # 2^52
        return quantum * math.floor(x / quantum + 0.5)
    return x


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
    """Clip the law's torque and record it, with the mean torque that acts on the joints until the next instant.

    A lagging actuator goes from its output u towards the clipped torque, u(t) = tau + (u - tau) exp(-t/lag).
    """
    tau_law, tau, applied, tau_max = job.record_tau_law[k], job.record_tau[k], job.torque[0], job.tau_max
    for i in range(len(tau)):
        x = clip(tau_law[i], tau_max[i])
        tau[i], applied[i] = x, x
    if len(job.decay) > 0:
        for i in range(len(tau)):
            applied[i] += (job.output[i] - tau[i]) * job.decay[2]
    if len(job.disturbance) > 0:
        for i in range(len(tau)):
            applied[i] += job.disturbance[k, i]
    if len(job.record_tau_applied) > 0:
        for i in range(len(tau)):
            job.record_tau_applied[k, i] = applied[i]


@kernel
def lag(job: Job, k: int) -> None:
    """Write the torque on the joints at the start, middle and end of the next physics step, and move the output on."""
    disturbed = len(job.disturbance) > 0
    for i in range(len(job.q)):
        tau, gap = job.record_tau[k, i], job.output[i] - job.record_tau[k, i]
        d = job.disturbance[k, i] if disturbed else 0.0
        job.torque[0, i] = job.output[i] + d
        job.torque[1, i] = tau + gap * job.decay[0] + d
        job.output[i] = tau + gap * job.decay[1]
        job.torque[2, i] = job.output[i] + d


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


def closed_loop(
    job: Job, first: int, last: int, law: Callable[[Job, int], int], step: Callable[[Job, int, int], None]
) -> int:
    """Run control instants `first` .. `last` - 1 and return how that ended; ``job.at[0]`` is the instant reached.

    Args:
        job: The loop; its state and records are written.
        first, last: Range of control instants.
        law: Called with the job and k; fills ``job.record_tau_law[k]`` and returns how that went.
        step: Called with the job, a number of physics steps, and whether the torque varies within them; moves
            ``job.q`` and ``job.qd`` on.
    """
    q, qd, memory, record_memory, at = job.q, job.qd, job.memory, job.record_memory, job.at
    record_q, record_qd, record_tau_law = job.record_q, job.record_qd, job.record_tau_law
    measured, delayed, lagging = len(job.record_q_meas) > 0, len(job.late) > 0, len(job.decay) > 0
    bounded = len(job.ends) > 0
    for k in range(first, last):
        at[0] = k
        copy_row(q, record_q[k])
        copy_row(qd, record_qd[k])
        if measured:
            measure(job, k)
            if delayed:
                hold_back(job, k)
            copy_row(job.measured_q, job.record_q_meas[k])
            copy_row(job.measured_qd, job.record_qd_meas[k])
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
        if lagging:
            for _ in range(job.substeps):
                lag(job, k)
                step(job, 1, 1)
        else:
            step(job, job.substeps, 0)
        if not inside(q, qd):
            return DIVERGED
        if bounded and not within(q, job.ends):
            return OUT_OF_RANGE
    return COMPLETED


compiled_closed_loop = register_jitable(_nrt=False)(closed_loop)
