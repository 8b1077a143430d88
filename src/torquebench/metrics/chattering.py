"""Chattering: the RMS of the torque above 30 Hz, and the spectrum it comes from."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array, kernel
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord

HF_FROM_HZ = 30.0
"""Lowest frequency that counts as chattering [Hz]."""
HF_MAX_PERIOD = 0.010
"""Longest control period for which the chattering index is defined [s]."""


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


@lru_cache(maxsize=8)
def first_line(n: int, control_period: float) -> int:
    """Return the index of the first line of a spectrum of n samples that counts as chattering."""
    return int(np.searchsorted(frequencies(n, control_period), HF_FROM_HZ * (1.0 - 1e-9)))


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
    _, spectrum = hann_spectrum(tau, control_period)
    high = np.abs(spectrum[first_line(n, control_period) :])
    if n % 2 == 0:
        high[-1] /= math.sqrt(2.0)
    above: Array = np.sqrt(2.0 * np.add.reduce(high * high, axis=0) / (n * n * 3.0 / 8.0))
    return 100.0 / tau_max * above


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


@metric("hf", title="chattering index HF", unit="% of tau_max", column="HF", shown_as=("%", 1.0))
def hf(run: JointRecord) -> Array:
    """RMS of the torque above 30 Hz in % of the limit, see below."""
    return chattering_index(run.tau[run.window], run.control_period, run.tau_max)
