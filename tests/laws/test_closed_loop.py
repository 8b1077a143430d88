"""Laws in the loop, against what control theory says of them on arms that fit in a line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.arms import MGL, PENDULUM_INERTIA, pack, pendulum, slider, still, two_link, two_link_terms
from torquebench.kernel import Array
from torquebench.references import Reference, ReferenceSource, Sine
from torquebench.robot import RobotModel
from torquebench.sim.friction import Friction
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory


def run(
    arm: RobotModel,
    law: str,
    reference: ReferenceSource,
    duration: float,
    *,
    T: float = 0.001,
    start: Array | None = None,
    belief: RobotModel | None = None,
    options: dict[str, Any] | None = None,
    **gains: Any,
) -> Trajectory:
    """Run a law on the analytic plant; its model is the plant's own unless `belief` is given."""
    return simulate(
        AnalyticPlant(arm, timestep=T),
        pack(law, arm.n, options, **gains),
        belief or arm,
        reference,
        duration=duration,
        control_period=T,
        initial_q=start,
    )


def error(run: Trajectory) -> Array:
    """Return e = q_ref - q."""
    return run.q_ref - run.q


def test_computed_torque_on_a_double_integrator_is_its_exact_recursion() -> None:
    """A mass under held torque obeys x_{k+1} = A x_k; A is formed here and multiplied out 1500 times."""
    T, lam, kv, e0 = 0.002, 5.0, 20.0, 0.4
    run_ = run(slider(), "computed-torque", still(np.array([e0])), 3.0, T=T, lam=lam, kv=kv, ki=0)
    # qdd = kv (lam e - qd) held over T, e = e0 - q, v = qd
    A = np.array([[1.0 - 0.5 * T * T * lam * kv, -(T - 0.5 * T * T * kv)], [T * lam * kv, 1.0 - T * kv]])
    x = np.array([e0, 0.0])
    for e, v in zip(error(run_)[:, 0], run_.qd[:, 0], strict=True):
        # Runge-Kutta is exact for constant acceleration; 1500 roundings of numbers below 2
        assert [e, v] == pytest.approx(x, abs=1e-13)
        x = A @ x
    assert np.all(np.abs(x) < 1e-10)  # it went somewhere: e0 has decayed by 10 half-lives and more


@pytest.mark.parametrize(("lam", "kv"), [(5.0, 20.0), (20.0, 10.0)])
def test_computed_torque_makes_the_error_linear(lam: float, kv: float) -> None:
    """On an arm with a perfect model e'' + kv e' + lam kv e = 0, critically damped and oscillating, up to O(T).

    A torque held over T acts like a delay of T/2: e'' is off by at most T/2 max|e'''|, which the filter
    1/(s^2 + kv s + lam kv) passes with a gain of at most the integral of its |impulse response|. The bound is
    doubled for what the arm's own dynamics change within a period.
    """
    e0 = np.array([0.1, -0.15])
    half, wn = 0.5 * kv, math.sqrt(lam * kv)
    t = np.arange(0.0, 2.0, 1e-4)
    wd = math.sqrt(max(wn * wn - half * half, 0.0))
    decay = np.exp(-half * t)
    sinc = np.sin(wd * t) / wd if wd > 0 else t
    shape = decay * (np.cos(wd * t) + half * sinc)
    third = np.gradient(np.gradient(np.gradient(shape, t), t), t)
    gain = float(np.sum(np.abs(decay * sinc)) * 1e-4)

    def worst(T: float) -> float:
        run_ = run(two_link(), "computed-torque", still(e0), 1.0, T=T, lam=lam, kv=kv, ki=0)
        assert np.array_equal(run_.tau, run_.tau_law)  # clipped torques would not be linear
        exact = e0 * np.interp(run_.t, t, shape)[:, None]
        gap = float(np.max(np.abs(error(run_) - exact)))
        assert gap < 2.0 * gain * 0.5 * T * float(np.max(np.abs(third))) * 0.15
        return gap

    coarse, fine = worst(0.0005), worst(0.00025)
    # nothing but the hold is left: half the period, half the error
    assert fine == pytest.approx(0.5 * coarse, rel=0.05)
    assert coarse > 1e-6


