"""Sliding modes since 1990: their equations at points, and in the loop what each promises, on two arms."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.arms import pack, pendulum, still, two_link, two_link_terms
from tests.laws.forms import acting, forms
from tests.laws.sliding_equations import EQUATIONS, Joints, State
from torquebench.chain import Chain
from torquebench.disturbances import Bias
from torquebench.laws import find_law
from torquebench.references import Reference, ReferenceSource, Sine
from torquebench.robot import RobotModel, load_model
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

TWIST, GAIN, INTEGRAL, TERMINAL, FIXED, FUNNEL, PI = EQUATIONS
T = 0.002
"""Control period of single calls [s]; not the default, so that a law that ignores it is found."""
GAINS: dict[str, dict[str, list[float]]] = {
    TWIST: {"most": [12.0, 6.0], "least": [3.0, 1.0], "omega": [300.0, 90.0], "eps": [2.0, 3.0], "mu": [0.3, 0.9]},
    GAIN: {"gamma": [20.0, 9.0], "phi": [0.3, 0.9], "least": [0.05, 0.1]},
    INTEGRAL: {"kr": [0.3, 0.2], "phi": [0.6, 1.5]},
    TERMINAL: {"knee": [0.05, 0.2], "fast": [0.5, 2.0], "kv": [20.0, 7.0]},
    FIXED: {"knee": [0.05, 1.0], "kv": [20.0, 7.0]},
    FUNNEL: {"kv": [20.0, 7.0], "rho": [0.1, 0.2], "rho_end": [0.04, 0.1], "shrink": [20.0, 9.0], "rho_s": [3.0, 8.0]},
    PI: {"kv": [20.0, 7.0], "kis": [300.0, 90.0]},
}
"""Gains that differ between the joints; `lam` is 10 and 4 in all."""
TAU_MAX, MBAR = np.array([25.0, 5.0]), np.array([2.5, 0.4])
"""Limits so low that they are met often."""


@pytest.mark.parametrize("law", EQUATIONS)
def test_torque_and_memory_are_the_equations(law: str) -> None:
    """Over 60 instants that wander through layers, funnels and limits, in each form, every signal is the equation's.

    The derivative of the fixed-time surface is a difference in the equation, good to nine digits of a term of the sum.
    """
    k = np.arange(60)[:, None]
    q, qd = 0.4 + 0.3 * np.sin(0.11 * k + np.array([0.0, 1.0])), 0.5 * np.cos(0.07 * k + np.array([0.3, 0.0]))
    e = np.array([0.05, -0.3]) * np.cos(0.09 * k + np.array([0.0, 0.4]))
    de, qdd_ref = np.array([0.8, 2.4]) * np.sin(0.13 * k + np.array([0.5, 0.1])), 1.5 * np.sin(0.2 * k + np.zeros(2))
    belief, waited = replace(two_link().flat, control_period=T, tau_max=TAU_MAX), 0
    for options in forms(law):
        given = {name: np.array(GAINS[law].get(name, [10.0, 4.0])) for name in acting(law, options)}
        controller, state = pack(law, 2, options, **given), State()
        memory, blind = controller.law.new_memory(2), options.get("equivalent_control") is False
        for i in range(60):
            M, velocity, gravity = two_link_terms(q[i], qd[i])
            measured = (qd[i] - (qd[i - 1] if i else 0.0)) / T
            literal = options.get("equivalent_control") == "measured-acceleration"
            joints = Joints(TAU_MAX, MBAR, T, M, M @ (qdd_ref[i] - literal * measured) + velocity + gravity, blind)
            wanted, state = EQUATIONS[law](given, joints, e[i], de[i], state)
            tau = np.full(2, 99.0)
            ref = Reference(q[i] + e[i], qd[i] + de[i], qdd_ref[i])
            controller.law.function(controller.gains, belief, 0.7, q[i].copy(), qd[i].copy(), ref, memory, tau)
            assert tau == pytest.approx(wanted, rel=1e-8 if law == FIXED else 1e-11, abs=1e-9), (options, i)
            for name, value in state.items():
                assert getattr(memory, name) == pytest.approx(value, rel=1e-10, abs=1e-12), (options, i, name)
            waited += int(np.sum(joints.waits(tau, e[i] if law == INTEGRAL else state["s"])))
    assert waited > 10  # limits were met


def one(law: str, e: float, de: float, options: dict[str, Any] | None = None, **gains: float) -> float:
    """Return the torque of a first call on the pendulum without gravity, 0.6 kg m^2, Mbar 0.5, at rest at zero."""
    controller = pack(law, 1, options, **gains)
    tau, zero = np.zeros(1), np.zeros(1)
    ref = Reference(np.array([e]), np.array([de]), zero)
    memory = controller.law.new_memory(1)
    controller.law.function(controller.gains, pendulum(gravity=0.0).flat, 0.0, zero, zero, ref, memory, tau)
    return float(tau[0])


def test_torques_by_hand() -> None:
    """Powers of 4 and 9, so that every root is a whole number; the pendulum's limit is 40 N m."""
    blind = {"equivalent_control": False}
    # s = 0.05 + 10 x 0.02 = 0.25: 0.5 (3 x 0.5); 0.06 x 40; 0.5 x 20 x 0.25
    twist = {"most": 9.0, "least": 3.0, "omega": 5.0, "eps": 1.0, "mu": 0.1}
    assert one(TWIST, 0.02, 0.05, blind, lam=10, **twist) == pytest.approx(0.75)
    assert one(GAIN, 0.02, -0.45, blind, lam=10, gamma=9, phi=0.3, least=0.06) == pytest.approx(-2.4)
    assert one(PI, 0.02, 0.05, blind, lam=10, kv=20, kis=7) == pytest.approx(2.5)
    # the first instant is on the surface: 0.6 (10 x 0.05 + 25 x 0.02) and nothing else
    assert one(INTEGRAL, 0.02, 0.05, lam=10, kr=0.3) == pytest.approx(0.6)
    # S = 0.02: |e|/E = 4, |de|/S = 9; s = 2 x 0.04 (1 + 0.5 x 4) + 0.18 x 3 = 0.78, s/S = 39
    reach = 5.0 * (0.78 + 0.02 * math.sqrt(39.0))
    wanted = 0.6 * (2.0 / 3.0 * 2.0 * 0.02 * 5.0 * 3.0 + reach)
    assert one(TERMINAL, 0.04, 0.18, lam=2, knee=0.01, fast=0.5, kv=5) == pytest.approx(wanted)
    # s = -0.08 + 0.02 (2 + 8) = 0.12, s/S = 6; f'(4) = 1/4 + 3
    wanted = 0.6 * (2.0 * 3.25 * -0.08 + 5.0 * 0.02 * (math.sqrt(6.0) + 6.0 * math.sqrt(6.0)))
    assert one(FIXED, 0.04, -0.08, lam=2, knee=0.01, kv=5) == pytest.approx(wanted)
    # |e|/E = 0.05, half of the core: (3 x 0.5 - 0.25)/2 sqrt(0.1) for the root; s/S likewise a number above it
    s = 0.02 * (0.625 * math.sqrt(0.1) + 0.05**1.5)
    y = s / 0.02
    wanted = 0.6 * 5.0 * 0.02 * (math.sqrt(y) + y**1.5)
    assert one(FIXED, 0.0005, 0.0, lam=2, knee=0.01, kv=5) == pytest.approx(wanted)
    # e = rho/2: artanh(1/2) = ln(3)/2; s = 1 x 0.1 x ln(3)/2 is a tenth of rho_s, which begins at 10 s
    s = 0.05 * math.log(3.0)
    funnels = {"rho": 0.1, "rho_end": 0.01, "shrink": 1.0, "rho_s": 10.0 * s}
    wanted = 0.5 * 20.0 * 10.0 * s * 0.5 * math.log(1.1 / 0.9)
    assert one(FUNNEL, 0.05, 0.0, blind, lam=1, kv=20, **funnels) == pytest.approx(wanted)
    # a funnel of s that is narrower than s at the start begins at 1.5 of it: artanh(2/3) = ln(5)/2
    wanted = 0.5 * 20.0 * 1.5 * s * 0.5 * math.log(5.0)
    assert one(FUNNEL, 0.05, 0.0, blind, lam=1, kv=20, **(funnels | {"rho_s": s})) == pytest.approx(wanted)


