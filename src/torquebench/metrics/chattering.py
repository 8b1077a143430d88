"""Chattering: the RMS of the torque above a corner that follows the motion, its peak, and whether it is a limit cycle.

Source of every definition: docs/definitions.md, "Chattering". HF, the same sum from a fixed 30 Hz on, stands beside.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, pieces, shared, total

HF_FROM_HZ = 30.0
"""Lowest frequency that counts for HF [Hz]."""
HF_MAX_PERIOD = 0.010
"""Longest control period for which HF is defined [s]."""
COARSEST = HF_FROM_HZ * HF_MAX_PERIOD
"""Longest control period for which an index is defined, in periods of the frequency from which it counts [1]."""
LEAST_CORNER_HZ = 8.0
"""Lowest frequency from which torque counts as chattering unless a config says otherwise [Hz]."""
CORNER_OVER_MOTION = 8.0
"""That frequency over the highest one of the reference [1]."""
STILL = 0.1
"""Chattering below which a joint has neither peak nor limit cycle [% of the torque limit]."""
LINE_WIDTH = 1.0 / 8.0
"""Reach of a limit cycle's lines on either side of each multiple of the peak's frequency [that frequency]."""
LINE_SHARE = 0.5
"""Share of the power above the corner, beyond what noise has there, from which such lines are a limit cycle [1]."""
LEAST_PERIODS = 8.0
"""Periods of the peak that a window must have to tell whether it is a limit cycle's [1]."""
LEAST_LINES = 50
"""Lines above f_c that a spectrum must have for it: of few lines noise has half its power in two or three by chance."""
LASTING = 0.25
"""Power of the lines in the second half of the window over that in the first, from which they do not die away [1]."""
FORCED = 0.25
"""Share of its power that a disturbance has near a frequency which it forces on a joint [1]."""


def corner_hz(highest: float) -> float:
    """Return the frequency from which torque counts as chattering on a motion without frequencies above `highest`."""
    return max(LEAST_CORNER_HZ, CORNER_OVER_MOTION * highest)


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
    tapered = x - total(x) / n
    tapered *= hann(n)[:, None]
    return frequencies(n, control_period), np.fft.rfft(tapered, axis=0)


def line_powers(x: Array, control_period: float) -> Array:
    """Return |F|^2 of each line of `hann_spectrum`, such that twice its sum is n^2 3/8 times the mean square, (m, n).

    Of an even number of samples the line at half the sampling rate counts once, not twice: it has no mirror image.

    Args:
        x: Torque at each control instant, (N, n) [N m].
        control_period: Time between them [s].
    """
    _, spectrum = hann_spectrum(x, control_period)
    size: Array = np.abs(spectrum)
    if len(x) % 2 == 0:
        size[-1] /= math.sqrt(2.0)
    size *= size
    return size


def chattering_index(tau: Array, control_period: float, tau_max: Array, from_hz: float = HF_FROM_HZ) -> Array:
    """100/tau_max,i sqrt(2 sum_{f >= f_c} |F|^2 / (n^2 3/8)), F = rfft(tau w), (n,) [% of tau_max].

    The RMS of the torque above f_c. NaN above a control period of 0.3/f_c, and for a window shorter than 2/f_c, where
    the taper's main lobe would reach from zero frequency past f_c.

    Args:
        tau: Torque at each control instant, (N, n) [N m].
        control_period: Time between them [s].
        tau_max: Torque limits, (n,) [N m].
        from_hz: f_c [Hz].
    """
    return index_of(line_powers(tau, control_period), len(tau), control_period, tau_max, from_hz)


def index_of(powers: Array, n: int, control_period: float, tau_max: Array, from_hz: float) -> Array:
    """Return the `chattering_index` of a torque whose spectrum is known.

    Args:
        powers: Its `line_powers`, (m, n).
        n: Number of its samples.
        control_period: Time between them [s].
        tau_max: Torque limits, (n,) [N m].
        from_hz: f_c [Hz].
    """
    if control_period * from_hz > COARSEST * (1.0 + 1e-9) or n * control_period * from_hz < 2.0:
        return np.full(len(tau_max), np.nan)
    high = powers[first_line(n, control_period, from_hz) :]
    above: Array = np.sqrt(2.0 * np.add.reduce(high, axis=0) / (n * n * 3.0 / 8.0))
    return 100.0 / tau_max * above


@lru_cache(maxsize=16)
def first_line(n: int, control_period: float, from_hz: float) -> int:
    """Return the index of the first line of a spectrum of n samples that is at `from_hz` [Hz] or above."""
    return int(np.searchsorted(frequencies(n, control_period), from_hz * (1.0 - 1e-9)))


