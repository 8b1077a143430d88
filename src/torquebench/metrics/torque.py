"""Torque: total variation, reversals, effort and saturation against the limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, shared, total


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
    length = (len(tau) - 1) * control_period
    ratio, change = tau / tau_max, np.diff(tau, axis=0)
    turns = np.zeros(len(tau_max))
    for i, limit in enumerate(tau_max):
        rising = change[np.abs(change[:, i]) > 1e-3 * limit, i] > 0.0
        turns[i] = np.count_nonzero(rising[1:] != rising[:-1])
    return TorqueMeasures(
        total(np.abs(change)) / (length * tau_max),
        turns / length,
        total(ratio * ratio) / len(tau),
        np.count_nonzero(np.abs(tau) >= tau_max * (1.0 - 1e-12), axis=0) / len(tau),
    )


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