ARMS = ("puma560", "two-link")
MOTIONS: dict[str, ReferenceSource] = {
    "puma560": Sine((1.2, -1.0, 1.0, 1.0, 1.0, 1.0), (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)),
    "two-link": Sine((1.0, -0.8), (0.5, 0.7)),
}


@cache
def arm_of(name: str, strong: float = 1.0) -> RobotModel:
    """Return an arm, or one whose torque limits are that many times as high."""
    arm = load_model(name)
    return RobotModel(name, arm.joint_names, replace(arm.flat, tau_max=strong * arm.flat.tau_max))


def run(
    arm: RobotModel,
    law: str,
    target: ReferenceSource,
    duration: float,
    gains: dict[str, Any] | None = None,
    options: dict[str, Any] | None = None,
    push: Any = None,
    **more: Any,
) -> Trajectory:
    """Run a law with the gains that suit the arm, but for those given, on the analytic plant."""
    chosen = find_law(law).choose_gains(arm, chain=more.get("chain", Chain()), options=options, given=gains)
    controller = pack(law, arm.n, options, **chosen)
    disturbances = () if push is None else (Bias(push),)
    plant = AnalyticPlant(arm, more.get("control_period", 0.001))
    return simulate(plant, controller, arm, target, duration=duration, disturbances=disturbances, **more)


