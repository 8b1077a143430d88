"""Each law against its equation, at points where the torque is worked out here from the arm's textbook formulas."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.arms import pack, pendulum, pendulum_terms, two_link, two_link_terms
from tests.fuzzy.independent import exact_output
from torquebench.fuzzy import Functions, FuzzySystem, Rule, Variable
from torquebench.kernel import Array
from torquebench.laws import find_law, law_names
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
    pendulum(), pendulum_terms, np.array([0.3]), np.array([-0.5]),
    Reference(np.array([0.31]), np.array([-0.35]), np.array([1.5])),
)  # fmt: skip
# s = de + 10 e: 0.25 in the band of half-width 0.3 (pendulum); 0.2 inside and -2.6 outside it (two-joint arm)
TWO_LINK = Case(
    two_link(), two_link_terms, np.array([0.4, -0.9]), np.array([0.7, -0.2]),
    Reference(np.array([0.45, -1.2]), np.array([0.4, 0.2]), np.array([-1.1, 2.3])),
)  # fmt: skip
CASES = [pytest.param(PENDULUM, id="pendulum"), pytest.param(TWO_LINK, id="two-link")]
VALUES = {"lam": 10.0, "kv": 20.0, "ki": 50.0, "k": 0.3, "phi": 0.3, "kf": 0.2, "gd": 2.0}
"""Value of each gain, unless a test says otherwise."""


def gains_of(law: str, options: dict[str, Any]) -> dict[str, float]:
    """Return a value for each gain that has an effect under the options."""
    found = find_law(law)
    chosen = {name: options.get(name, option.values[0]) for name, option in found.options.items()}
    return {name: VALUES.get(name, 0.7) for name in found.gains if found.gain_problem(name, False, chosen) is not None}


def call(
    law: str, case: Case, options: dict[str, Any] | None = None, integral: Array | None = None, **gains: Any
) -> tuple[Array, Any]:
    """Return the torque of one call at the case's state, and the memory after it."""
    options = options or {}
    controller = pack(law, case.n, options, **{**gains_of(law, options), **gains})
    memory = controller.law.new_memory(case.n)
    if integral is not None:
        memory.integral[:] = integral[: case.n]
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


