"""Tracking error: RMS, maximum, steady state, and the integrals IAE and ITAE."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, pieces, shared, total

STEADY_SPAN = 0.5
"""Length of the end of a run over which the steady-state error is taken [s]."""


class ErrorMeasures(NamedTuple):
    """Measures of a tracking error; arrays (n,)."""

    rms: Array
    """sqrt(mean e^2) over a window [unit of e]."""
    greatest: Array
    """max |e| over the window [unit of e]."""
    steady: Array
    """mean |e| over the last samples [unit of e]; NaN where there are none."""
    iae: Array
    """Integral of |e| dt over the whole run by the trapezium rule [rad s]."""
    itae: Array
    """Integral of t |e| dt, likewise [rad s^2]."""


def measure_errors(t: Array, e: Array, first: int, last: int) -> ErrorMeasures:
    """Return all measures of a tracking error from one pass over it.

    Args:
        t: Control instants, (N,) [s].
        e: The error at each of them, (N, n).
        first: Index at which the window of RMS and maximum begins.
        last: Number of samples at the end that the steady-state error is taken over.
    """
    step, instants = np.diff(t)[:, None], t[:, None]
    squares = iae = itae = greatest = np.zeros(e.shape[1])
    for piece in pieces(e):
        above = slice(max(piece.start - 1, 0), piece.stop)  # with the row above, for the trapezia
        size, widths = np.abs(e[above]), step[above.start : above.stop - 1]
        own = size[max(first - above.start, piece.start - above.start) :]
        if len(own):
            greatest = np.maximum(greatest, np.maximum.reduce(own, axis=0))
            squares = total(own * own, squares)
        iae = total((size[1:] + size[:-1]) * widths, iae)
        size *= instants[above]
        itae = total((size[1:] + size[:-1]) * widths, itae)
    steady = total(np.abs(e[len(e) - last :])) / last if last else np.full(e.shape[1], np.nan)
    return ErrorMeasures(np.sqrt(squares / (len(e) - first)), greatest, steady, 0.5 * iae, 0.5 * itae)


@shared
def _errors(run: JointRecord) -> ErrorMeasures:
    last = math.floor(STEADY_SPAN / run.control_period + 1e-6)
    return measure_errors(run.t, run.e, run.window.start, last if last <= len(run.e) else 0)


@metric("rmse", title="RMS error", unit="rad", over_joints="rms", column="RMSE")
def rmse(run: JointRecord) -> Array:
    """sqrt(mean e^2) over the window."""
    return _errors(run).rms


@metric("max_error", title="maximum error", unit="rad", over_joints="worst", column="max")
def max_error(run: JointRecord) -> Array:
    """Max abs(e) over the window."""
    return _errors(run).greatest


@metric("steady_state_error", title="steady-state error", unit="rad", over_joints="worst", column="steady")
def steady_state_error(run: JointRecord) -> Array:
    """Mean abs(e) over the last 0.5 s."""
    return _errors(run).steady


@metric("iae", title="IAE", unit="rad s", column="")
def iae(run: JointRecord) -> Array:
    """Integral of abs(e) dt by the trapezium rule, whole run."""
    return _errors(run).iae


@metric("itae", title="ITAE", unit="rad s^2", column="")
def itae(run: JointRecord) -> Array:
    """Integral of t abs(e) dt by the trapezium rule, whole run."""
    return _errors(run).itae