def rmse(found: Trajectory, first: int = 1000) -> float:
    """Return the root mean square of all joints' errors from 1 s on [rad]."""
    return float(np.sqrt(np.mean(np.square((found.q_ref - found.q)[first:]))))


def roughness(found: Trajectory, arm: RobotModel) -> float:
    """Return the mean change of the torque in a control period, over the limits, from 1 s on [1]."""
    return float(np.mean(np.abs(np.diff(found.tau[1000:], axis=0)) / arm.flat.tau_max))


@cache
def roughness_of_smc(name: str) -> float:
    """Return the roughness of sgn(s) on an arm."""
    return roughness(run(arm_of(name), "smc", MOTIONS[name], 2.5), arm_of(name))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("law", EQUATIONS)
def test_each_follows_with_the_gains_that_are_chosen(law: str, name: str) -> None:
    """With a right model all follow to 0.1 mrad but the integral one, which has sgn(s) and shakes.

    Its sgn turns over by 2 K at nearly each instant.
    """
    arm = arm_of(name)
    found = run(arm, law, MOTIONS[name], 2.5)
    assert rmse(found) < (5e-4 if law == INTEGRAL else 1e-4)
    assert roughness(found, arm) < (1.1 if law == INTEGRAL else 0.05) * roughness_of_smc(name)


@pytest.mark.parametrize("name", ARMS)
def test_adaptive_gains_go_where_they_are_needed(name: str) -> None:
    """Nothing pushes: the gains are down. A push of 10 % of the limits: K is above that, and less than twice it.

    Sgn(s) has a mean of -d/K, so that no smaller K holds the push. Twisting grows while it is pushed anew.
    """
    arm = arm_of(name)
    calm = run(arm, TWIST, MOTIONS[name], 2.5)
    least = np.asarray(find_law(TWIST).choose_gains(arm)["least"])
    assert np.mean(calm.extra["k1"][1000:] <= 1.5 * least) > 0.9
    assert np.mean(run(arm, GAIN, MOTIONS[name], 2.5).extra["gain"][1000:]) < 0.05
    pushed = run(arm, GAIN, MOTIONS[name], 2.5, push=tuple((0.1 * arm.flat.tau_max).tolist()))
    K = np.mean(pushed.extra["gain"][1000:], axis=0)
    assert np.all(K > 0.1)
    assert np.all(K < 0.2)


@pytest.mark.parametrize("name", ARMS)
def test_the_integral_surface_has_no_reaching_phase(name: str) -> None:
    """From a start 0.1 rad off and under a push e is e0 (1 + lam t/2) exp(-lam t/2), nominal, from the first instant.

    |s| stays within what K and the push move it by in three periods, and the error within |s| through the filter of
    gain 1/lam of it, 4/lam^2 lam at most. The conventional law's s begins at lam e0.
    """
    arm = arm_of(name)
    e0, push = np.full(arm.n, 0.1), 0.05 * arm.flat.tau_max
    found = run(arm, INTEGRAL, still(e0), 1.0, {"lam": 8.0, "kr": 0.15}, push=tuple(push.tolist()), path="native")
    assert np.array_equal(found.tau, found.tau_law)  # no limit was met
    mobility = np.abs(np.linalg.inv(arm.mass_matrix(found.q)))
    moved = np.max(np.sum(mobility * (0.2 * arm.flat.tau_max), axis=2), axis=0) * 0.001
    assert np.all(np.max(np.abs(found.s), axis=0) < 3.0 * moved)
    t = found.t[:, None]
    nominal = e0 * (1.0 + 4.0 * t) * np.exp(-4.0 * t)
    assert np.all(np.max(np.abs(found.q_ref - found.q - nominal), axis=0) < 3.0 * moved / 8.0)
    assert np.min(np.abs(run(arm, "smc", still(e0), 0.1, {"lam": 8.0, "k": 0.15}).s[0])) == pytest.approx(0.8)


def first(below: np.ndarray) -> int:
    """Return the first instant from which a condition holds to the end."""
    return int(len(below) - np.argmin(below[::-1])) if not np.all(below) else 0


