"""Torque: total variation, reversals, effort and saturation against the limits."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, pieces, shared, total

BoolArray: TypeAlias = npt.NDArray[np.bool_]

SATURATED = 0.02
"""Share of the time at the torque limit from which on a joint saturates [1]."""


class TorqueMeasures(NamedTuple):
    """Measures of a torque; arrays (n,)."""

    total_variation: Array
    """Sum |delta tau| / (length tau_max) [tau_max/s]; length = time from first to last sample."""
    reversals: Array
    """Sign changes per second of delta tau [1/s]; changes of at most 1e-3 tau_max are passed over."""
    effort: Array
    """Mean (tau/tau_max)^2 [1]."""
    saturation_fraction: Array
    """Fraction of the samples with |tau| at its limit [1]."""


def measure_torques(tau: Array, control_period: float, tau_max: Array) -> TorqueMeasures:
    """Return all measures of a torque tau (N, n) [N m] against its limits tau_max (n,) [N m]."""
    length, small, limit = (len(tau) - 1) * control_period, 1e-3 * tau_max, tau_max * (1.0 - 1e-12)
    variation = squares = saturated = np.zeros(len(tau_max))
    counts, rises = np.empty((2, len(tau) - 1, len(tau_max)), dtype=np.bool_)
    for piece in pieces(tau):
        ratio = tau[piece] / tau_max
        ratio *= ratio
        squares = total(ratio, squares)
        at_limit = np.abs(tau[piece]) >= limit
        if at_limit.any():
            saturated = saturated + np.count_nonzero(at_limit, axis=0)
        own = slice(max(piece.start - 1, 0), piece.stop - 1)
        change = tau[own.start + 1 : piece.stop] - tau[own]
        np.greater(change, 0.0, out=rises[own])
        np.abs(change, out=change)
        np.greater(change, small, out=counts[own])
        variation = total(change, variation)
    return TorqueMeasures(
        variation / (length * tau_max), _turns(rises, counts) / length, squares / len(tau), saturated / len(tau)
    )


def _turns(rises: BoolArray, counts: BoolArray) -> Array:
    """Return how often a torque that rises goes on to fall, or the other way round, (n,).

    Args:
        rises: Whether it rises from each instant to the next, (N - 1, n).
        counts: Whether that change counts, likewise; the others are passed over.
    """
    found = np.zeros(rises.shape[1])
    for i, (own, kept) in enumerate(zip(np.ascontiguousarray(rises.T), np.ascontiguousarray(counts.T), strict=True)):
        rising = own[kept]
        found[i] = np.count_nonzero(rising[1:] != rising[:-1])
    return found


@shared
def _torques(run: JointRecord) -> TorqueMeasures:
    return measure_torques(run.tau[run.window], run.control_period, run.tau_max)


@metric("total_variation", title="torque total variation", unit="tau_max/s", column="TV", shown_as=("1/s", 1.0))
def total_variation(run: JointRecord) -> Array:
    """Sum abs(delta tau) / (window length x tau_max)."""
    return _torques(run).total_variation


@metric("reversals", title="torque reversals", unit="1/s", column="")
def reversals(run: JointRecord) -> Array:
    """Changes of sign of delta tau, those beyond 1e-3 tau_max, per second."""
    return _torques(run).reversals


@metric("effort", title="control effort", unit="1", column="effort")
def effort(run: JointRecord) -> Array:
    """Mean (tau/tau_max)^2."""
    return _torques(run).effort


@metric("saturation_fraction", title="time in saturation", unit="1", column="saturated", shown_as=("%", 100.0))
def saturation_fraction(run: JointRecord) -> Array:
    """Share of samples at the torque limit."""
    return _torques(run).saturation_fraction
