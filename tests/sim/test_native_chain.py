"""Sensors and actuators, step by step: the loop's kernels against their formulas in numpy and against integrals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.arms import slider, still
from tests.sim.loops import arm, go, law_of, plant_of
from tests.sim.protocol import CONDITIONS, PLANTS, REFERENCES, Case, variants
from torquebench.chain import CHAINS, IDEAL, Chain, Drawn
from torquebench.chain.sensors import measure as measure_by
from torquebench.kernel import Array
from torquebench.references import Reference
from torquebench.sim.closed_loop import actuate, give, inside
from torquebench.sim.job import Job, set_up
from torquebench.sim.plants import INTEGRATORS
from torquebench.sim.plants.analytic import AnalyticPlant

N_STEPS, T = 30, 0.004
LAW = law_of(lambda *arguments: None)


def job_of(
    chain: Chain, noise: Array | Drawn | None = None, disturbance: Array | None = None, timestep: float = 0.001
) -> Job:
    """Return the job of a run of the two-joint arm with a period of 4 ms; `noise` of the position, or all drawn."""
    desired = Reference(*np.zeros((3, N_STEPS, 2)))
    return set_up(
        LAW.law,
        (),
        arm().flat,
        plant_of("analytic", timestep),
        desired,
        chain,
        control_period=T,
        substeps=round(T / timestep),
        drawn=noise if isinstance(noise, Drawn) else Drawn(noise),
        disturbance=disturbance,
        native=None,
    ).job


def measure(job: Job, k: int) -> None:
    """Measure the job's state at control instant k, as the loop does."""
    measure_by(job.sensors, k, job.control_period, job.q, job.qd, job.fresh_q, job.fresh_qd)


def motion(k: int) -> tuple[Array, Array]:
    """Return some position, and a velocity that has nothing to do with it, so that its use would show."""
    return np.array([0.3 * math.sin(0.2 * k), -0.1 * k - 0.05]), np.array([5.0, -7.0])


@pytest.mark.parametrize("rate", [200.0, 500.0, 1e6])
@pytest.mark.parametrize("noisy", [False, True])
def test_the_velocity_filter(rate: float, noisy: bool) -> None:
    """v_k = v_(k-1) + (1 - exp(-rate T)) ((y_k - y_(k-1))/T - v_(k-1)), v_0 = 0, y = q + noise; in every byte.

    A very fast filter is the backward difference itself.
    """
    noise = 1e-4 * np.random.default_rng(4).normal(size=(N_STEPS, 2)) if noisy else None
    job = job_of(Chain(velocity="differentiated", velocity_filter=rate), noise)
    gain = 1.0 - math.exp(-rate * T)
    y, v = np.zeros(2), np.zeros(2)
    for k in range(N_STEPS):
        job.q[:], job.qd[:] = motion(k)
        measure(job, k)
        before, y = y, motion(k)[0] + (noise[k] if noise is not None else 0.0)
        if k > 0:
            v = v + gain * ((y - before) / T - v)
        assert job.measured_q.tobytes() == y.tobytes()
        assert job.measured_qd.tobytes() == v.tobytes()
        if rate > 1e5 and k > 0:
            assert v == pytest.approx((y - before) / T, abs=1e-12)
    assert np.all(np.abs(v) > 1.0)


def test_a_filter_settles_as_its_rate_says() -> None:
    """On a ramp of 1 rad/s, v_k = 1 - exp(-rate k T): 63 % after one time constant, the true speed in the end."""
    job = job_of(Chain(velocity="differentiated", velocity_filter=50.0))
    for k in range(N_STEPS):
        job.q[:] = k * T
        measure(job, k)
        assert job.measured_qd == pytest.approx(np.full(2, 1.0 - math.exp(-50.0 * k * T)), abs=1e-12)