def limit_cycle_shares(tau: Array, control_period: float, powers: Array, from_hz: float, peaks: Array) -> Array:
    """Return the share of each joint's power above f_c that a limit cycle has, (n,): 0 where there is none.

    The lines of a limit cycle are those within an eighth of the peak's frequency, and at least two lines, of each
    multiple of it. Noise without lines has about as much of the power there as they are of all lines above f_c: c. Of
    what the lines have, the share beyond that, (share - c) / (1 - c), is the limit cycle's; there is one from a half
    on, if the lines do not die away: in the second half of the window they have at least a quarter of the power that
    they have in the first.

    Args:
        tau: Torque at each control instant, (N, n) [N m].
        control_period: Time between them [s].
        powers: Its `line_powers`, (m, n).
        from_hz: f_c [Hz].
        peaks: Frequency of the largest line above it, (n,) [Hz]; NaN for a joint that has no limit cycle anyhow.

    Returns:
        (n,), NaN in a window that cannot tell: one shorter than eight periods of the peak, or of fewer than 50 lines.
    """
    n = len(tau)
    near, among, whole, lines = powers_near(powers, n, control_period, from_hz, peaks)
    unknown = np.isfinite(peaks) & ((n * control_period * peaks < LEAST_PERIODS) | (lines < LEAST_LINES))
    some = np.isfinite(peaks) & ~unknown
    shares = np.where(unknown, np.nan, 0.0)
    by_chance = among[some] / lines
    shares[some] = (near[some] / whole[some] - by_chance) / (1.0 - by_chance)
    shares[shares < LINE_SHARE] = 0.0
    found = np.flatnonzero(shares > 0.0)
    if len(found):
        half, tau = n // 2, np.ascontiguousarray(tau[:, found])
        before, after = (
            powers_near(line_powers(part, control_period), half, control_period, from_hz, peaks[found])[0]
            for part in (tau[:half], tau[-half:])
        )
        shares[found[after < LASTING * before]] = 0.0
    return shares


def is_forced(disturbance: Array | None, control_period: float, frequency: float) -> bool:
    """Whether a disturbance has a quarter of some joint's power, mean left out, at a frequency, to 5 % or one line.

    Args:
        disturbance: Torque of each control period, (N, n) [N m]; None for none.
        control_period: Its length [s].
        frequency: The frequency [Hz].
    """
    if disturbance is None or not math.isfinite(frequency):
        return False
    return _forces(*_spectrum_of(disturbance, control_period), frequency)


def _spectrum_of(disturbance: Array, control_period: float) -> tuple[Array, Array, Array]:
    """Return the lines of a disturbance's spectrum [Hz], the power of each and of all, (m,), (m, n), (n,)."""
    lines, spectrum = hann_spectrum(disturbance, control_period)
    power: Array = np.abs(spectrum) ** 2
    return lines, power, np.sum(power, axis=0)


def _forces(lines: Array, power: Array, whole: Array, frequency: float) -> bool:
    """Whether some joint has `FORCED` of its power at a frequency [Hz]."""
    return bool(np.any(np.sum(power[_near(lines, frequency)], axis=0) > FORCED * whole))


def _near(lines: Array, frequency: float) -> npt.NDArray[np.bool_]:
    """Return which lines [Hz] are near a frequency, to 5 % of it or one line."""
    return np.asarray(np.abs(lines - frequency) <= np.maximum(0.05 * frequency, 1.5 * lines[1]))


def is_of_motion(tau: Array, needed: Array, control_period: float, frequency: float) -> bool:
    """Whether the torque that a motion takes has a quarter of a joint's power at a frequency, to 5 %.

    Args:
        tau: The torque, (N,) [N m].
        needed: Torque that the desired motion takes, (N,) [N m].
        control_period: Time between samples [s].
        frequency: The frequency [Hz].
    """
    lines, power, _ = _spectrum_of(np.stack([tau, needed], axis=1), control_period)
    whole, own = np.sum(power[_near(lines, frequency)], axis=0)
    return bool(own > FORCED * whole)


def is_harmonic(power: Array, spacing: float, peak: float, motion_hz: float) -> bool:
    """Whether a peak is one of the motion's harmonics, which fall off: of the two below it one is at least as large.

    Args:
        power: Power of each line of a torque's spectrum, (m,).
        spacing: Frequency from one line to the next [Hz]; four periods of the motion tell its harmonics apart.
        peak: Frequency of the peak [Hz].
        motion_hz: Frequency of the motion [Hz]; 0 for one that does not swing.
    """
    if motion_hz < 4.0 * spacing * (1.0 - 1e-9):
        return False
    order = round(peak / motion_hz)
    if abs(peak - order * motion_hz) > 1.5 * spacing:
        return False
    below = [round(k * motion_hz / spacing) for k in (order - 1, order - 2) if k > 0]
    return any(float(np.max(power[k - 1 : k + 2])) >= power[round(peak / spacing)] for k in below)


