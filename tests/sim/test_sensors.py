"""What a law sees through imperfect sensors: offset, ripple, tachometer and Kalman filter against independent forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.sim.test_chain_parts import measured, true
from tests.sim.test_native_chain import N_STEPS, T, job_of, measure
from torquebench.chain import Chain, Drawn, Ripple
from torquebench.chain.sensors import kalman_gains
from torquebench.kernel import Array


def test_offset_and_ripple() -> None:
    """Y = q + a sin(c q + p) + offset, joint by joint; the exact velocity is not touched."""
    ripple = Ripple(amplitude=(0.01, 0.02), cycles=(1.0, 8.0), phase=(0.3, -0.2))
    q, qd = measured(Chain(encoder_offset=(0.05, -0.1), encoder_ripple=ripple))
    x = true()[0]
    assert q == pytest.approx(x + [0.01, 0.02] * np.sin([1.0, 8.0] * x + [0.3, -0.2]) + [0.05, -0.1], abs=1e-15)
    assert qd.tobytes() == true()[1].tobytes()


def test_a_differentiated_ripple_shakes_the_velocity() -> None:
    """At a speed of 2 rad/s, 100 cycles of 0.1 mrad give a false speed of 100 x 2 x 0.1 mrad = 20 mrad/s."""
    job = job_of(Chain(encoder_ripple=Ripple(1e-4, 100.0), velocity="differentiated"))
    seen = []
    for k in range(N_STEPS):
        job.q[:] = 2.0 * k * T
        measure(job, k)
        seen.append(job.measured_qd[0])
    assert np.max(np.abs(np.array(seen[1:]) - 2.0)) == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize("rate", [None, 200.0])
def test_a_tachometer(rate: float | None) -> None:
    """V = qd + noise, through a filter v += a (qd + noise - v) from the first reading on; the position is exact."""
    noise = 0.01 * np.random.default_rng(3).normal(size=(N_STEPS, 2))
    q, qd = measured(Chain(velocity="tachometer", velocity_noise=0.01, velocity_filter=rate), Drawn(velocity=noise))
    readings = true()[1] + noise
    wanted = readings.copy()
    if rate is not None:
        for k in range(1, N_STEPS):
            wanted[k] = wanted[k - 1] + (1.0 - math.exp(-rate * T)) * (readings[k] - wanted[k - 1])
    assert qd == pytest.approx(wanted, rel=1e-13)
    assert q.tobytes() == true()[0].tobytes()


@pytest.mark.parametrize(("acceleration", "noise"), [(5.0, 1e-4), (100.0, 1e-4), (1.0, 1e-2), (2000.0, 1e-5)])
def test_kalman_gains_are_the_steady_ones(acceleration: float, noise: float) -> None:
    """Those of the Riccati equation, by scipy: F = [1 T; 0 1], w constant over a period, position measured."""
    F, G = np.array([[1.0, T], [0.0, 1.0]]), np.array([[0.5 * T * T], [T]])
    H = np.array([[1.0, 0.0]])
    P = solve_discrete_are(F.T, H.T, acceleration**2 * G @ G.T, np.array([[noise**2]]))
    wanted = (P @ H.T / (H @ P @ H.T + noise**2)).ravel()
    assert kalman_gains(acceleration, noise, T) == pytest.approx((wanted[0], wanted[1] * T), rel=1e-9)


def filtered(y: Array, alpha: float, beta: float) -> Array:
    """Return the velocity of an alpha-beta filter of positions (N, 2), written down another way: in matrices."""
    x, out = np.array([y[0], np.zeros(2)]), [np.zeros(2)]
    F, K = np.array([[1.0, T], [0.0, 1.0]]), np.array([[alpha], [beta / T]])
    for measurement in y[1:]:
        x = F @ x
        x = x + K @ (measurement - x[0])[None]
        out.append(x[1])
    return np.array(out)


def test_the_kalman_filter() -> None:
    """The velocity is the filter's, of noisy and rounded positions; the position is shown as measured."""
    noise = 1e-3 * np.random.default_rng(3).normal(size=(N_STEPS, 2))
    chain = Chain(velocity="kalman", kalman_acceleration=20.0, encoder_noise=1e-3, quantisation=2e-4)
    q, qd = measured(chain, Drawn(noise))
    gains = kalman_gains(20.0, math.hypot(1e-3, 2e-4 / math.sqrt(12.0)), T)
    assert q == pytest.approx(true()[0] + noise, abs=1.0001e-4)
    assert qd == pytest.approx(filtered(q, *gains), rel=1e-12, abs=1e-12)


def test_a_kalman_filter_is_late_by_its_gains() -> None:
    """On a steady acceleration the velocity lags by T (alpha/beta - 1/2); `reaction` counts T alpha/beta for it."""
    chain = Chain(velocity="kalman", kalman_acceleration=20.0, encoder_noise=1e-3)
    alpha, beta = kalman_gains(20.0, 1e-3, T)
    job, n = job_of(chain), 1200
    for k in range(n):
        job.q[:] = 0.5 * 3.0 * (k * T) ** 2
        measure(job, k)
    late = (3.0 * (n - 1) * T - job.measured_qd[0]) / 3.0
    assert late == pytest.approx(T * (alpha / beta - 0.5), rel=1e-3)
    assert chain.reaction(T) == pytest.approx(T + T * alpha / beta)
