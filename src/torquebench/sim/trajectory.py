"""The result of a run: its samples and its outcome, in memory and on disk."""

from __future__ import annotations

import hashlib
import io
import tokenize
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.sim.closed_loop import (
    BAD_TORQUE,
    COMPLETED,
    CONTROLLER_ERROR,
    DIVERGED,
    MAX_POSITION,
    MAX_VELOCITY,
    OUT_OF_RANGE,
    RAISED,
)
from torquebench.sim.job import Setup


class Outcome(Enum):
    """Outcome of a run; the value is the text shown to users."""

    COMPLETED = "completed"
    DIVERGED = "the plant state became non-finite or left the bounds"
    BAD_TORQUE = "the law returned a non-finite torque"
    CONTROLLER_ERROR = "the law raised an exception"
    OUT_OF_RANGE = "a joint left its range"


SIGNALS = ("q", "qd", "q_meas", "qd_meas", "q_ref", "qd_ref", "qdd_ref", "s", "tau_law", "tau", "tau_applied")
MOTORS = ("motor_q", "motor_qd")
"""Signals of motors that move relative to the links; a run has both or neither."""


@dataclass(frozen=True, slots=True, repr=False)
class Trajectory:
    """Samples of one closed loop at its control instants t_k = k control_period, k = 0 .. N-1.

    Arrays are (N, n), read-only, and end at the failing instant when the run did not complete; they are never
    padded. At a failing instant the signals that were not produced any more are NaN.
    """

    t: Array
    """Control instants, (N,) [s]."""
    q: Array
    """True joint position [rad]."""
    qd: Array
    """True joint velocity [rad/s]."""
    q_meas: Array
    """Position as the law saw it [rad]."""
    qd_meas: Array
    """Velocity as the law saw it [rad/s]."""
    q_ref: Array
    """Desired position [rad]."""
    qd_ref: Array
    """Desired velocity [rad/s]."""
    qdd_ref: Array
    """Desired acceleration [rad/s^2]."""
    s: Array
    """Sliding variable as the law computed it [rad/s]; NaN for a law that has none."""
    tau_law: Array
    """Torque commanded by the law, before clipping [N m]."""
    tau: Array
    """Torque after clipping to the limits [N m]."""
    tau_applied: Array
    """Mean torque on the joints during the step: actuator output plus disturbance [N m]."""
    motor_q: Array | None = None
    """Position of the motors [rad], seen at the joints; None where joints are rigid, and it is that of the links."""
    motor_qd: Array | None = None
    """Velocity of the motors [rad/s], likewise."""
    outcome: Outcome = Outcome.COMPLETED
    failed_at: int | None = None
    """Index of the control instant at which the run failed."""
    detail: str = ""
    """Details of a failure: joint and value, or the exception's text."""
    extra: Mapping[str, Array] = field(default_factory=dict)
    """The law's remaining memory channels by name, each (N, n)."""
    path: str = ""
    """How it was computed: ``native`` or ``python``; empty when read from a file. Both give the same bytes."""
    path_reason: str = ""
    """Why the native path was not taken."""

    @property
    def ending(self) -> str:
        """Kind and time of the run's failure, in words; empty if it completed."""
        return "" if self.completed else f"{self.outcome.name.lower().replace('_', ' ')} at {self.t[-1]:g} s"

    def __post_init__(self) -> None:
        for array in self.arrays().values():
            array.setflags(write=False)

    def __repr__(self) -> str:
        """Name the outcome and the size instead of printing every array."""
        n_steps, n = self.q.shape
        return f"<Trajectory {self.outcome.name}, {n_steps} instants, {n} joints>"

    @property
    def completed(self) -> bool:
        """True if the run reached its end."""
        return self.outcome is Outcome.COMPLETED

    def arrays(self) -> dict[str, Array]:
        """Return every stored array by the name it has in ``trajectory.npz``."""
        named = {"t": self.t} | {name: getattr(self, name) for name in SIGNALS}
        named |= {name: array for name in MOTORS if (array := getattr(self, name)) is not None}
        return named | {f"memory_{name}": value for name, value in self.extra.items()}

    def digest(self) -> str:
        """SHA-256 over the bytes of every array, the outcome and the failing index."""
        h = hashlib.sha256(f"{self.outcome.name} {self.failed_at}".encode())
        for name, value in self.arrays().items():
            h.update(f"{name} {value.shape}".encode())
            h.update(np.ascontiguousarray(value).tobytes())
        return h.hexdigest()

    def to_bytes(self) -> bytes:
        """Return the trajectory as the bytes of an NPZ file (no pickle)."""
        buffer = io.BytesIO()
        failed_at = -1 if self.failed_at is None else self.failed_at
        np.savez(buffer, outcome=self.outcome.name, failed_at=failed_at, detail=self.detail, **self.arrays())  # type: ignore[arg-type]
        return buffer.getvalue()


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a stored trajectory.

    Raises:
        ResultError: the file is missing or torn, or what is in it is no trajectory.
    """
    try:
        with np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as stored:
            content = {name: stored[name] for name in stored.files}
        failed_at = int(content.pop("failed_at"))
        outcome = Outcome[str(content.pop("outcome"))]
        detail = str(content.pop("detail"))
        refuse_what_is_no_run(content, outcome, failed_at)
    except UNREADABLE as error:
        raise ResultError(f"{path}: not a readable trajectory ({error})") from error
    extra = {k.removeprefix("memory_"): content.pop(k) for k in list(content) if k.startswith("memory_")}
    return Trajectory(
        **content, outcome=outcome, failed_at=None if failed_at < 0 else failed_at, detail=detail, extra=extra
    )


UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    RuntimeError,
    MemoryError,
    OverflowError,
    SyntaxError,
    tokenize.TokenError,
    zipfile.BadZipFile,
)
"""Whatever numpy raises for a file that is torn or made up."""


def refuse_what_is_no_run(arrays: Mapping[str, Array], outcome: Outcome, failed_at: int) -> None:
    """Refuse arrays that no run leaves.

    Args:
        arrays: As of `Trajectory.arrays`.
        outcome: How the run ended.
        failed_at: Index of the control instant at which it failed; -1 for none.

    Raises:
        ValueError: one is missing, unknown, of another type or shape, or holds what it cannot.
    """
    names = {name for name in arrays if not name.startswith("memory_")}
    if wrong := (names - set(MOTORS) if names >= set(MOTORS) else names) ^ {"t", *SIGNALS}:
        raise ValueError(f"{', '.join(sorted(wrong))}: wanted exactly t, {', '.join(SIGNALS)}")
    t, shape = arrays["t"], arrays["q"].shape
    if t.ndim != 1 or len(t) == 0 or len(shape) != 2 or shape[0] != len(t) or shape[1] == 0:
        raise ValueError(f"t has shape {t.shape} and q {shape}, wanted (N,) and (N, n)")
    for name, array in arrays.items():
        if array.dtype != np.float64 or array.shape != (shape if name != "t" else t.shape):
            raise ValueError(f"{name} has type {array.dtype} and shape {array.shape}, wanted float64 and {shape}")
    if failed_at != (-1 if outcome is Outcome.COMPLETED else len(t) - 1):
        raise ValueError(f"failed_at is {failed_at}, which does not go with {outcome.name} after {len(t)} instants")
    if not np.isfinite(t).all() or np.any(np.diff(t) <= 0.0):
        raise ValueError("t does not rise")
    sure = len(t) if outcome is Outcome.COMPLETED else len(t) - 1
    for name in (*SIGNALS, *(names & set(MOTORS))):
        if name != "s" and not np.isfinite(arrays[name][:sure]).all():
            raise ValueError(f"{name} is not finite before the end of the run")
    if np.any(np.abs(arrays["q"][1:]) > MAX_POSITION) or np.any(np.abs(arrays["qd"][1:]) > MAX_VELOCITY):
        raise ValueError("q or qd is beyond what a run reaches")


OUTCOMES = {
    COMPLETED: Outcome.COMPLETED,
    BAD_TORQUE: Outcome.BAD_TORQUE,
    RAISED: Outcome.BAD_TORQUE,
    CONTROLLER_ERROR: Outcome.CONTROLLER_ERROR,
    DIVERGED: Outcome.DIVERGED,
    OUT_OF_RANGE: Outcome.OUT_OF_RANGE,
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

    geared = len(job.record_motor_q) > 0
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
        motor_q=kept(job.record_motor_q) if geared else None,
        motor_qd=kept(job.record_motor_qd) if geared else None,
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
    if status == OUT_OF_RANGE:
        joint = int(np.argmax(np.maximum(job.ends[0] - job.q, job.q - job.ends[1])))
        low, high = job.ends[:, joint]
        return f"joint {joint + 1}: q = {job.q[joint]:g} rad after the step, its range is {low:g} to {high:g} rad"
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