def test_noise_without_a_filter_leaves_the_velocity_alone() -> None:
    """Position noise is added to the position; the velocity stays the true one; noise of zero is no noise."""
    noise = np.random.default_rng(4).normal(size=(N_STEPS, 2))
    job = job_of(IDEAL, noise)
    for k in range(N_STEPS):
        job.q[:], job.qd[:] = motion(k)
        measure(job, k)
        assert job.measured_q.tobytes() == (motion(k)[0] + noise[k]).tobytes()
        assert job.measured_qd.tobytes() == motion(k)[1].tobytes()


@pytest.mark.parametrize(("asked", "wanted"), [(100.0, 80.0), (-100.0, -80.0), (80.0, 80.0), (-3.5, -3.5), (0.0, 0.0)])
def test_clipping(asked: float, wanted: float) -> None:
    """The first joint's limit is 80 N m; the torque asked stays on record as asked."""
    job = job_of(IDEAL, disturbance=np.full((N_STEPS, 2), 1000.0))
    job.record_tau_law[3] = asked, -asked
    actuate(job, 3)
    small = max(-25.0, min(25.0, -asked))
    assert job.record_tau[3].tolist() == [wanted, small]
    assert job.record_tau_applied[3].tolist() == job.torque[0].tolist() == [wanted + 1000.0, small + 1000.0]
    assert job.record_tau_law[3].tolist() == [asked, -asked]


