"""What a run leaves behind: its samples, its outcome, and how they are stored."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

from torquebench.errors import ResultError
from torquebench.kernel import Array


class Outcome(Enum):
    """How a run ended; the value is what the user is told."""

    COMPLETED = "completed"
    DIVERGED = "the plant state became non-finite or left the bounds"
    BAD_TORQUE = "the law returned a non-finite torque"
    CONTROLLER_ERROR = "the law raised an exception"


SIGNALS = ("q", "qd", "q_meas", "qd_meas", "q_ref", "qd_ref", "qdd_ref", "s", "tau_law", "tau", "tau_applied")


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
    """Torque asked by the law, before clipping [N m]."""
    tau: Array
    """Torque after clipping to the limits [N m]."""
    tau_applied: Array
    """Mean torque on the joints during the step: actuator output plus disturbance [N m]."""
    outcome: Outcome = Outcome.COMPLETED
    failed_at: int | None = None
    """Index of the control instant at which the run failed."""
    detail: str = ""
    """What exactly failed: joint and value, or the exception's text."""
    extra: Mapping[str, Array] = field(default_factory=dict)
    """The law's remaining memory channels by name, each (N, n)."""
    path: str = ""
    """How it was computed: ``native`` or ``python``; empty when read from a file. Both give the same bytes."""
    path_reason: str = ""
    """Why the native path was not taken."""

    @property
    def ending(self) -> str:
        """How and when the run failed, in words; empty if it completed."""
        return "" if self.completed else f"{self.outcome.name.lower().replace('_', ' ')} at {self.t[-1]:g} s"

    def __post_init__(self) -> None:
        for array in (self.t, *(getattr(self, name) for name in SIGNALS), *self.extra.values()):
            array.setflags(write=False)

    def __repr__(self) -> str:
        """Name the outcome and the size instead of printing every array."""
        n_steps, n = self.q.shape
        return f"<Trajectory {self.outcome.name}, {n_steps} instants, {n} joints>"

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.outcome is Outcome.COMPLETED

    def arrays(self) -> dict[str, Array]:
        """Return every stored array by the name it has in ``trajectory.npz``."""
        named = {"t": self.t} | {name: getattr(self, name) for name in SIGNALS}
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
        ResultError: the file is missing, torn, or lacks an array.
    """
    try:
        with np.load(io.BytesIO(Path(path).read_bytes()), allow_pickle=False) as stored:
            content = {name: stored[name] for name in stored.files}
        failed_at = int(content.pop("failed_at"))
        outcome = Outcome[str(content.pop("outcome"))]
        detail = str(content.pop("detail"))
        extra = {k.removeprefix("memory_"): content.pop(k) for k in list(content) if k.startswith("memory_")}
        return Trajectory(
            **content, outcome=outcome, failed_at=None if failed_at < 0 else failed_at, detail=detail, extra=extra
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
        raise ResultError(f"{path}: not a readable trajectory ({error})") from error
