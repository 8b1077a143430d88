"""Surfaces, and what gravity does to the laws at rest, on the PUMA and the two-joint arm in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.arms import PENDULUM_INERTIA, pack, pendulum, still
from tests.fuzzy.independent import exact_output
from torquebench import AnalyticPlant, MujocoPlant, simulate
from torquebench.kernel import Array
from torquebench.references import ReferenceSource, Step
from torquebench.robot import Puma560, RobotModel, load_model
from torquebench.sim.trajectory import Trajectory

ARMS = ("puma560", "two-link")
T = 0.001
SET_M = {"lam": 20.0, "k": 0.3, "phi": 1.0, "kv": 60.0, "kf": 0.3, "gd": 4.0, "ki": 15000.0}
"""The recommended gains of the proposed law."""
STEP = np.array([0.3, -0.24, 0.24, 0.18, 0.18, 0.18])
"""Steps that no law needs its torque limits for [rad]."""


@cache
def plant_of(arm: str) -> MujocoPlant:
    """Return the arm in MuJoCo."""
    return MujocoPlant(arm, T, "rk4")


def belief_of(arm: str) -> RobotModel:
    """Return what the laws believe: of the PUMA the paper's equations, corrected."""
    return Puma560("corrected", "printed") if arm == "puma560" else load_model(arm)


def jump(n: int) -> ReferenceSource:
    """Return a step of the first n joints at 0.2 s."""
    return Step(STEP[:n], 0.2)


def home(n: int) -> ReferenceSource:
    """Return a reference that stays at zero, where gravity pulls and nothing else moves."""
    reference: ReferenceSource = still(np.zeros(n))
    return reference


def run(
    arm: str,
    law: str,
    reference: Callable[[int], ReferenceSource],
    options: dict[str, Any],
    duration: float = 4.0,
    **gains: float,
) -> Trajectory:
    """Run a law on an arm in MuJoCo on the ideal chain; the run must complete."""
    n = plant_of(arm).n
    found = simulate(
        plant_of(arm),
        pack(law, n, options, **gains),
        belief_of(arm),
        reference(n),
        duration=duration,
        control_period=T,
    )
    assert found.completed
    return found


@pytest.mark.parametrize("arm", ARMS)
def test_the_surface_pid_settles_where_pi_swings_further_out(arm: str) -> None:
    """Without a model, K sgn(lambda e + (lambda/2)^2 int e) knows no rate, and brakes too late for its own speed.

    K alone pushes: braking from e = 0 on would already bring a joint as far beyond its target as it started before it,
    100 %; s changes sign later still. With the rate in s the same gains reach the surface and slide on it.
    """
    n = plant_of(arm).n
    form = {"equivalent_control": False, "switching": "sign"}
    size = np.abs(STEP[:n])
    found = {name: run(arm, "smc", jump, {**form, "surface": name}, lam=10.0, k=0.6) for name in ("pi", "pid")}
    errors = {name: (each_run.q_ref - each_run.q)[200:] / np.sign(STEP[:n]) for name, each_run in found.items()}
    beyond = {name: -np.min(e, axis=0) / size for name, e in errors.items()}
    assert np.all(beyond["pi"] > 1.0)
    assert np.all(np.max(np.abs(errors["pi"][-1000:]), axis=0) > size)
    assert np.all(beyond["pid"] < 0.5)
    assert np.all(np.max(np.abs(errors["pid"][-1000:]), axis=0) < 0.02 * size)


@pytest.mark.parametrize("surface", ["pd", "pid"])
def test_the_error_on_its_surface_decays_as_the_surface_says(surface: str) -> None:
    """Sliding on s = 0: e = exp(-lambda t) on pd; on pid (1 + c t) exp(-lambda t/2), a double pole at lambda/2, (86).

    On a pendulum in a wide band, from the instant at which s is reached; s is held to 1e-3 rad/s there.
    """
    lam, arm = 10.0, pendulum()
    found = simulate(
        AnalyticPlant(arm, timestep=T),
        pack("smc", 1, {"surface": surface, "switching": "saturation"}, lam=lam, k=0.9, phi=0.05),
        arm,
        still(np.array([0.05])),
        duration=2.0,
        control_period=T,
    )
    e, de = (found.q_ref - found.q)[:, 0], -found.qd[:, 0]
    start = int(np.argmax(np.abs(found.s[:, 0]) < 1e-3)) + 20
    t = found.t[start:] - found.t[start]
    if surface == "pd":
        wanted = e[start] * np.exp(-lam * t)
    else:
        half = lam / 2.0
        wanted = (e[start] + (de[start] + half * e[start]) * t) * np.exp(-half * t)
    assert np.max(np.abs(found.s[start:, 0])) < 1e-3
    # a disturbance of s passes to e with a gain of 1/lambda at most, on pid of 4/(lambda^2) times its rate
    assert e[start:] == pytest.approx(wanted, abs=1e-3 / lam * 2.0)
    assert abs(e[start]) > 0.01


