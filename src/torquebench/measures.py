"""The formulas behind the metrics: pure functions of sampled signals, one value per joint.

Source of every definition: docs/definitions.md, "Metrics". Signals are arrays (N, n), control instants by
joints; e = q_ref - q. A value is NaN where the metric is undefined. Sums run over the instants in order.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array, kernel, sign

HF_FROM_HZ = 30.0
"""Lowest frequency that counts as chattering [Hz]."""
HF_MAX_PERIOD = 0.010
"""Longest control period for which the chattering index is defined [s]."""


def rms(e: Array) -> Array:
    """sqrt(mean e^2) over the samples, (n,) [unit of e]."""
    out = np.zeros(e.shape[1])
    sum_of_squares(e, np.ones(e.shape[1]), out)
    return np.asarray(np.sqrt(out / len(e)))


def mean_absolute(e: Array) -> Array:
    """Mean |e| over the samples, (n,) [unit of e]."""
    out = np.zeros(e.shape[1])
    absolute_sum(e, out)
    return out / len(e)


def greatest(e: Array) -> Array:
    """Return max |e| over the samples, (n,) [unit of e]."""
    out = np.zeros(e.shape[1])
    absolute_maximum(e, out)
    return out


def absolute_error_integral(t: Array, e: Array, weight: Array | None = None) -> Array:
    """Integral of weight |e| dt by the trapezium rule, (n,) [rad s].

    IAE has weight 1; ITAE has weight t, (N,) [s], and is in rad s^2.
    """
    out = np.zeros(e.shape[1])
    trapezium(t, e, np.ones(len(t)) if weight is None else weight, out)
    return out


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


@lru_cache(maxsize=8)
def hann(n: int) -> Array:
    """Return the periodic Hann window of n samples, a column (n, 1); read-only."""
    window: Array = (0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(n) / n))[:, None]
    window.setflags(write=False)
    return window


@lru_cache(maxsize=8)
def frequencies(n: int, control_period: float) -> Array:
    """Return the frequencies of the lines of a spectrum of n samples [Hz]; read-only."""
    lines: Array = np.asarray(np.fft.rfftfreq(n, control_period), dtype=np.float64)
    lines.setflags(write=False)
    return lines


def hann_spectrum(x: Array, control_period: float) -> tuple[Array, npt.NDArray[np.complex128]]:
    """Frequencies [Hz] and rfft of x less its mean under a periodic Hann window (mean square 3/8)."""
    n = len(x)
    spectrum = np.fft.rfft((x - np.mean(x, axis=0)) * hann(n), axis=0)
    return frequencies(n, control_period), spectrum


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
    out = np.zeros(tau.shape[1])
    travelled(tau, out)
    return out / ((len(tau) - 1) * control_period * tau_max)


def reversals(tau: Array, control_period: float, tau_max: Array) -> Array:
    """Sign changes per second of delta tau, (n,) [1/s]; changes of at most 1e-3 tau_max are passed over."""
    counts = np.zeros(tau.shape[1])
    turns(tau, tau_max, counts)
    return counts / ((len(tau) - 1) * control_period)


def effort(tau: Array, tau_max: Array) -> Array:
    """Mean (tau/tau_max)^2, (n,) [1]."""
    out = np.zeros(tau.shape[1])
    sum_of_squares(tau, tau_max, out)
    return out / len(tau)


def saturation_fraction(tau: Array, tau_max: Array) -> Array:
    """Fraction of the samples with |tau| at its limit, (n,) [1]."""
    below = np.zeros(tau.shape[1])
    count_below(tau, tau_max * (1.0 - 1e-12), below)
    return (len(tau) - below) / len(tau)


def time_in_band(s: Array, phi: Array | float) -> Array:
    """Fraction of the samples with |s| <= phi, (n,) [1]; NaN for a joint whose s is not always defined."""
    n = s.shape[1]
    outside = np.zeros(n)
    count_above(s, np.array(np.broadcast_to(phi, (n,)), dtype=np.float64), outside)
    return (len(s) - outside) / len(s)


@kernel
def sum_of_squares(x: Array, unit: Array, out: Array) -> None:
    """Add (x/unit)^2 up over the samples x (N, n); unit and out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            ratio = x[k, i] / unit[i]
            out[i] += ratio * ratio


@kernel
def absolute_sum(x: Array, out: Array) -> None:
    """Add |x| up over the samples x (N, n); out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            out[i] += abs(x[k, i])


@kernel
def absolute_maximum(x: Array, out: Array) -> None:
    """Find the greatest |x| of the samples x (N, n); out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            if abs(x[k, i]) > out[i]:
                out[i] = abs(x[k, i])


@kernel
def trapezium(t: Array, x: Array, weight: Array, out: Array) -> None:
    """Integrate |x| weight by the trapezium rule; t and weight (N,), x (N, n), out (n,)."""
    for k in range(1, len(t)):
        step = t[k] - t[k - 1]
        for i in range(len(out)):
            out[i] += step * (abs(x[k, i]) * weight[k] + abs(x[k - 1, i]) * weight[k - 1]) / 2.0


@kernel
def travelled(x: Array, out: Array) -> None:
    """Add the changes |x_k - x_(k-1)| up over the samples x (N, n); out (n,)."""
    for k in range(1, len(x)):
        for i in range(len(out)):
            out[i] += abs(x[k, i] - x[k - 1, i])


@kernel
def turns(x: Array, size: Array, out: Array) -> None:
    """Count how often x (N, n) turns round, changes of at most a thousandth of size (n,) passed over; out (n,)."""
    for i in range(len(out)):
        last = 0.0
        for k in range(1, len(x)):
            change = x[k, i] - x[k - 1, i]
            if abs(change) > 1e-3 * size[i]:
                if change * last < 0.0:
                    out[i] += 1.0
                last = sign(change)


@kernel
def count_below(x: Array, limit: Array, out: Array) -> None:
    """Count the samples of x (N, n) with |x| < limit (n,); out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            if abs(x[k, i]) < limit[i]:
                out[i] += 1.0


@kernel
def count_above(x: Array, limit: Array, out: Array) -> None:
    """Count the samples of x (N, n) with |x| > limit (n,); NaN from a sample on that is not finite; out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            if not abs(x[k, i]) <= limit[i]:
                out[i] += 1.0 + 0.0 * x[k, i]
