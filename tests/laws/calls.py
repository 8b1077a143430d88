"""Calling a law once, at states in which the tests work the torque out from the arm's textbook formulas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.arms import pack, pendulum, pendulum_terms, two_link, two_link_terms
from tests.laws.forms import Options, acting, default_form, filled
from torquebench.kernel import Array
from torquebench.references import Reference
from torquebench.robot import RobotModel

T = 0.002
"""Control period [s]; not the default, so that a law that ignores it is found."""
EXACT = 1e-12
"""Relative tolerance: a few dozen roundings of 1e-16, of terms up to a hundred times their sum."""
INTEGRAL = np.array([0.05, -0.03])
"""State of the integral [rad s]."""


class Case(NamedTuple):
    """An arm in a state, and what is wanted of it."""

    arm: RobotModel
    terms: Callable[[Array, Array], tuple[Array, Array, Array]]
    q: Array
    qd: Array
    ref: Reference

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.arm.n


PENDULUM = Case(
    pendulum(),
    pendulum_terms,
    np.array([0.3]),
    np.array([-0.5]),
    Reference(np.array([0.31]), np.array([-0.35]), np.array([1.5])),
)
# s = de + 10 e: 0.25 in the band of half-width 0.3 (pendulum); 0.2 inside and -2.6 outside it (two-joint arm)
TWO_LINK = Case(
    two_link(),
    two_link_terms,
    np.array([0.4, -0.9]),
    np.array([0.7, -0.2]),
    Reference(np.array([0.45, -1.2]), np.array([0.4, 0.2]), np.array([-1.1, 2.3])),
)
CASES = [pytest.param(PENDULUM, id="pendulum"), pytest.param(TWO_LINK, id="two-link")]
VALUES = {
    "lam": 10.0,
    "kv": 20.0,
    "ki": 50.0,
    "k": 0.3,
    "phi": 0.3,
    "kf": 0.2,
    "gd": 2.0,
    "ge": 0.2,
    "gi": 0.1,
    "k1": 4.0,
    "k2": 30.0,
    "kp": 200.0,
    "kd": 20.0,
    "viscous": 5.0,
    "coulomb": 4.0,
    "speed": 0.5,
}
"""Value of each gain, unless a test says otherwise."""


def gains_of(law: str, options: Options) -> dict[str, float]:
    """Return a value for each gain that has an effect under the options."""
    return {name: VALUES[name] for name in acting(law, default_form(law) | options)}


def call(
    law: str,
    case: Case,
    options: Options | None = None,
    integral: Array | None = None,
    last_qd: Array | None = None,
    **gains: Any,
) -> tuple[Array, Any]:
    """Return the torque of one call at the case's state, and the memory after it."""
    options = options or {}
    controller = pack(law, case.n, options, **{**gains_of(law, options), **gains})
    before = {"integral": integral, "velocity": last_qd}
    memory = filled(law, case.n, {name: array for name, array in before.items() if array is not None})
    tau = np.full(case.n, 99.0)
    belief = replace(case.arm.flat, control_period=T)
    controller.law.function(controller.gains, belief, 0.7, case.q.copy(), case.qd.copy(), case.ref, memory, tau)
    return tau, memory


def errors(case: Case) -> tuple[Array, Array, Array]:
    """Return e, de and s = de + 10 e."""
    e, de = case.ref.q - case.q, case.ref.qd - case.qd
    return e, de, de + 10.0 * e


def equivalent(case: Case) -> Array:
    """Return M (qdd_ref + 10 de) + C qd + g."""
    M, velocity, gravity = case.terms(case.q, case.qd)
    _, de, _ = errors(case)
    return M @ (case.ref.qdd + 10.0 * de) + velocity + gravity


def sat(x: Array) -> Array:
    """Return x clipped to [-1, 1]."""
    return np.minimum(np.maximum(x, -1.0), 1.0)
