"""Gains that differ between joints: each law's equation with vectors, so that no joint may use another's gain."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.arms import pack, two_link, two_link_terms
from tests.laws.core_equations import EQUATIONS, Answer, State
from tests.laws.forms import Options, acting, filled, forms, shipped
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference

T = 0.002
"""Control period [s]; not the default, so that a law that ignores it is found."""
EXACT = 1e-12
"""Relative tolerance: a few dozen roundings of 1e-16, of terms up to a hundred times their sum."""
Q, QD = np.array([0.4, -0.9]), np.array([0.7, -0.2])
E, DE = np.array([0.05, -0.3]), np.array([-0.3, 2.0])
REF = Reference(Q + E, QD + DE, np.array([-1.1, 2.3]))
INTEGRAL = np.array([0.005, -0.03])
"""State of the integral [rad s]."""
LAST_QD = np.array([0.701, -0.203])
"""Velocity at the instant before: accelerations of -0.5 and 1.5 rad/s^2."""
GAINS = {
    "lam": np.array([10.0, 4.0]),
    "kv": np.array([20.0, 7.0]),
    "ki": np.array([50.0, 90.0]),
    "k": np.array([0.3, 0.55]),
    "phi": np.array([0.8, 1.5]),
    "kf": np.array([0.2, 0.35]),
    "gd": np.array([2.0, 5.0]),
    "ge": np.array([0.2, 0.5]),
    "gi": np.array([0.03, 0.05]),
    "k1": np.array([4.0, 9.0]),
    "k2": np.array([30.0, 70.0]),
    "kp": np.array([300.0, 80.0]),
    "kd": np.array([30.0, 9.0]),
    "viscous": np.array([5.0, 0.8]),
    "coulomb": np.array([7.0, 1.5]),
    "speed": np.array([0.9, 4.0]),
}
"""s = de + lam e is 0.2 and 0.8, inside its joint's band; with the other joint's slope it is -0.1 and -1.0. On the
other surfaces s is 0.625 and -1.32 (pi), 0.325 and 0.68 (pid)."""
TAU_MAX, MBAR = np.array([80.0, 25.0]), np.array([2.5, 0.4])
M, VELOCITY, GRAVITY = two_link_terms(Q, QD)
CORE = list(EQUATIONS)


def state(integral: Array = INTEGRAL) -> State:
    """Return the state above, for the equations."""
    return State(E, DE, REF.qdd, QD, M, VELOCITY, GRAVITY, TAU_MAX, MBAR, T, integral, LAST_QD)


def call(law: str, options: Options, gains: dict[str, Array], integral: Array = INTEGRAL) -> tuple[Array, Any]:
    """Return the torque of one call at the state above, and the memory after it."""
    controller = pack(law, 2, options, **{name: gains[name] for name in acting(law, options)})
    memory = filled(law, 2, {"integral": integral, "velocity": LAST_QD})
    tau = np.full(2, 99.0)
    belief = replace(two_link().flat, control_period=T)
    controller.law.function(controller.gains, belief, 0.7, Q.copy(), QD.copy(), REF, memory, tau)
    return tau, memory


def test_every_law_that_ships_has_an_equation() -> None:
    """Each registered law is written out a second time in one of the modules of equations."""
    written: set[str] = set()
    for path in Path(__file__).parent.glob("*_equations.py"):
        written |= importlib.import_module(f"tests.laws.{path.stem}").EQUATIONS.keys()
    assert written >= set(shipped())


@pytest.mark.parametrize("law", CORE)
def test_torque_and_memory_with_a_gain_for_each_joint(law: str) -> None:
    """With gains that differ between joints torque, s, integral and kept velocity are the equation's, in every form.

    A part of the memory that a form has no use for stays as it is.
    """
    count = 0
    for options in forms(law):
        tau, memory = call(law, options, GAINS)
        wanted: Answer = EQUATIONS[law](options, GAINS, state())
        assert tau == pytest.approx(wanted.tau, rel=EXACT, abs=1e-11), options
        kept = {"s": np.zeros(2), "integral": INTEGRAL, "velocity": LAST_QD}
        for name in getattr(memory, "_fields", ()):
            if name in kept:
                value = getattr(wanted, name)
                assert getattr(memory, name) == pytest.approx(kept[name] if value is None else value, rel=EXACT), (
                    options
                )
        count += 1
    assert count == np.prod([len(option.values) for option in find_law(law).options.values()])


@pytest.mark.parametrize("law", CORE)
def test_each_joints_gain_has_its_own_effect(law: str) -> None:
    """Changing one gain of one joint changes the torque in each form as the equation says, and somewhere at all."""
    felt = set()
    for options in forms(law):
        base = call(law, options, GAINS)[0]
        for name in acting(law, options):
            for joint in (0, 1):
                changed = {n: v.copy() for n, v in GAINS.items()}
                changed[name][joint] *= 0.5 if name == "lam" else 1.25  # half the slope turns the first joint's s
                tau = call(law, options, changed)[0]
                assert tau == pytest.approx(EQUATIONS[law](options, changed, state()).tau, rel=EXACT, abs=1e-11)
                if np.max(np.abs(tau - base)) > 1e-3:
                    felt.add((name, joint))
    later = {"k2"}  # of super-twisting: it is the rate of its integral, which is zero at a first call
    assert felt == {(name, joint) for name in find_law(law).gains for joint in (0, 1) if name not in later}


@pytest.mark.parametrize(
    ("law", "options"),
    [
        ("pid", {}),
        ("computed-torque", {}),
        ("position-servo", {}),
        ("fuzzy-linear-band-smc", {"equivalent_control": False}),
        ("fuzzy-linear-band-smc", {"compensation": "off", "band": "off", "linear": False}),
    ],
)
@pytest.mark.parametrize(
    ("wanted", "waits"),
    [
        ((50.0, -50.0), (False, True)),
        ((100.0, -20.0), (True, False)),
        ((90.0, -30.0), (True, True)),
        ((-100.0, 50.0), (False, False)),
        ((-100.0, -50.0), (False, True)),
        ((100.0, 50.0), (True, False)),
    ],
)
def test_each_joints_integral_waits_for_its_own_limit(
    law: str, options: Options, wanted: tuple[float, float], waits: tuple[bool, bool]
) -> None:
    """A joint's integral stops only when its own torque is beyond its own limit (80, 25 N m) along its own error.

    The errors are +0.05 and -0.3 rad; the integral at the start is the one for which the law asks for `wanted`.
    """
    options = next(forms(law)) | options
    rest = EQUATIONS[law](options, GAINS, state(np.zeros(2))).tau
    scales = {"computed-torque": M @ np.diag(GAINS["ki"]), "position-servo": np.diag(GAINS["ki"])}
    scale = scales.get(law, np.diag(GAINS["ki"] * MBAR))
    start = np.linalg.solve(scale, np.array(wanted) - rest)
    tau, memory = call(law, options, GAINS, start)
    assert tau == pytest.approx(np.array(wanted), rel=1e-9)  # a linear solve lies between
    # the smaller step is 1e-4 on an integral of order 1, which is good to 1e-16
    assert memory.integral - start == pytest.approx(np.where(waits, 0.0, T * E), rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("surface", ["pi", "pid"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_surfaces_integral_waits_at_the_limit(surface: str, side: float) -> None:
    """With K = 1.5 tau_max and no model the torque is beyond the limit along sgn(s): there the integral waits.

    Where the integral has turned s against the error, the torque points the other way and the integral moves back.
    """
    options: Options = {"equivalent_control": False, "switching": "sign", "surface": surface}
    gains = {"lam": np.array([10.0, 4.0]), "k": np.array([1.5, 1.5])}
    tau, memory = call("smc", options, gains, side * np.array([1.0, -1.0]))
    # s is 25 and 4 times the integral and a smaller rest; with side 1 the integral has the sign of the error
    assert tau == pytest.approx(side * np.array([120.0, -37.5]), rel=EXACT)
    moved = memory.integral - side * np.array([1.0, -1.0])
    assert moved == pytest.approx(np.zeros(2) if side > 0.0 else T * E, rel=1e-9, abs=1e-15)