def test_computed_torque_tracks_with_a_perfect_model_from_rest() -> None:
    """On a motion that begins at rest the error is only what the hold leaves: a delay of T/2 in the torque.

    The delay leaves an acceleration of M^-1 T/2 dtau/dt, worked out here along the motion and passed through
    e'' + kv e' + lam kv e, step by step.
    """
    lam, kv, h = 10.0, 20.0, 0.001
    target = Sine(np.array([1.2, -1.0]), np.array([0.5, 0.6]))
    motion = target(np.arange(0.0, 2.0, h))
    terms = [two_link_terms(q, qd) for q, qd in zip(motion.q, motion.qd, strict=True)]
    torque = np.array([M @ qdd + v + g for (M, v, g), qdd in zip(terms, motion.qdd, strict=True)])
    late = 0.5 * np.array(
        [np.linalg.solve(M, rate) for (M, _, _), rate in zip(terms, np.gradient(torque, h, axis=0), strict=True)]
    )
    e, de, expected = np.zeros(2), np.zeros(2), []
    for push in late:
        expected.append(e)
        de = de + h * (push - kv * de - lam * kv * e)
        e = e + h * de
    for T in (0.002, 0.001):
        run_ = run(two_link(), "computed-torque", target, 2.0, T=T, lam=lam, kv=kv, ki=0)
        wanted = T * np.array(expected)[:: round(T / h)]
        # second order in the delay: T/2 times the frequencies in the torque, a few rad/s, and this sum's own h kv / 2
        assert error(run_) == pytest.approx(wanted, abs=0.03 * float(np.max(np.abs(wanted))))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_smc_reaches_its_surface_in_the_time_theory_gives(sign: float) -> None:
    """With a perfect model M ds/dt = -K sgn(s): s falls in a straight line and is zero after |s0| M / K.

    Afterwards e decays as exp(-lambda t), because ds + ... = 0 is a filter of e.
    """
    lam, K, e0, T = 10.0, 0.3 * 40.0, sign * 0.2, 1e-4
    run_ = run(pendulum(), "smc", still(np.array([e0])), 0.6, T=T, lam=lam, k=0.3)
    assert np.all(np.abs(run_.tau_law) <= 40.0)  # else the theory does not apply
    s, t = run_.s[:, 0], run_.t
    reach = abs(lam * e0) * PENDULUM_INERTIA / K
    assert reach == pytest.approx(0.1)
    slope = K / PENDULUM_INERTIA
    before = t < reach - 2 * T
    # the hold delays the equivalent control by T/2, so |s| is off by no more than a few periods' worth of slope
    assert np.max(np.abs(s[before] - sign * (2.0 - slope * t[before]))) < 3.0 * slope * T
    after = t > reach + 2 * T
    assert np.max(np.abs(s[after])) < 2.0 * slope * T
    first = int(np.argmax(after))
    decayed = error(run_)[first, 0] * np.exp(-lam * (t[after] - t[first]))
    # |e - decayed| <= max|s| / lambda
    assert np.max(np.abs(error(run_)[after, 0] - decayed)) < 2.0 * slope * T / lam


def test_smc_without_its_model_still_reaches_when_k_beats_gravity() -> None:
    """K = 20 N m against at most 9.81 of gravity: M ds/dt <= -(K - mgl - M lam |de|) while s > 0."""
    run_ = run(pendulum(), "smc", still(np.array([0.2])), 1.5, lam=3.0, k=0.5, options={"equivalent_control": False})
    # |de| <= 0.6 rad/s while s falls from 0.6, so K - mgl - M lam |de| >= 9.1 N m
    bound = 0.6 * PENDULUM_INERTIA / (20.0 - MGL - PENDULUM_INERTIA * 3.0 * 0.6)
    assert run_.t[np.argmax(run_.s[:, 0] <= 0.0)] <= bound
    assert abs(error(run_)[-1, 0]) < 0.02


