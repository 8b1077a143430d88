"""Chattering and effort formulas against closed forms of sinusoids and switching signals."""

import math

import numpy as np
import pytest

from torquebench.kernel import Array
from torquebench.metrics.chattering import chattering_index, hann_spectrum
from torquebench.metrics.step_response import step_response
from torquebench.metrics.torque import measure_torques

T = 0.001
TAU_MAX = np.array([50.0, 20.0])


def times(duration: float = 3.0, period: float = T) -> Array:
    """Control instants k T, (N,) [s]."""
    return period * np.arange(round(duration / period))


def sin(frequency: float, t: Array) -> Array:
    """Unit sine of `frequency` Hz."""
    return np.sin(2 * math.pi * frequency * t)


def columns(*signals: Array) -> Array:
    """Put one signal per joint into an (N, n) array."""
    return np.stack(signals, axis=1)


@pytest.mark.parametrize("period", [0.0005, 0.001, 0.002])
def test_hf_of_a_50_hz_sinusoid(period: float) -> None:
    """HF is the RMS in per cent of the limit, 100 A / (sqrt 2 tau_max), whatever the control period."""
    t = times(period=period)
    tau = columns(5.0 * sin(50.0, t), 4.0 * sin(50.0, t + 0.3))
    # 50 Hz is periodic in the 3 s window, and the taper's mean square is 3/8 exactly: only round-off is left.
    expected = [10.0 / math.sqrt(2), 20.0 / math.sqrt(2)]
    assert chattering_index(tau, period, TAU_MAX) == pytest.approx(expected, rel=1e-12)


def test_hf_ignores_slow_torque() -> None:
    """A constant and 10 Hz, whether or not periodic in the window, do not count as chattering."""
    t = times()
    periodic = columns(5.0 + 5.0 * sin(10.0, t), 0.0 * t)
    leaking = columns(5.0 + 5.0 * sin(10.17, t), 0.0 * t)
    # Round-off of the transform: about 1e-16 of the amplitude per line.
    assert chattering_index(periodic, T, TAU_MAX)[0] < 1e-9
    # Hann's side lobes fall as 1/(2 pi x^3), x the distance in lines; from x = 59 on they sum to 3e-6 of A.
    assert chattering_index(leaking, T, TAU_MAX)[0] < 100 * 5.0 / 50.0 * 4e-6
    untapered = np.abs(np.fft.rfft(leaking[:, 0] - leaking[:, 0].mean()))[90:]
    assert math.sqrt(2 * np.sum(untapered**2)) / len(t) / 5.0 > 1e-2  # what the taper is for


def test_spectrum_has_no_mean() -> None:
    """A constant torque has no line at all, not even at zero frequency."""
    frequency, spectrum = hann_spectrum(np.full((1000, 1), 7.0), T)
    assert frequency[[0, 1, -1]] == pytest.approx([0.0, 1.0, 500.0])
    assert np.abs(spectrum).max() < 1e-9  # round-off of a sum of 1000 sevens


def test_hf_adds_powers_and_starts_at_30_hz() -> None:
    """30 Hz is in, 29 Hz is out, and two components add as squares (their lines do not overlap in 3 s).

    Hann spreads a component over its own line (2/3 of the power) and one on either side (1/6 each): of a
    component at exactly 30 Hz, the line below 30 Hz is lost.
    """
    t = times()
    tau = columns(3.0 * sin(31.0, t) + 4.0 * sin(120.0, t) + 9.0 * sin(29.0, t), 2.0 * sin(30.0, t))
    expected = [100 * 5.0 / math.sqrt(2) / 50.0, 100 * 2.0 / math.sqrt(2) / 20.0 * math.sqrt(5 / 6)]
    assert chattering_index(tau, T, TAU_MAX) == pytest.approx(expected, rel=1e-12)


def test_hf_of_a_torque_that_alternates_at_every_instant() -> None:
    """Of +-K at half the sampling rate the index is the RMS K, whether the window is odd or even.

    The tapered line at half the sampling rate carries 1/4, its neighbour 1/16 of n^2 K^2; doubling both gives
    5/8 where 3/8 is all there is.
    """
    tau = 10.0 * np.where(np.arange(3001) % 2 == 0, 1.0, -1.0)[:, None]
    limit = np.array([50.0])
    # The mean that is removed is K/3001 in the odd window: 2e-7 relative in power.
    assert chattering_index(tau, T, limit) == pytest.approx([20.0], rel=1e-6)
    even = chattering_index(tau[:-1], T, limit)
    assert even == pytest.approx([20.0], rel=1e-12)


