"""Input of every metric: one completed run, with the window and the limits that metrics use."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from torquebench.kernel import Array
from torquebench.robot import RobotModel
from torquebench.sim.trajectory import Trajectory

T = TypeVar("T")

PIECE = 8192
"""Numbers of a signal that are taken at once: what is made of them stays in the processor's cache."""


@dataclass(frozen=True, slots=True, eq=False)
class JointRecord:
    """One completed run as metrics see it; signals (N, n) are those at the control instants of the whole run."""

    trajectory: Trajectory
    """Every signal of the run."""
    t: Array
    """Control instants, (N,) [s]."""
    q: Array
    """True position, (N, n) [rad]."""
    q_ref: Array
    """Desired position, (N, n) [rad]."""
    tau: Array
    """Torque after clipping, (N, n) [N m]."""
    s: Array
    """Sliding variable of the law, (N, n) [rad/s]; NaN for a law without one."""
    tau_max: Array
    """Torque limit of each joint, (n,) [N m]."""
    control_period: float
    """Time between control instants [s]."""
    window: slice
    """Samples with t >= `run.metrics_from`: `run.e[run.window]` is the error in the metrics' window."""
    phi: Array | None
    """Half-width of the law's boundary layer, (n,) [rad/s]; None for a law without one."""
    chattering_from_hz: float
    """Frequency from which the torque counts as chattering [Hz]."""
    step_like: bool
    """Whether the reference goes from one position to another and stays there."""
    arm: RobotModel | None = None
    """The true arm, where the reference is a path of its tool."""
    disturbances: tuple[Array | None, ...] = (None,)
    """Torque that disturbs the joints at each control instant, (N, n) [N m]; of runs side by side that of each."""
    motion_hz: tuple[float, ...] = ()
    """Frequencies with which the reference swings [Hz]."""
    _shared: dict[Callable[..., Any] | str, Any] = field(default_factory=dict)

    @property
    def e(self) -> Array:
        """Tracking error q_ref - q of the true position, (N, n) [rad]."""
        if "e" not in self._shared:
            self._shared["e"] = self.q_ref - self.q
        error: Array = self._shared["e"]
        return error


def shared(compute: Callable[[JointRecord], T]) -> Callable[[JointRecord], T]:
    """Compute something once for each run, for several metrics that follow from one pass over its samples."""

    @functools.wraps(compute)
    def cached(run: JointRecord) -> T:
        kept = run._shared
        if compute not in kept:
            kept[compute] = compute(run)
        result: T = kept[compute]
        return result

    return cached


def total(x: Array, before: Array | None = None) -> Array:
    """Return the sum of each column of x (N, n), added up from the first row to the last, (n,); 0 of no rows.

    Args:
        x: The columns; with `before` its first row is overwritten.
        before: Sum of the rows above, (n,): the sum goes on from there as if they were one array.
    """
    if before is not None:
        if len(x) == 0:
            return before
        x[0] += before
    if x.shape[1] > 1:  # numpy then adds row to row; one column it would add up in pairs
        return np.asarray(np.add.reduce(x, axis=0))
    return np.cumsum(x, axis=0)[-1] if len(x) else np.zeros(1)


def pieces(x: Array) -> Iterator[slice]:
    """Yield the rows of x (N, n) in consecutive pieces of about `PIECE` numbers."""
    rows = max(1, PIECE // x.shape[1])
    yield from (slice(first, min(first + rows, len(x))) for first in range(0, len(x), rows))