def test_pd_droops_by_gravity_over_its_gain() -> None:
    """At rest PD leaves Kp e = g(q): the arm hangs below by g/Kp, to the last digit."""
    run_ = run(pendulum(), "pd", still(np.array([0.4])), 4.0, lam=10, kv=20)
    kp = 10.0 * 20.0 * 0.5
    q = run_.q[-1, 0]
    assert abs(run_.qd[-1, 0]) < 1e-10
    assert error(run_)[-1, 0] == pytest.approx(MGL * math.cos(q) / kp, rel=1e-9)
    assert error(run_)[-1, 0] > 0.08


def test_what_removes_the_droop() -> None:
    """Gravity compensation with a right model, an integral, or a model in the law leave no error at rest."""
    target, common = still(np.array([0.4])), {"lam": 10, "kv": 20}
    runs = {
        "pd-gravity": run(pendulum(), "pd-gravity", target, 4.0, **common),
        "computed-torque": run(pendulum(), "computed-torque", target, 4.0, ki=0, **common),
        # the slowest pole of the pid loop is near KI/Kp = 2/s: exp(-2 * 12) = 4e-11
        "pid": run(pendulum(), "pid", target, 12.0, ki=400, **common),
    }
    for name, run_ in runs.items():
        assert abs(error(run_)[-1, 0]) < 1e-8, name
    assert runs["pid"].extra["integral"][-1, 0] == pytest.approx(MGL * math.cos(0.4) / (400 * 0.5), rel=1e-6)


@pytest.mark.parametrize("arm", [pendulum(), two_link()], ids=["pendulum", "two-link"])
def test_vendor_laws_at_rest(arm: RobotModel) -> None:
    """A servo sags by g(q)/kp, with an integral not at all; impedance and gravity compensation arrive."""
    target = np.array([0.4, -0.6])[: arm.n]
    stiff: dict[str, Any] = {"kp": 200.0, "kd": 40.0}
    impedance = run(arm, "joint-impedance", still(target), 8.0, **stiff)
    compensated = run(arm, "gravity-friction", still(target), 8.0, viscous=1.0, coulomb=0.5, speed=0.1, **stiff)
    sagging = run(arm, "position-servo", still(target), 8.0, ki=0.0, **stiff)
    integral = run(arm, "position-servo", still(target), 12.0, ki=400.0, **stiff)
    # the slowest poles are near Kp/Kd = 5/s, and KI/Kp = 2/s with the integral: exp(-24) = 4e-11 of 0.6 rad
    for run_ in (impedance, compensated, integral):
        assert np.max(np.abs(error(run_)[-1])) < 1e-8
    assert error(sagging)[-1] == pytest.approx(arm.gravity(sagging.q[-1]) / 200.0, rel=1e-6)
    assert np.max(np.abs(error(sagging)[-1])) > 0.02


def test_impedance_lags_a_moving_reference_by_kd_over_kp() -> None:
    """On a ramp of 0.5 rad/s the pendulum is 0.5 Kd/Kp behind where the velocity is damped, and nothing with de."""

    def ramp(t: Array) -> Reference:
        one = np.ones((len(t), 1))
        return Reference(0.5 * t[:, None] * one, 0.5 * one, 0.0 * one)

    for damping, lag in (("velocity", 0.5 * 20.0 / 200.0), ("velocity-error", 0.0)):
        run_ = run(pendulum(), "joint-impedance", ramp, 3.0, options={"damping": damping}, kp=200.0, kd=20.0)
        # the held torque is half a period late for gravity: mgl sin(1.5) 0.5 rad/s 0.5 ms / Kp = 1.2e-5 rad
        assert error(run_)[-1, 0] == pytest.approx(lag, abs=2e-5)