def integral(function: Any, end: float) -> Array:
    """Return the integral from 0 to `end` of a function of times, (m,) -> (m, n), by Gauss's formula in 40 pieces."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    h = end / 40
    at = (np.arange(40)[:, None] + 0.5 * (nodes + 1.0)) * h
    return np.tile(0.5 * h * weights, 40) @ function(at.ravel())


@pytest.mark.parametrize("time_constant", [0.002, 0.008, 0.05, 1e-5])
def test_the_lag_is_the_exact_exponential(time_constant: float, figure: Any) -> None:
    """The three torques of each physics step, and the mean: u' = (tau - u)/lag from u(0) = 0, tau held over 4 ms.

    u at the start, in the middle and at the end of each step to 1e-12 of the largest torque, hundreds of roundings;
    the recorded mean against the integral of u over the period, to 1e-12 likewise.
    """
    rng = np.random.default_rng(6)
    disturbance = rng.normal(size=(N_STEPS, 2))
    job = job_of(Chain(actuator_lag=time_constant), disturbance=disturbance)
    limits, u, worst, h = np.array([80.0, 25.0]), np.zeros(2), 0.0, 0.001
    for k in range(N_STEPS):
        job.record_tau_law[k] = 60.0 * rng.normal(size=2)
        tau, d = np.clip(job.record_tau_law[k], -limits, limits), disturbance[k]

        def output(t: Array, tau: Array = tau, start: Array = u) -> Array:
            return tau + (start - tau) * np.exp(-np.asarray(t)[..., None] / time_constant)

        actuate(job, k)
        mean = integral(output, T) / T
        worst = max(worst, float(np.max(np.abs(job.record_tau_applied[k] - d - mean))))
        for i in range(4):
            give(job, k, i)
            for row, t in enumerate((i * h, (i + 0.5) * h, (i + 1.0) * h)):
                worst = max(worst, float(np.max(np.abs(job.torque[row] - d - output(t)))))
        u = output(T)
        assert job.record_tau[k].tobytes() == tau.tobytes()
    figure(
        f"torque of a lagging actuator and its mean against the exponential, lag {time_constant:g} s [N m]",
        worst,
        "<= 8e-11",
    )
    assert worst <= 1e-12 * 80.0


def test_the_mean_torque_is_what_moves_a_mass() -> None:
    """On a slide of 2 kg the velocity after each period is the sum of recorded mean torques times T/m.

    Runge-Kutta takes the mean over a step as (u(0) + 4 u(h/2) + u(h))/6, Simpson's rule, whose error for an
    exponential of 8 ms over 1 ms is (h/lag)^4/2880 = 8e-8 of the torque's change.
    """

    def push(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0] = 100.0 * math.cos(40.0 * t)

    run = go(
        AnalyticPlant(slider(2.0)),
        push,
        0.2,
        model=slider(),
        reference=still(np.zeros(1)),
        chain=CHAINS["slow"],
        control_period=T,
    )
    wanted = np.concatenate([[0.0], np.cumsum(run.tau_applied[:-1, 0]) * T / 2.0])
    assert run.qd[:, 0] == pytest.approx(wanted, abs=1e-7 * 100.0 * T)
    assert np.max(np.abs(wanted)) > 0.5
    assert np.max(np.abs(run.tau_applied - run.tau)) > 1.0


@pytest.mark.parametrize("lag_time", [0.002, 0.008])
def test_a_lag_is_seen_from_outside(lag_time: float) -> None:
    """Under a constant torque the output has reached 1 - 1/e of it after one time constant, by momentum on a slide."""

    def push(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0] = 100.0

    run = go(
        AnalyticPlant(slider(2.0), 0.0001),
        push,
        0.05,
        model=slider(),
        reference=still(np.zeros(1)),
        chain=Chain(actuator_lag=lag_time),
    )
    # v(t) = F/m (t - lag (1 - exp(-t/lag)))
    wanted = 50.0 * (run.t - lag_time * -np.expm1(-run.t / lag_time))
    assert run.qd[:, 0] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e4 * (1 + 1e-15), -1e4 * (1 + 1e-15)])
def test_bounds_of_the_state(bad: float) -> None:
    """Any joint, position or velocity: NaN, infinite, or the first number beyond 1e4; 1e4 itself is inside."""
    for joint in range(2):
        for which in range(2):
            state = np.array([[1e4, -1e4], [-1e4, 1e4]])
            assert inside(*state)
            state[which, joint] = bad
            assert not inside(*state)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_chains_without_effect_change_no_byte(plant: str, integrator: str) -> None:
    """Noise and disturbance of zero are no noise and no disturbance, on the signals that both records have."""
    case = Case(plant, variants()[0], "sine", integrator, "ideal", 1)
    plain = case.run(100, "native")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.sim.protocol.signals", lambda n, n_steps: np.zeros((2, n_steps, n)))
        zero = replace(plain)
        for path in ("native", "python"):
            zero = case._replace(condition="ideal, noisy").run(100, path)
            assert zero.digest() == plain.digest()
    assert CONDITIONS["ideal, noisy"].chain is IDEAL
    assert set(REFERENCES) == {"sine", "step", "ramp", "quintic"}


@pytest.mark.parametrize(
    ("name", "sigma", "rate", "time_constant"),
    [
        ("ideal", 0.0, 0.0, 0.0),
        ("fast", 1e-4, 500.0, 0.002),
        ("slow", 1e-4, 200.0, 0.008),
    ],
)
def test_the_named_chains(name: str, sigma: float, rate: float, time_constant: float) -> None:
    """The protocol's three chains; decay over half a step, a step and on average, each against its own formula."""
    chain = CHAINS[name]
    assert (chain.name, chain.encoder_noise, chain.velocity_filter or 0.0, chain.actuator_lag) == (
        name,
        sigma,
        rate,
        time_constant,
    )
    decay = chain.decay(0.001, T)
    if time_constant == 0.0:
        assert decay.shape == (0,)
        assert chain.velocity_gain(T) == 1.0
        return
    half, whole, mean = decay
    assert half * half == pytest.approx(whole, rel=1e-15)
    assert whole == pytest.approx(math.exp(-0.001 / time_constant), rel=1e-15)
    assert mean == pytest.approx(float(integral(lambda t: np.exp(-t / time_constant), T)) / T, rel=1e-14)
    assert chain.velocity_gain(T) == 1.0 - math.exp(-rate * T)