@pytest.mark.parametrize("case", CASES)
def test_the_tiny_arms_are_what_their_formulas_say(case: Case) -> None:
    """The model's mass matrix, gravity and velocity torque are the textbook's: the tests below stand on this."""
    M, velocity, gravity = case.terms(case.q, case.qd)
    assert case.arm.mass_matrix(case.q) == pytest.approx(M, rel=EXACT)
    assert case.arm.gravity(case.q) == pytest.approx(gravity, rel=EXACT)
    assert case.arm.bias_forces(case.q, case.qd) == pytest.approx(velocity + gravity, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
def test_pd(case: Case) -> None:
    """Kp e + Kd de with Kd = kV Mbar and Kp = lambda Kd."""
    e, de, _ = errors(case)
    kd = 20.0 * case.arm.flat.inertia_scale
    assert call("pd", case)[0] == pytest.approx(10.0 * kd * e + kd * de, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
def test_pd_gravity(case: Case) -> None:
    """PD plus the torque that holds the arm still where it is, not where it should be."""
    gravity = case.terms(case.q, case.qd)[2]
    assert call("pd-gravity", case)[0] == pytest.approx(call("pd", case)[0] + gravity, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
def test_pid(case: Case) -> None:
    """PD plus KI int e with KI = kI Mbar; the integral counts after the torque is formed, one period at a time."""
    e, _, _ = errors(case)
    start = INTEGRAL[: case.n]
    tau, memory = call("pid", case, integral=INTEGRAL)
    integral_term = 50.0 * case.arm.flat.inertia_scale * start
    assert tau == pytest.approx(call("pd", case)[0] + integral_term, rel=EXACT)
    assert memory.integral == pytest.approx(start + T * e, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
def test_computed_torque(case: Case) -> None:
    """M (qdd_ref + kV de + lambda kV e + kI int e) + C qd + g; the gains act on accelerations, without Mbar."""
    e, de, _ = errors(case)
    M, velocity, gravity = case.terms(case.q, case.qd)
    start = INTEGRAL[: case.n]
    wanted = M @ (case.ref.qdd + 20.0 * de + 200.0 * e + 50.0 * start) + velocity + gravity
    tau, memory = call("computed-torque", case, integral=INTEGRAL)
    assert tau == pytest.approx(wanted, rel=EXACT)
    assert memory.integral == pytest.approx(start + T * e, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("with_model", [True, False])
@pytest.mark.parametrize("switching", ["sign", "saturation"])
def test_smc(case: Case, with_model: bool, switching: str) -> None:
    """[tau_eq +] kK tau_max sgn(s), or sat(s/phi), with s = de + lambda e; s is kept for the record."""
    _, _, s = errors(case)
    switch = np.sign(s) if switching == "sign" else sat(s / 0.3)
    wanted = 0.3 * case.arm.flat.tau_max * switch + (equivalent(case) if with_model else 0.0)
    tau, memory = call("smc", case, {"equivalent_control": with_model, "switching": switching})
    assert tau == pytest.approx(wanted, rel=EXACT)
    assert memory.s == pytest.approx(s, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("with_model", [True, False])
def test_linear_band(case: Case, with_model: bool) -> None:
    """[tau_eq +] K sat(s/phi) + kV Mbar s; s is kept for the record."""
    _, _, s = errors(case)
    wanted = 0.3 * case.arm.flat.tau_max * sat(s / 0.3) + 20.0 * case.arm.flat.inertia_scale * s
    tau, memory = call("linear-band-smc", case, {"equivalent_control": with_model})
    assert tau == pytest.approx(wanted + (equivalent(case) if with_model else 0.0), rel=EXACT)
    assert memory.s == pytest.approx(s, rel=EXACT)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("with_model", [True, False])
def test_fuzzy_linear_band(case: Case, with_model: bool) -> None:
    """The linear band, KF FIS(10 e/2, de/2) with KF = 0.2 tau_max, and 50 Mbar int e, which counts afterwards.

    The second joint of the two-joint arm asks for more than its limit along its error, so its integral waits.
    """
    e, de, s = errors(case)
    start = INTEGRAL[: case.n]
    fuzzy = np.array([exact_output(x, y) for x, y in zip(5.0 * e, 0.5 * de, strict=True)])
    band = call("linear-band-smc", case, {"equivalent_control": with_model})[0]
    wanted = band + 0.2 * case.arm.flat.tau_max * fuzzy + 50.0 * case.arm.flat.inertia_scale * start
    tau, memory = call("fuzzy-linear-band-smc", case, {"equivalent_control": with_model}, INTEGRAL)
    assert tau == pytest.approx(wanted, rel=EXACT)
    assert memory.s == pytest.approx(s, rel=EXACT)
    waits = (np.abs(wanted) > case.arm.flat.tau_max) & (wanted * e > 0.0)
    assert waits.tolist() == [False, True][: case.n]
    assert memory.integral == pytest.approx(np.where(waits, start, start + T * e), rel=EXACT)


def test_the_fuzzy_part_by_hand() -> None:
    """E = 0.05 and de = 0.5 are x = y = 1/4, where FIS = 31/69: the fuzzy part is 0.2 of 40 N m times that.

    Of each input Z holds to 1/4, PS to 3/4: Z-Z, Z-PS and PS-Z fire at 1/4, PS-PS at 3/4. Clipped triangles about 0,
    1 and 2 thirds with the areas 7/16, 7/16 and 15/16 share 3/16 about 1/2 and 3/2: (7 + 30 - 6) / (29 - 6) / 3.
    """
    case = Case(
        pendulum(gravity=0.0), pendulum_terms, np.zeros(1), np.zeros(1),
        Reference(np.array([0.05]), np.array([0.5]), np.zeros(1)),
    )  # fmt: skip
    options = {"equivalent_control": False}
    fuzzy = call("fuzzy-linear-band-smc", case, options)[0] - call("linear-band-smc", case, options)[0]
    assert fuzzy[0] == pytest.approx(0.2 * 40.0 * 31.0 / 69.0, rel=1e-13)


def variants() -> Iterator[tuple[str, dict[str, Any]]]:
    """Every law that ships with the package, under each combination of its options."""
    for name in law_names():
        law = find_law(name)
        if law.function.__module__.startswith("torquebench.laws."):
            for values in itertools.product(*(option.values for option in law.options.values())):
                yield name, dict(zip(law.options, values, strict=True))


VARIANTS = [pytest.param(*v, id="-".join([v[0], *(str(x) for x in v[1].values())])) for v in variants()]


@pytest.mark.parametrize(("law", "options"), VARIANTS)
@pytest.mark.parametrize("part", ["q", "qd"])
def test_torque_pushes_against_the_error(law: str, options: dict[str, Any], part: str) -> None:
    """From rest at the wanted position, asking for more position or speed raises the torque, for less lowers it."""
    here = Case(pendulum(), pendulum_terms, np.array([0.3]), np.zeros(1), Reference(np.array([0.3]), *np.zeros((2, 1))))
    base = call(law, here, options)[0][0]
    for change in (0.02, -0.02):
        moved = here._replace(ref=here.ref._replace(**{part: getattr(here.ref, part) + change}))
        assert (call(law, moved, options)[0][0] - base) * change > 0.0


@pytest.mark.parametrize(("law", "options"), VARIANTS)
def test_wanted_acceleration_enters_through_the_mass_matrix(law: str, options: dict[str, Any]) -> None:
    """With a model in the law d tau / d qdd_ref = M; without one the wanted acceleration has no effect."""
    uses_model = options.get("equivalent_control", law == "computed-torque")
    M = TWO_LINK.terms(TWO_LINK.q, TWO_LINK.qd)[0]
    change = np.array([0.3, -0.7])
    more = TWO_LINK._replace(ref=TWO_LINK.ref._replace(qdd=TWO_LINK.ref.qdd + change))
    difference = call(law, more, options)[0] - call(law, TWO_LINK, options)[0]
    # an absolute tolerance, because the difference is of torques up to 60 N m, each good to 1e-14 of itself
    assert difference == pytest.approx(M @ change if uses_model else np.zeros(2), abs=1e-11)


def test_no_two_laws_are_the_same() -> None:
    """At one state of the two-joint arm, with a running integral, any two laws or variants differ in torque."""
    torques = {}
    for law, options in variants():
        memory_type = find_law(law).memory_type
        integral = INTEGRAL if memory_type is not None and "integral" in memory_type._fields else None
        torques[law, *options.values()] = call(law, TWO_LINK, options, integral=integral)[0]
    for (a, tau_a), (b, tau_b) in itertools.combinations(torques.items(), 2):
        assert np.max(np.abs(tau_a - tau_b)) > 1e-3, (a, b)


def torque_at(s: float, law: str, options: dict[str, Any]) -> float:
    """Return the pendulum's torque at zero error and sliding variable `s`, gravity left out."""
    at = Case(pendulum(), pendulum_terms, np.zeros(1), np.zeros(1), Reference(np.zeros(1), np.array([s]), np.zeros(1)))
    return float(call(law, at, {"equivalent_control": False, **options})[0][0])


@pytest.mark.parametrize(("law", "slope"), [("smc", 0.0), ("linear-band-smc", 20.0 * 0.5)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_band_is_continuous_at_its_edge(law: str, slope: float, side: float) -> None:
    """At |s| = phi the band gives the full switching torque K = 12 N m, and the torque on both sides meets there."""
    options = {"switching": "saturation"} if law == "smc" else {}
    edge, eps = side * 0.3, 1e-9
    at_edge = torque_at(edge, law, options)
    assert at_edge == pytest.approx(side * (12.0 + slope * 0.3), rel=EXACT)
    inside, outside = torque_at(edge - side * eps, law, options), torque_at(edge + side * eps, law, options)
    # the steepest slope there is K/phi + Kd = 50 N m s/rad; a jump would be of the order of K
    assert abs(inside - at_edge) < 60.0 * eps
    assert abs(outside - at_edge) < 60.0 * eps
    assert (at_edge - inside) * side > 0.9 * eps * (40.0 + slope)


def test_sign_law_jumps_at_zero() -> None:
    """Sgn: -K below zero, nothing at zero, +K above: K = 0.3 of 40 N m."""
    assert [torque_at(s, "smc", {"switching": "sign"}) for s in (-1e-300, 0.0, 1e-300)] == [-12.0, 0.0, 12.0]


@pytest.mark.parametrize("law", ["pid", "computed-torque"])
def test_anti_windup(law: str) -> None:
    """Beyond the torque limit the integral waits while the error would make it worse, and moves otherwise."""
    arm = pendulum(gravity=0.0)

    def integral_after(e: float, start: float) -> float:
        case = Case(arm, pendulum_terms, np.zeros(1), np.zeros(1), Reference(np.array([e]), np.zeros(1), np.zeros(1)))
        tau, memory = call(law, case, integral=np.array([start]))
        # 100 or 120 N m/rad of position gain, 25 or 30 of integral gain, against a limit of 40 N m
        assert (abs(tau[0]) > 40.0) == (abs(e) > 0.5 or abs(start) > 3.0)
        return float(memory.integral[0] - start)

    assert integral_after(1.0, 0.0) == 0.0
    assert integral_after(-1.0, 0.0) == 0.0
    assert integral_after(0.2, 0.0) == pytest.approx(T * 0.2, rel=EXACT)
    assert integral_after(-0.2, 0.0) == pytest.approx(-T * 0.2, rel=EXACT)
    # the torque is beyond its limit because of the integral, and the error brings it back
    assert integral_after(-0.1, 4.0) == pytest.approx(-T * 0.1, rel=1e-9)
    assert integral_after(0.1, -4.0) == pytest.approx(T * 0.1, rel=1e-9)


def test_the_first_input_is_the_error_and_the_second_its_rate() -> None:
    """With a system that is not symmetric in its inputs: FIS(lambda e/gd, de/gd), not the reverse."""
    first, second = Variable.of({"N": -1.0, "P": 1.0}), Variable.of({"any": (-1.0, -1.0, 1.0, 1.0)})
    rules = (Rule(("N", "any"), "a"), Rule(("P", "any"), "b"))
    system = FuzzySystem("slanted", (first, second), Functions.of({"a": (-0.6, 0.0, 0.1), "b": (0.2, 0.0, 0.1)}), rules)
    law = find_law("fuzzy-linear-band-smc")
    gains = law.pack_gains(2, gains_of(law.name, {}), {"equivalent_control": False}, system)
    tau = np.zeros(2)
    law.function(gains, TWO_LINK.arm.flat, 0.0, TWO_LINK.q, TWO_LINK.qd, TWO_LINK.ref, law.new_memory(2), tau)
    e, de, _ = errors(TWO_LINK)
    # between N and P the constants are a straight line from -0.6 to 0.2
    fuzzy = -0.2 + 0.4 * np.clip(5.0 * e, -1.0, 1.0) + 0.1 * np.clip(0.5 * de, -1.0, 1.0)
    band = call("linear-band-smc", TWO_LINK, {"equivalent_control": False})[0]
    assert tau == pytest.approx(band + 0.2 * TWO_LINK.arm.flat.tau_max * fuzzy, rel=EXACT)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_anti_windup_of_the_fuzzy_law(side: float) -> None:
    """Its integral waits beyond the limit along the error, which all parts together decide, and moves otherwise."""
    arm = pendulum(gravity=0.0)

    def integral_after(e: float, start: float, **gains: float) -> float:
        case = Case(arm, pendulum_terms, np.zeros(1), np.zeros(1), Reference(np.array([e]), np.zeros(1), np.zeros(1)))
        return float(call("fuzzy-linear-band-smc", case, integral=np.array([start]), **gains)[1].integral[0] - start)

    # 12 N m of the band, 100 N m/rad of e and 8 N m of the fuzzy system against a limit of 40 N m
    assert integral_after(side * 0.3, 0.0) == 0.0
    assert integral_after(side * 0.3, 0.0, kf=0.0) == 0.0
    assert integral_after(side * 0.25, 0.0) == 0.0
    assert integral_after(side * 0.25, 0.0, kf=0.0) == pytest.approx(side * T * 0.25, rel=EXACT)
    assert integral_after(side * -0.1, side * 4.0) == pytest.approx(side * -T * 0.1, rel=1e-9)


@pytest.mark.parametrize(("law", "options"), VARIANTS)
def test_memory_starts_at_zero_and_is_the_only_state(law: str, options: dict[str, Any]) -> None:
    """New memory is all zero, one array per joint; two first calls give the same torque, whatever ran in between."""
    memory = find_law(law).new_memory(2)
    assert all(not np.any(array) for array in memory)
    first = call(law, TWO_LINK, options)[0]
    call(law, PENDULUM, options)
    assert np.array_equal(first, call(law, TWO_LINK, options)[0])