def test_friction_that_is_believed_rightly_leaves_no_lag() -> None:
    """A ramp with the very friction that the law feeds forward is followed; without the feed-forward it lags."""
    plant = AnalyticPlant(pendulum(), friction=Friction(viscous=4.0, coulomb=3.0))

    def ramp(t: Array) -> Reference:
        one = np.ones((len(t), 1))
        return Reference(0.5 * t[:, None] * one, 0.5 * one, 0.0 * one)

    def lag(viscous: float, coulomb: float) -> float:
        gains = {"kp": 200.0, "kd": 20.0, "viscous": viscous, "coulomb": coulomb, "speed": 0.1}
        run_ = simulate(plant, pack("gravity-friction", 1, None, **gains), pendulum(), ramp, duration=3.0)
        return float(error(run_)[-1, 0])

    # gravity's torque is held half a period too long: mgl sin(1.5) 0.5 rad/s 0.5 ms / Kp = 1.2e-5 rad
    assert lag(4.0, 3.0) == pytest.approx(0.0, abs=2e-5)
    assert lag(0.0, 0.0) == pytest.approx((4.0 * 0.5 + 3.0) / 200.0, abs=2e-5)


def test_wrong_gravity_leaves_its_part_of_the_droop() -> None:
    """A model with 1.3 times the gravity lifts the arm too far: Kp e = -0.3 g(q); the integral takes that away."""
    wrong, target = pendulum(gravity=1.3 * 9.81), still(np.array([0.4]))
    run_ = run(pendulum(), "pd-gravity", target, 4.0, belief=wrong, lam=10, kv=20)
    assert error(run_)[-1, 0] == pytest.approx(-0.3 * MGL * math.cos(run_.q[-1, 0]) / 100.0, rel=1e-9)
    with_integral = run(pendulum(), "computed-torque", target, 12.0, belief=wrong, lam=10, kv=20, ki=400)
    assert abs(error(with_integral)[-1, 0]) < 1e-8


@pytest.mark.parametrize(
    ("law", "options", "slope"),
    [
        ("smc", {"switching": "saturation"}, 12.0 / 0.3),
        ("linear-band-smc", {}, 12.0 / 0.3 + 20.0 * 0.5),
    ],
)
def test_droop_in_the_band(law: str, options: dict[str, Any], slope: float) -> None:
    """Inside the band and without a model, (K/phi [+ Kd]) lambda e = g(q) at rest: the price of the band."""
    more = {"kv": 20} if law == "linear-band-smc" else {}
    run_ = run(
        pendulum(),
        law,
        still(np.array([0.4])),
        4.0,
        lam=10,
        k=0.3,
        phi=0.3,
        options={"equivalent_control": False, **options},
        **more,
    )
    assert abs(run_.s[-1, 0]) < 0.3
    assert error(run_)[-1, 0] == pytest.approx(MGL * math.cos(run_.q[-1, 0]) / (slope * 10.0), rel=1e-9)


def test_the_band_stops_the_chattering() -> None:
    """Sgn flips the torque by 2K every few periods once on the surface; the band never moves it that fast."""
    target, T = Sine(np.array([1.0]), np.array([0.5])), 0.001
    sharp = run(pendulum(), "smc", target, 2.0, T=T, lam=10, k=0.3)
    banded = run(pendulum(), "linear-band-smc", target, 2.0, T=T, lam=10, k=0.3, phi=0.3, kv=20)
    jump_sharp, jump_banded = (np.abs(np.diff(r.tau[1000:, 0])) for r in (sharp, banded))
    assert np.max(jump_sharp) > 1.9 * 12.0
    assert np.mean(jump_sharp > 12.0) > 0.3
    # with s at rest in the band only the motion itself moves the torque: |d tau/dt| < 40 N m/s
    assert np.max(jump_banded) < 40.0 * T


def test_anti_windup_holds_the_integral_while_saturated() -> None:
    """On a step far beyond the torque limit the integral stands still at every instant that saturates forwards."""
    run_ = run(pendulum(gravity=0.0, tau_max=5.0), "pid", still(np.array([2.0])), 2.0, lam=10, kv=20, ki=50)
    integral, e = run_.extra["integral"][:, 0], error(run_)[:, 0]
    before = np.concatenate([[0.0], integral[:-1]])
    waits = (np.abs(run_.tau_law[:, 0]) > 5.0) & (run_.tau_law[:, 0] * e > 0.0)
    assert np.count_nonzero(waits) > 100
    assert np.array_equal(integral[waits], before[waits])
    # differences of a running sum below 1 are good to 1e-16
    assert integral[~waits] - before[~waits] == pytest.approx(0.001 * e[~waits], abs=1e-15)
