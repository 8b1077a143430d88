"""From a run's arrays and status to its trajectory."""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array
from torquebench.sim.closed_loop import (
    BAD_TORQUE,
    COMPLETED,
    CONTROLLER_ERROR,
    DIVERGED,
    MAX_POSITION,
    MAX_VELOCITY,
    RAISED,
)
from torquebench.sim.setup import Setup
from torquebench.sim.trajectory import Outcome, Trajectory

OUTCOMES = {
    COMPLETED: Outcome.COMPLETED,
    BAD_TORQUE: Outcome.BAD_TORQUE,
    RAISED: Outcome.BAD_TORQUE,
    CONTROLLER_ERROR: Outcome.CONTROLLER_ERROR,
    DIVERGED: Outcome.DIVERGED,
}


def trajectory_of(setup: Setup, t: Array, status: int, detail: str, path: str, path_reason: str) -> Trajectory:
    """Return the trajectory of a run that has ended.

    Args:
        setup: The run; its records become the trajectory's.
        t: Control instants, (N,) [s].
        status: How the loop ended.
        detail: What the law's call said when it produced no torque.
        path, path_reason: See `Trajectory`.
    """
    job, k = setup.job, int(setup.job.at[0])
    end = len(t) if status == COMPLETED else k + 1
    if status != COMPLETED:
        detail = _forget(setup, k, status, detail)

    def kept(array: Array) -> Array:
        return array if end == len(t) else array[:end].copy()

    q, qd, tau = kept(job.record_q), kept(job.record_qd), kept(job.record_tau)
    measured, acting = len(job.record_q_meas) > 0, len(job.record_tau_applied) > 0
    fields = () if setup.law.memory_type is None else setup.law.memory_type._fields
    channels = {name: kept(job.record_memory[c]) for c, name in enumerate(fields)}
    s = channels.pop("s") if "s" in channels else np.full(q.shape, np.nan)
    return Trajectory(
        t=kept(t),
        q=q,
        qd=qd,
        q_meas=kept(job.record_q_meas) if measured else q,
        qd_meas=kept(job.record_qd_meas) if measured else qd,
        q_ref=kept(job.q_ref),
        qd_ref=kept(job.qd_ref),
        qdd_ref=kept(job.qdd_ref),
        s=s,
        tau_law=kept(job.record_tau_law),
        tau=tau,
        tau_applied=kept(job.record_tau_applied) if acting else tau,
        outcome=OUTCOMES[status],
        failed_at=None if status == COMPLETED else k,
        detail="" if status == COMPLETED else detail,
        extra=channels,
        path=path,
        path_reason=path_reason,
    )


def _forget(setup: Setup, k: int, status: int, detail: str) -> str:
    """Blank what was not produced any more at the failing instant, and return what went wrong."""
    job = setup.job
    if status == DIVERGED:
        inside = (np.abs(job.q) <= MAX_POSITION) & (np.abs(job.qd) <= MAX_VELOCITY)
        joint = int(np.argmin(inside))
        return f"joint {joint + 1}: q = {job.q[joint]:g} rad, qd = {job.qd[joint]:g} rad/s after the step"
    job.record_tau[k] = np.nan
    if len(job.record_tau_applied):
        job.record_tau_applied[k] = np.nan
    if status == BAD_TORQUE:
        tau = job.record_tau_law[k]
        joint = int(np.argmin(np.isfinite(tau)))
        why = " (not written by the law, or not a number)" if np.isnan(tau[joint]) else ""
        return f"joint {joint + 1}: tau = {tau[joint]}{why}"
    job.record_tau_law[k] = np.nan
    if status == CONTROLLER_ERROR:
        job.record_memory[:, k] = np.nan
    return detail
