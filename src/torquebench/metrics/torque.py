"""Torque: total variation, reversals, effort and saturation against the limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array, kernel, sign
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, shared


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
    out = np.zeros((4, tau.shape[1]))
    add_torques(tau, tau_max, out)
    travelled, turns, squares, saturated = out
    length = (len(tau) - 1) * control_period
    return TorqueMeasures(travelled / (length * tau_max), turns / length, squares / len(tau), saturated / len(tau))


@kernel
def add_torques(tau: Array, tau_max: Array, out: Array) -> None:
    """Add up, in the rows of out (4, n): |delta tau|, reversals, (tau/tau_max)^2 and samples at the limit."""
    for i in range(len(tau_max)):
        limit = tau_max[i]
        full, small = limit * (1.0 - 1e-12), 1e-3 * limit
        travelled = turns = squares = saturated = last = 0.0
        for k in range(len(tau)):
            ratio = tau[k, i] / limit
            squares += ratio * ratio
            if abs(tau[k, i]) >= full:
                saturated += 1.0
            if k > 0:
                change = tau[k, i] - tau[k - 1, i]
                travelled += abs(change)
                if abs(change) > small:
                    if change * last < 0.0:
                        turns += 1.0
                    last = sign(change)
        out[0, i], out[1, i], out[2, i], out[3, i] = travelled, turns, squares, saturated


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