def powers_near(
    powers: Array, n: int, control_period: float, from_hz: float, peaks: Array
) -> tuple[Array, Array, Array, int]:
    """Return the power near the multiples of each joint's peak, in how many lines, the whole power, all lines.

    Args:
        powers: `line_powers` of the torque, (m, n).
        n: Number of its samples.
        control_period: Time between them [s].
        from_hz: Frequency from which lines count [Hz].
        peaks: Frequency of the peak, (n,) [Hz]; NaN for none.
    """
    first, spacing = first_line(n, control_period, from_hz), 1.0 / (n * control_period)
    near, among, whole = np.zeros((3, len(peaks)))
    some = np.flatnonzero(peaks > 0.0)
    high, peak = np.take(powers[first:], some, axis=1), peaks[some]
    place = np.arange(first, len(powers))[:, None] * spacing
    reach, lines, count = np.maximum(LINE_WIDTH * peak, 2.0 * spacing) * (1.0 + 1e-9), np.zeros(len(some)), 0
    for piece in pieces(high) if len(some) else ():
        off = place[piece] / peak
        off += 0.5
        np.floor(off, out=off)
        np.maximum(off, 1.0, out=off)  # the multiple that is nearest
        off *= peak
        np.subtract(place[piece], off, out=off)
        is_near = np.abs(off, out=off) <= reach
        lines = total(high[piece] * is_near, lines)
        count += np.count_nonzero(is_near, axis=0)
    near[some], among[some], whole[some] = lines, count, total(high)
    return near, among, whole, len(high)


@shared
def _powers(run: JointRecord) -> Array:
    return line_powers(run.tau[run.window], run.control_period)


def _index(run: JointRecord, from_hz: float) -> Array:
    return index_of(_powers(run), run.window.stop - run.window.start, run.control_period, run.tau_max, from_hz)


@shared
def _chattering(run: JointRecord) -> Array:
    return _index(run, run.chattering_from_hz)


@shared
def _peaks(run: JointRecord) -> Array:
    n = run.window.stop - run.window.start
    first = first_line(n, run.control_period, run.chattering_from_hz)
    found = np.full(len(run.tau_max), np.nan)
    audible = _chattering(run) >= STILL
    if audible.any():
        largest = np.argmax(_powers(run)[first:], axis=0) + first
        found[audible] = frequencies(n, run.control_period)[largest[audible]]
    return found


@metric("chattering", title="chattering", unit="% of tau_max", shown_as=("%", 1.0))
def chattering(run: JointRecord) -> Array:
    """RMS of the torque above f_c in % of the limit, see below."""
    return _chattering(run)


@metric("chattering_peak", title="peak of chattering", unit="Hz", over_joints="chattering", column="peak")
def chattering_peak(run: JointRecord) -> Array:
    """Frequency of the torque's largest line above f_c; none below 0.1 % of chattering."""
    return _peaks(run)


@metric("limit_cycle", title="limit cycle", unit="% of tau_max", column="cycle", shown_as=("%", 1.0))
def limit_cycle(run: JointRecord) -> Array:
    """RMS of the limit cycle that chattering is, in % of the limit; 0 where it is none."""
    tau, peaks, period = run.tau[run.window], _peaks(run), run.control_period
    shares = limit_cycle_shares(tau, period, _powers(run), run.chattering_from_hz, peaks)
    spacing, n = 1.0 / (len(tau) * period), len(peaks) // len(run.disturbances)
    spectra = dict[int, tuple[Array, Array, Array]]()  # runs of one draw share their disturbance
    for i in np.flatnonzero(shares > 0.0):
        forced, cause = False, run.disturbances[i // n]
        if cause is not None:
            if id(cause) not in spectra:
                spectra[id(cause)] = _spectrum_of(cause, period)
            forced = _forces(*spectra[id(cause)], peaks[i])
        if forced or any(is_harmonic(_powers(run)[:, i], spacing, peaks[i], f) for f in run.motion_hz):
            shares[i] = 0.0
    return _chattering(run) * np.sqrt(shares)


@metric("hf", title="chattering index HF", unit="% of tau_max", column="HF", shown_as=("%", 1.0))
def hf(run: JointRecord) -> Array:
    """RMS of the torque above 30 Hz in % of the limit, see below."""
    return _index(run, HF_FROM_HZ)
