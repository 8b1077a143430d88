"""Gains that differ between joints: each law's equation with vectors, so that no joint may use another's gain."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.arms import pack, two_link, two_link_terms
from tests.fuzzy.independent import exact_output
from torquebench.kernel import Array
from torquebench.laws import find_law, law_names
from torquebench.references import Reference

T = 0.002
"""Control period [s]; not the default, so that a law that ignores it is found."""
EXACT = 1e-12
"""Relative tolerance: a few dozen roundings of 1e-16, of terms up to a hundred times their sum."""
Q, QD = np.array([0.4, -0.9]), np.array([0.7, -0.2])
E, DE = np.array([0.05, -0.3]), np.array([-0.3, 2.0])
REF = Reference(Q + E, QD + DE, np.array([-1.1, 2.3]))
INTEGRAL = np.array([0.05, -0.03])
"""State of the integral [rad s]."""
GAINS = {
    "lam": np.array([10.0, 4.0]), "kv": np.array([20.0, 7.0]), "ki": np.array([50.0, 90.0]),
    "k": np.array([0.3, 0.55]), "phi": np.array([0.6, 1.5]), "kf": np.array([0.2, 0.35]), "gd": np.array([2.0, 5.0]),
}  # fmt: skip
"""s = de + lam e is 0.2 and 0.8, inside its joint's band; with the other joint's slope it is -0.1 and -1.0."""
TAU_MAX, MBAR = np.array([80.0, 25.0]), np.array([2.5, 0.4])
M, VELOCITY, GRAVITY = two_link_terms(Q, QD)


def torque_of(law: str, options: dict[str, Any], gains: dict[str, Array], integral: Array) -> Array:
    """Return what the law's equation gives, in vectors, from the textbook's terms of the arm."""
    lam, kv, ki, k, phi = (gains[name] for name in ("lam", "kv", "ki", "k", "phi"))
    s = DE + lam * E
    pd = kv * MBAR * DE + lam * kv * MBAR * E
    equivalent = M @ (REF.qdd + lam * DE) + VELOCITY + GRAVITY if options.get("equivalent_control") else np.zeros(2)
    saturated = np.minimum(np.maximum(s / phi, -1.0), 1.0)
    match law:
        case "pd":
            return pd
        case "pd-gravity":
            return pd + GRAVITY
        case "pid":
            return pd + ki * MBAR * integral
        case "computed-torque":
            return M @ (REF.qdd + kv * DE + lam * kv * E + ki * integral) + VELOCITY + GRAVITY
        case "smc":
            return equivalent + k * TAU_MAX * (np.sign(s) if options["switching"] == "sign" else saturated)
        case "linear-band-smc":
            return equivalent + k * TAU_MAX * saturated + kv * MBAR * s
        case "fuzzy-linear-band-smc":
            rules = [exact_output(x, y) for x, y in zip(lam * E / gains["gd"], DE / gains["gd"], strict=True)]
            fuzzy = gains["kf"] * TAU_MAX * np.array(rules)
            return equivalent + k * TAU_MAX * saturated + kv * MBAR * s + fuzzy + ki * MBAR * integral
    raise ValueError(f"law '{law}' has no equation here: add it")


def gains_of(law: str, options: dict[str, Any]) -> list[str]:
    """Return the names of the gains that have an effect under the options."""
    found = find_law(law)
    return [name for name in found.gains if found.gain_problem(name, False, options) is not None]


def call(law: str, options: dict[str, Any], gains: dict[str, Array], integral: Array) -> tuple[Array, Any]:
    """Return the torque of one call at the state above, and the memory after it."""
    controller = pack(law, 2, options, **{name: gains[name] for name in gains_of(law, options)})
    memory = controller.law.new_memory(2)
    if "integral" in getattr(memory, "_fields", ()):
        memory.integral[:] = integral
    tau = np.full(2, 99.0)
    belief = replace(two_link().flat, control_period=T)
    controller.law.function(controller.gains, belief, 0.7, Q.copy(), QD.copy(), REF, memory, tau)
    return tau, memory


def variants() -> Iterator[Any]:
    """Every law that ships with the package, under each combination of its options."""
    for name in law_names():
        law = find_law(name)
        if law.function.__module__.startswith("torquebench.laws."):
            for values in itertools.product(*(option.values for option in law.options.values())):
                options = dict(zip(law.options, values, strict=True))
                yield pytest.param(name, options, id="-".join([name, *map(str, values)]))


@pytest.mark.parametrize(("law", "options"), list(variants()))
def test_torque_with_a_gain_for_each_joint(law: str, options: dict[str, Any]) -> None:
    """With gains that differ between joints the torque, s and the integral are those of the equation in vectors."""
    tau, memory = call(law, options, GAINS, INTEGRAL)
    assert tau == pytest.approx(torque_of(law, options, GAINS, INTEGRAL), rel=EXACT)
    if "s" in memory._fields:
        assert memory.s == pytest.approx(DE + GAINS["lam"] * E, rel=EXACT)
    if "integral" in memory._fields:
        assert memory.integral == pytest.approx(INTEGRAL + T * E, rel=EXACT)


@pytest.mark.parametrize(("law", "options"), list(variants()))
@pytest.mark.parametrize("joint", [0, 1])
def test_each_joints_gain_has_its_own_effect(law: str, options: dict[str, Any], joint: int) -> None:
    """Changing one gain of one joint changes the torque, and as the equation says: none is ignored or shared."""
    base = call(law, options, GAINS, INTEGRAL)[0]
    for name in gains_of(law, options):
        changed = {n: v.copy() for n, v in GAINS.items()}
        changed[name][joint] *= 0.5 if name == "lam" else 1.25  # half the slope turns the sign of the first joint's s
        tau = call(law, options, changed, INTEGRAL)[0]
        assert tau == pytest.approx(torque_of(law, options, changed, INTEGRAL), rel=EXACT)
        # s of the second joint keeps its sign, so sgn(s) alone does not feel the slope there
        felt = (law, name, joint, *options.values()) != ("smc", "lam", 1, False, "sign")
        assert bool(abs(tau[joint] - base[joint]) > 1e-3) == felt


@pytest.mark.parametrize("law", ["pid", "computed-torque"])
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
    law: str, wanted: tuple[float, float], waits: tuple[bool, bool]
) -> None:
    """A joint's integral stops only when its own torque is beyond its own limit (80, 25 N m) along its own error.

    The errors are +0.05 and -0.3 rad; the integral at the start is the one for which the law asks for `wanted`.
    """
    lam, kv, ki = GAINS["lam"], GAINS["kv"], GAINS["ki"]
    if law == "pid":
        start = (np.array(wanted) / MBAR - kv * (DE + lam * E)) / ki
    else:
        acceleration = np.linalg.solve(M, np.array(wanted) - VELOCITY - GRAVITY)
        start = (acceleration - REF.qdd - kv * (DE + lam * E)) / ki
    tau, memory = call(law, {}, GAINS, start)
    assert tau == pytest.approx(np.array(wanted), rel=1e-9)  # a linear solve lies between
    # the smaller step is 1e-4 on an integral of order 1, which is good to 1e-16
    assert memory.integral - start == pytest.approx(np.where(waits, 0.0, T * E), rel=1e-9, abs=1e-13)
