"""The formulas behind the metrics: pure functions of sampled signals, one value per joint.

Source of every definition: docs/definitions.md, "Metrics". Signals are arrays (N, n), control instants by
joints; e = q_ref - q. A value is NaN where the metric is undefined.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array

HF_FROM_HZ = 30.0
"""Lowest frequency that counts as chattering [Hz]."""
HF_MAX_PERIOD = 0.010
"""Longest control period for which the chattering index is defined [s]."""


def rms(e: Array) -> Array:
    """sqrt(mean e^2) over the samples, (n,) [unit of e]."""
    return np.asarray(np.sqrt(np.mean(e * e, axis=0)))


def absolute_error_integral(t: Array, e: Array, weight: Array | None = None) -> Array:
    """Integral of weight |e| dt by the trapezium rule, (n,) [rad s].

    IAE has weight 1; ITAE has weight t, (N,) [s], and is in rad s^2.
    """
    weighted = np.abs(e) if weight is None else np.abs(e) * weight[:, None]
    return np.asarray(np.trapezoid(weighted, t, axis=0), dtype=np.float64)


class StepResponse(NamedTuple):
    """Response to a step; arrays (n,), NaN where undefined."""

    rise_time: Array
    """Time from 10 % to 90 % of the step [s]; NaN for a joint that never reaches 90 %."""
    overshoot: Array
    """Largest excess over the final reference [% of the step], at least 0."""
    settling_time: Array
    """Time from the step after which |q - q_end| <= 2 % of the step [s]; NaN if outside at the end."""
    counted: npt.NDArray[np.bool_]
    """Joints that have a step at all."""


def step_response(t: Array, q: Array, q_ref: Array) -> StepResponse:
    """Rise time, overshoot and settling time of each joint; crossings are interpolated between samples.

    The step goes from the reference's first value to its last. Time counts from the instant of a jump, the first
    at which the joint's reference differs from its first value; of a reference that moves smoothly, from the
    instant before, at which it begins to move. If no joint's reference ever moves, the step starts at t = 0 from
    each joint's own initial position.
    """
    n = q.shape[1]
    changed = q_ref != q_ref[0]
    moves = bool(changed.any())
    start = q_ref[0] if moves else q[0]
    amplitude = q_ref[-1] - start
    rise, over, settle = (np.full(n, np.nan) for _ in range(3))
    for i in range(n):
        if amplitude[i] == 0.0:
            continue
        first = int(np.argmax(changed[:, i])) if moves else 0
        if first > 0 and abs(q_ref[first, i] - start[i]) < 0.5 * abs(amplitude[i]):
            first -= 1
        times = t[first:]
        y = (q[first:, i] - start[i]) / amplitude[i]
        rise[i] = _reaches(times, y, 0.9) - _reaches(times, y, 0.1)
        over[i] = 100.0 * max(0.0, float(np.max(y)) - 1.0)
        settle[i] = _settles(times, y - 1.0, 0.02)
    return StepResponse(rise, over, settle, amplitude != 0.0)


def _reaches(t: Array, y: Array, level: float) -> float:
    reached = y >= level
    k = int(np.argmax(reached))
    if not reached[k]:
        return math.nan
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]))


def _settles(t: Array, deviation: Array, band: float) -> float:
    outside = np.flatnonzero(np.abs(deviation) > band)
    if len(outside) == 0:
        return 0.0
    k = int(outside[-1])
    if k == len(t) - 1:
        return math.nan
    before, after = deviation[k], deviation[k + 1]
    edge = math.copysign(band, before)
    return float(t[k] + (before - edge) / (before - after) * (t[k + 1] - t[k]) - t[0])


def hann_spectrum(x: Array, control_period: float) -> tuple[Array, npt.NDArray[np.complex128]]:
    """Frequencies [Hz] and rfft of x less its mean under a periodic Hann window (mean square 3/8)."""
    n = len(x)
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(n) / n)
    spectrum = np.fft.rfft((x - np.mean(x, axis=0)) * window[:, None], axis=0)
    return np.asarray(np.fft.rfftfreq(n, control_period), dtype=np.float64), spectrum


def chattering_index(tau: Array, control_period: float, tau_max: Array) -> Array:
    """HF_i = 100/tau_max,i sqrt(2 sum_{f >= 30 Hz} |F|^2 / (n^2 3/8)), F = rfft(tau w), (n,) [% of tau_max].

    The RMS of the torque above 30 Hz. Of an even number of samples the line at half the sampling rate counts once,
    not twice: it has no mirror image. NaN above a control period of 10 ms, and for a window shorter than 2/30 s,
    where the taper's main lobe would reach from zero frequency past 30 Hz.
    """
    n = len(tau)
    if control_period > HF_MAX_PERIOD * (1.0 + 1e-9) or n * control_period * HF_FROM_HZ < 2.0:
        return np.full(tau.shape[1], np.nan)
    frequency, spectrum = hann_spectrum(tau, control_period)
    high = np.abs(spectrum[frequency >= HF_FROM_HZ * (1.0 - 1e-9)])
    if n % 2 == 0:
        high[-1] /= math.sqrt(2.0)
    above: Array = np.sqrt(2.0 * np.sum(high * high, axis=0) / (n * n * 3.0 / 8.0))
    return 100.0 / tau_max * above


def total_variation(tau: Array, control_period: float, tau_max: Array) -> Array:
    """Sum |delta tau| / (length tau_max), (n,) [tau_max/s]; length = time from first to last sample."""
    steps = np.diff(tau, axis=0)
    return np.asarray(np.sum(np.abs(steps), axis=0)) / (len(steps) * control_period * tau_max)


def reversals(tau: Array, control_period: float, tau_max: Array) -> Array:
    """Sign changes per second of delta tau, (n,) [1/s]; changes of at most 1e-3 tau_max are passed over."""
    steps = np.diff(tau, axis=0)
    counts = np.zeros(tau.shape[1])
    for i in range(tau.shape[1]):
        rising = steps[np.abs(steps[:, i]) > 1e-3 * tau_max[i], i] > 0.0
        counts[i] = np.count_nonzero(rising[1:] != rising[:-1])
    return counts / (len(steps) * control_period)


def effort(tau: Array, tau_max: Array) -> Array:
    """Mean (tau/tau_max)^2, (n,) [1]."""
    return np.asarray(np.mean((tau / tau_max) ** 2, axis=0))


def saturation_fraction(tau: Array, tau_max: Array) -> Array:
    """Fraction of the samples with |tau| at its limit, (n,) [1]."""
    return np.asarray(np.mean(np.abs(tau) >= tau_max * (1.0 - 1e-12), axis=0))


def time_in_band(s: Array, phi: Array | float) -> Array:
    """Fraction of the samples with |s| <= phi, (n,) [1]; NaN for a joint whose s is not always defined."""
    inside = np.mean(np.abs(s) <= phi, axis=0)
    return np.where(np.isfinite(s).all(axis=0), inside, np.nan)