def test_hf_is_undefined_for_slow_control_and_short_windows() -> None:
    """At 10 ms the index exists; at 10.1 ms, or with less than 2/30 s of torque, it does not."""
    assert np.isfinite(chattering_index(np.zeros((300, 2)), 0.010, TAU_MAX)).all()
    assert np.isnan(chattering_index(np.zeros((300, 2)), 0.0101, TAU_MAX)).all()
    assert np.isnan(chattering_index(np.zeros((66, 2)), T, TAU_MAX)).all()
    assert np.isfinite(chattering_index(np.zeros((67, 2)), T, TAU_MAX)).all()


def test_total_variation_of_sine_and_triangle() -> None:
    """Per second a wave of amplitude A and frequency f moves 4 A f; in units of the limit."""
    t = times(3.001)  # 3000 intervals, whole periods of both waves
    triangle = 2.0 * np.abs(((5.0 * t) % 1.0) * 2.0 - 1.0) - 1.0
    tau = columns(5.0 * np.cos(2 * math.pi * 2.0 * t), 4.0 * triangle)
    # Samples 0, 100 and 250 lie on the extrema, so that sampling loses none of the movement.
    expected = [4 * 5.0 * 2.0 / 50.0, 4 * 4.0 * 5.0 / 20.0]
    assert measure_torques(tau, T, TAU_MAX).total_variation == pytest.approx(expected, rel=1e-9)


def test_reversals_of_switching_and_their_threshold() -> None:
    """A square wave of f Hz reverses 2 f times a second; ripple up to 1e-3 of the limit does not count."""
    t = times()
    square = np.where(np.floor(t * 50.0 + 1e-9) % 2 == 0, 1.0, -1.0)  # 25 Hz
    ripple = np.where(np.arange(len(t)) % 2 == 0, 1.0, -1.0)
    tau = columns(10.0 * square, 20.0 * 0.9e-3 / 2 * ripple)
    # The window's 149 switchings are 148 changes of direction, two fewer than 3 s hold: 2/3 per second.
    assert measure_torques(tau, T, TAU_MAX).reversals == pytest.approx([50.0, 0.0], abs=0.7)
    louder = measure_torques(1.2 * tau, T, TAU_MAX).reversals
    assert louder == pytest.approx([50.0, 1000.0], abs=0.7)


def test_reversals_of_a_slow_wave_do_not_hide_in_its_flat_crests() -> None:
    """Changes below the threshold are passed over, not counted as a pause: 2 f for a sine as well."""
    t = times(10.0)
    tau = columns(40.0 * sin(1.0, t), 0.0 * t)
    # Ten periods change direction 20 times, whether or not one at the ends is missed.
    assert measure_torques(tau, T, TAU_MAX).reversals[0] == pytest.approx(2.0, abs=0.11)


def test_effort_and_saturation() -> None:
    """Effort of a sine is (A/limit)^2/2; saturation counts both signs, and only torque at the limit."""
    t = times()
    limited = np.where(t % 1.0 < 0.25, -20.0, np.where(t % 1.0 < 0.4, 20.0, 19.99))
    tau = columns(25.0 * sin(1.0, t), limited)
    assert measure_torques(tau, T, TAU_MAX).effort[0] == pytest.approx(0.125, rel=1e-12)
    # Rounding of t % 1 may move each of the six edges by one of 3000 samples.
    assert measure_torques(tau, T, TAU_MAX).saturation_fraction == pytest.approx([0.0, 0.4], abs=6 / 3000)


@pytest.mark.parametrize("T", [0.001, 0.005, 0.01])
def test_settling_of_a_smooth_motion_does_not_depend_on_the_period(T: float) -> None:
    """Time counts from where the motion begins: 0.86473 s, the root of 1 - p(x) = 0.02 for the quintic of 1 s."""
    t = np.arange(round(2.0 / T)) * T
    x = np.clip(t, 0.0, 1.0)
    q = (x**3 * (10 - 15 * x + 6 * x * x))[:, None]
    roots = np.roots([6, -15, 10, 0, 0, -0.98])
    exact = float(min(r.real for r in roots if abs(r.imag) < 1e-9 and 0 < r.real < 1))
    # linear interpolation of a curve whose second derivative is below 6 s^-2: T^2 6/8 over a slope of 0.4 s^-1
    assert step_response(t, q, q).settling_time == pytest.approx([exact], abs=2.0 * T * T)


def test_crossings_are_interpolated_between_samples() -> None:
    """A response that rises linearly over 1 s takes 0.8 s from 10 to 90 %, wherever the samples lie."""
    t = 0.03 * np.arange(60)
    q = np.minimum(t, 1.0)[:, None]
    assert step_response(t, q, np.ones_like(q)).rise_time == pytest.approx([0.8], rel=1e-12)
    jump = np.ones_like(q)
    jump[0] = 0.0
    started = np.minimum(0.2 + 0.8 * (t - t[1]), 1.0)[:, None]  # at 20 % when the jump comes: 10 % is behind it
    assert step_response(t, started, jump).rise_time == pytest.approx([0.875], rel=1e-12)