@pytest.mark.parametrize("fast", [0.0, 1.0])
@pytest.mark.parametrize("name", ARMS)
def test_the_terminal_surface_ends_in_finite_time(name: str, fast: float) -> None:
    """From where s is below a percent of S for good, x = |e|/E goes as dx/dt = -lam (x + fast x^2)^(2/3), to nothing.

    To x = 1e-3 that takes less than 3 x^(1/3) / lam, with fast = 0 all but a tenth of E^(1/3) of it. A percent of S
    that is left of s is 2 % of the time at x = 0.05, less before.
    """
    arm, lam, E = arm_of(name, 10.0), 5.0, 0.05
    found = run(arm, TERMINAL, still(np.full(arm.n, 0.1)), 3.0, {"lam": lam, "knee": E, "fast": fast, "kv": 60.0})
    e = found.q_ref - found.q
    for i in range(arm.n):
        on, gone = first(np.abs(found.s[:, i]) < 0.01 * lam * E), first(np.abs(e[:, i]) < 1e-3 * E)
        y = np.linspace(0.1, (abs(e[on, i]) / E) ** (1.0 / 3.0), 1000)  # x = y^3
        time = float(np.trapezoid(3.0 / (1.0 + fast * y * y * y) ** (2.0 / 3.0), y)) / lam
        assert found.t[gone] - found.t[on] == pytest.approx(time, rel=0.02)
        assert found.t[gone] - found.t[on] < 3.0 * y[-1] / lam


@pytest.mark.parametrize("name", ARMS)
def test_the_time_of_the_fixed_time_law_has_a_bound_for_all_starts(name: str) -> None:
    """From 0.1 to 3 rad away, |s| < S/10 within pi/kV and then |e| < E/10 within pi/lam; a slope takes ever longer.

    A linear law of the same slope takes ln(10 e0/E)/lam, twice pi/lam at 3 rad, and as much longer for each factor.
    """
    arm, gains = arm_of(name, 1e4), {"lam": 4.0, "knee": 0.05, "kv": 16.0}
    times = []
    for e0 in (0.1, 0.3, 1.0, 3.0):
        found = run(arm, FIXED, still(np.full(arm.n, e0)), 1.5, gains, control_period=0.0005)
        reach = max(first(np.abs(s) < 0.1 * 0.2) for s in found.s.T)
        settle = max(first(np.abs(e) < 0.1 * 0.05) for e in (found.q_ref - found.q).T)
        times.append(found.t[settle])
        assert found.t[reach] < math.pi / 16.0
        assert found.t[settle] < math.pi / 16.0 + math.pi / 4.0
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] - times[-2] < 0.5 * (times[1] - times[0])


@pytest.mark.parametrize("name", ARMS)
def test_the_error_stays_in_its_funnel_until_a_delay_breaks_it(name: str) -> None:
    """Blind, pushed and from 50 mrad off: |e| < rho(t) and |s| < rho_s(t) at each instant, down to 20 mrad.

    Its gains answer in 1/kV, 12 to 18 ms: a delay of 5 ms leaves it inside, one of 20 ms drives it out.
    """
    arm = arm_of(name)
    target = still(np.full(arm.n, 0.05))
    blind, push = {"equivalent_control": False}, tuple((0.05 * arm.flat.tau_max).tolist())
    gains = find_law(FUNNEL).choose_gains(arm, options=blind)  # those for no delay

    def widest(delay: float) -> tuple[float, float]:
        chain = Chain(measurement_delay=delay)
        found = run(arm, FUNNEL, target, 2.0, gains, blind, push, chain=chain)
        e = found.q_ref - found.q
        return float(np.max(np.abs(e) / found.extra["rho"])), float(np.max(np.abs(found.s) / found.extra["rho_s"]))

    assert max(widest(0.0)) < 1.0
    assert max(widest(0.005)) < 1.0
    assert widest(0.02)[0] > 1.0


@pytest.mark.parametrize("name", ARMS)
def test_the_integral_of_s_carries_a_constant_push(name: str) -> None:
    """At rest Mbar kis int s is the push, and no error is left; without the integral d/(Kd lam) is, to a percent."""
    arm = arm_of(name)
    push, target = 0.05 * arm.flat.tau_max, still(np.full(arm.n, 0.1))
    gains = {"lam": 10.0, "kv": 30.0}
    found = run(arm, PI, target, 6.0, gains | {"kis": 150.0}, push=tuple(push.tolist()))
    assert np.max(np.abs((found.q_ref - found.q)[-1])) < 1e-6
    carried = 150.0 * arm.flat.inertia_scale * found.extra["s_integral"][-1]
    assert carried == pytest.approx(-push, rel=1e-3)
    left = run(arm, PI, target, 6.0, gains | {"kis": 0.0}, push=tuple(push.tolist()))
    e = (left.q_ref - left.q)[-1]
    assert e == pytest.approx(-push / (300.0 * arm.flat.inertia_scale), rel=0.01)