@pytest.mark.parametrize("arm", ARMS)
def test_without_its_integral_the_proposed_law_droops(arm: str) -> None:
    """The fuzzy output is 0 at zero error, so at rest an error must carry gravity; with the integral none is left.

    (K/phi + Kd) lambda e + KF FIS(lambda e/gd, 0) = g(q), from the model of the arm and the second inference.
    """
    n, options = plant_of(arm).n, {"equivalent_control": False}
    without = run(
        arm,
        "fuzzy-linear-band-smc",
        home,
        {**options, "integral": False},
        6.0,
        **{name: value for name, value in SET_M.items() if name != "ki"},
    )
    e = (without.q_ref - without.q)[-1]
    truth = load_model(arm)
    tau_max, mbar = plant_of(arm).tau_max, belief_of(arm).flat.inertia_scale
    rules = np.array([exact_output(x, 0.0) for x in 20.0 * e / 4.0])
    carried = (0.3 * tau_max / 1.0 + 60.0 * mbar) * 20.0 * e + 0.3 * tau_max * rules
    gravity = truth.gravity(without.q[-1])
    assert carried == pytest.approx(gravity, rel=1e-3, abs=1e-3 * float(np.max(np.abs(gravity))))
    shoulder = 1 if arm == "puma560" else 0
    assert abs(e[shoulder]) > 1e-3
    with_it = run(arm, "fuzzy-linear-band-smc", home, options, 6.0, **SET_M)
    assert np.max(np.abs((with_it.q_ref - with_it.q)[-1])) < 1e-9
    assert np.max(np.abs(without.qd[-1])) < 1e-9
    assert n == len(e)


@pytest.mark.parametrize("arm", ARMS)
def test_fuzzy_pd_droops_by_gravity_over_its_slope_and_fuzzy_pid_does_not(arm: str) -> None:
    """At rest KF FIS(e/ge, 0) = g: about g ge/(1.264 KF) with the slope at the origin, which falls off to below 0.9.

    FIS(x, 0) is exact from the second inference. The integral of fuzzy-pid leaves nothing of it.
    """
    kf, ge, gd = 0.8, 0.2, 1.0
    found = run(arm, "fuzzy-pd", home, {}, 8.0, kf=kf, ge=ge, gd=gd)
    e = (found.q_ref - found.q)[-1]
    gravity = load_model(arm).gravity(found.q[-1])
    tau_max = plant_of(arm).tau_max
    rules = np.array([exact_output(x, 0.0) for x in e / ge])
    assert np.max(np.abs(found.qd[-1])) < 1e-9
    assert kf * tau_max * rules == pytest.approx(gravity, rel=1e-3, abs=1e-3 * float(np.max(np.abs(gravity))))
    heavy = np.abs(gravity) > 1.0
    linear = (gravity * ge / (1.264 * kf * tau_max))[heavy]
    assert np.any(heavy)
    assert np.all(e[heavy] / linear > 1.0)
    assert np.all(e[heavy] / linear < 1.264 / 0.9)
    pid = run(arm, "fuzzy-pid", home, {}, 12.0, kf=1.0, ge=ge, gd=gd, gi=0.1)
    assert np.max(np.abs((pid.q_ref - pid.q)[-1])) < 1e-4
    # at rest the integral alone carries gravity: KF/2 FIS(0, int e/gi) = g
    carried = 0.5 * tau_max * np.array([exact_output(0.0, x) for x in pid.extra["integral"][-1] / 0.1])
    gravity = load_model(arm).gravity(pid.q[-1])
    assert carried == pytest.approx(gravity, rel=0.01, abs=0.01 * float(np.max(np.abs(gravity))))


def swings(gi: float, law: str = "fuzzy-pi") -> Array:
    """Return the size of each extreme of the error on a pendulum without gravity or friction, from e = 0.05 rad."""
    arm, h = pendulum(gravity=0.0), 2.5e-4
    more = {"gd": 1.0} if law == "fuzzy-pd" else {"gi": gi}
    found = simulate(
        AnalyticPlant(arm, timestep=h),
        pack(law, 1, kf=0.5, ge=0.2, **more),
        arm,
        still(np.array([0.05])),
        duration=3.0,
        control_period=h,
    )
    e = (found.q_ref - found.q)[:, 0]
    turns = np.flatnonzero((e[1:-1] - e[:-2]) * (e[2:] - e[1:-1]) < 0.0) + 1
    return np.abs(np.concatenate([[e[0]], e[turns]]))


def test_fuzzy_pi_oscillates_undamped() -> None:
    """Nothing in it damps: without an integral to speak of it is a spring, whose swings all reach as far as the first.

    A torque held over T acts T/2 late: a swing of half a period pi/w grows by pi w T/4 of itself, with w^2 below the
    spring's 1.3 KF/(ge M) = 220. The integral pushes in the direction of motion and makes each swing larger.
    """
    spring = swings(gi=1e6)
    assert len(spring) > 8
    growth = spring[1:] / spring[:-1]
    w = (1.3 * 0.5 * 40.0 / (0.2 * PENDULUM_INERTIA)) ** 0.5
    assert np.all(growth > 0.999)
    assert np.all(growth < 1.0 + 2.0 * np.pi * w * 2.5e-4 / 4.0)
    integral = swings(gi=0.1)
    assert np.all(integral[1:6] > 1.02 * integral[:5])
    damped = swings(0.1, "fuzzy-pd")
    assert len(damped) < 2 or damped[1] < 0.5 * damped[0]


@pytest.mark.parametrize("arm", ARMS)
def test_fuzzy_pi_does_not_come_to_rest_under_gravity(arm: str) -> None:
    """On both arms the joints that gravity pulls at swing by more than the error scale to the end; see above why."""
    found = run(arm, "fuzzy-pi", home, {}, 8.0, kf=0.8, ge=0.2, gi=0.2)
    worst = np.max(np.abs((found.q_ref - found.q)[-2000:]), axis=0)
    heavy = np.abs(load_model(arm).gravity(np.zeros(plant_of(arm).n))) > 1.0
    assert np.all(worst[heavy] > 0.2)
