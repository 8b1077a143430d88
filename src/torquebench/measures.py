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


class Errors(NamedTuple):
    """How far a joint is from its reference; arrays (n,)."""

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


def errors(t: Array, e: Array, first: int, last: int) -> Errors:
    """Return the measures of a tracking error.

    Args:
        t: Control instants, (N,) [s].
        e: The error at each of them, (N, n).
        first: Where the window of RMS and maximum begins.
        last: Number of samples at the end that the steady-state error is taken over.
    """
    out = np.zeros((5, e.shape[1]))
    add_errors(t, e, first, len(e) - last, out)
    square, greatest, steady, iae, itae = out
    return Errors(np.sqrt(square / (len(e) - first)), greatest, steady / last if last else out[0] + np.nan, iae, itae)


class Torques(NamedTuple):
    """What a joint's torque costs; arrays (n,)."""

    total_variation: Array
    """Sum |delta tau| / (length tau_max) [tau_max/s]; length = time from first to last sample."""
    reversals: Array
    """Sign changes per second of delta tau [1/s]; changes of at most 1e-3 tau_max are passed over."""
    effort: Array
    """Mean (tau/tau_max)^2 [1]."""
    saturation_fraction: Array
    """Fraction of the samples with |tau| at its limit [1]."""


def torques(tau: Array, control_period: float, tau_max: Array) -> Torques:
    """Return the measures of a torque tau (N, n) [N m] against its limits tau_max (n,) [N m]."""
    out = np.zeros((4, tau.shape[1]))
    add_torques(tau, tau_max, out)
    travelled, turns, squares, saturated = out
    length = (len(tau) - 1) * control_period
    return Torques(travelled / (length * tau_max), turns / length, squares / len(tau), saturated / len(tau))


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
    """Return the periodic Hann window of n samples, (n,); read-only."""
    window: Array = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(n) / n)
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
    tapered, total = np.empty(x.shape), np.zeros(x.shape[1])
    taper(x, hann(n), total, tapered)
    return frequencies(n, control_period), np.fft.rfft(tapered, axis=0)


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
    high = np.abs(spectrum[np.searchsorted(frequency, HF_FROM_HZ * (1.0 - 1e-9)) :])
    if n % 2 == 0:
        high[-1] /= math.sqrt(2.0)
    above: Array = np.sqrt(2.0 * np.sum(high * high, axis=0) / (n * n * 3.0 / 8.0))
    return 100.0 / tau_max * above


def time_in_band(s: Array, phi: Array | float) -> Array:
    """Fraction of the samples with |s| <= phi, (n,) [1]; NaN for a joint whose s is not always defined."""
    inside, limit = np.zeros(s.shape[1]), np.empty(s.shape[1])
    limit[:] = phi
    count_within(s, limit, inside)
    return inside / len(s)


@kernel
def taper(x: Array, window: Array, mean: Array, out: Array) -> None:
    """Fill out (N, n) with x less its mean, times the window (N,); mean (n,) begins at zero."""
    for k in range(len(x)):
        for i in range(len(mean)):
            mean[i] += x[k, i]
    for i in range(len(mean)):
        mean[i] /= len(x)
    for k in range(len(x)):
        for i in range(len(mean)):
            out[k, i] = (x[k, i] - mean[i]) * window[k]


@kernel
def add_errors(t: Array, e: Array, first: int, last: int, out: Array) -> None:
    """Add up, in the rows of out (5, n): e^2, max |e| and |e| from instants first and last on, |e| dt and t |e| dt."""
    for i in range(e.shape[1]):
        squares = greatest = steady = iae = itae = before = 0.0
        for k in range(len(t)):
            size = abs(e[k, i])
            if k >= first:
                squares += size * size
                if size > greatest:
                    greatest = size
            if k >= last:
                steady += size
            if k > 0:
                step = t[k] - t[k - 1]
                iae += step * (size + before) * 0.5
                itae += step * (size * t[k] + before * t[k - 1]) * 0.5
            before = size
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i] = squares, greatest, steady, iae, itae


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


@kernel
def count_within(x: Array, limit: Array, out: Array) -> None:
    """Count the samples of x (N, n) with |x| <= limit (n,); NaN where a sample is not finite; out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            if abs(x[k, i]) <= limit[i]:
                out[i] += 1.0
            else:
                out[i] += 0.0 * x[k, i]
