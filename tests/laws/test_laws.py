"""Each law against its equation, at points where the torque is worked out here from the arm's textbook formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.arms import pack, pendulum, pendulum_terms
from tests.laws.calls import CASES, EXACT, INTEGRAL, PENDULUM, TWO_LINK, Case, T, call, equivalent, errors, sat
from tests.laws.core_equations import EQUATIONS
from tests.laws.forms import Options, filled, forms
from torquebench.laws import find_law
from torquebench.references import Reference


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
def test_vendor_laws(case: Case) -> None:
    """Kp 200 N m/rad, Kd 20 N m s/rad: impedance with C qd + g, PD with g and friction, a servo with nothing else."""
    e, de, _ = errors(case)
    _, velocity, gravity = case.terms(case.q, case.qd)
    damped = 200.0 * e - 20.0 * case.qd
    assert call("joint-impedance", case)[0] == pytest.approx(damped + velocity + gravity, rel=EXACT)
    assert call("position-servo", case)[0] == pytest.approx(damped, rel=EXACT)
    # 5 N m s/rad and 4 N m that are full from 0.5 rad/s on
    rub = 5.0 * case.ref.qd + 4.0 * np.clip(2.0 * case.ref.qd, -1.0, 1.0)
    wanted = 200.0 * e + 20.0 * de + gravity + rub
    assert call("gravity-friction", case)[0] == pytest.approx(wanted, rel=EXACT)


def test_vendor_law_by_hand() -> None:
    """The pendulum at 0.3 rad and -0.5 rad/s, wanted 0.31 rad, -0.35 rad/s: m g l cos 0.3 = 9.3719 N m, no C.

    200 x 0.01 + 20 x 0.5 = 12; 200 x 0.01 + 20 x 0.15 = 5; 5 x -0.35 + 4 x -0.7 = -4.55 N m.
    """
    torques = [float(call(law, PENDULUM)[0][0]) for law in ("joint-impedance", "position-servo", "gravity-friction")]
    assert torques == pytest.approx([21.3719, 12.0, 9.8219], abs=1e-4)  # four digits of the cosine


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


@pytest.mark.parametrize(("surface", "s"), [("pd", 0.1), ("pi", 0.125), ("pid", -0.275)])
@pytest.mark.parametrize("switching", ["sign", "saturation"])
def test_the_surfaces_by_hand(surface: str, s: float, switching: str) -> None:
    """With lambda 10, e = 0.05, de = -0.4 and int e = -0.015: 10 e = 0.5, (10/2)^2 int e = -0.375; (83), (85), (86).

    The pendulum hangs nowhere and moves at 0.4 rad/s: tau_eq = 0.6 kg m^2 times 10 de, and 25 e where there is an
    integral. K is 12 N m and phi 0.3 rad/s.
    """
    case = Case(
        pendulum(gravity=0.0),
        pendulum_terms,
        np.zeros(1),
        np.array([0.4]),
        Reference(np.array([0.05]), np.zeros(1), np.zeros(1)),
    )
    form: Options = {"surface": surface, "switching": switching}
    switched = 12.0 * (math.copysign(1.0, s) if switching == "sign" else s / 0.3)
    for with_model in (True, False):
        tau, memory = call("smc", case, {**form, "equivalent_control": with_model}, np.array([-0.015]))
        rate = -4.0 if surface == "pd" else -4.0 + 25.0 * 0.05
        assert tau[0] == pytest.approx(switched + (0.6 * rate if with_model else 0.0), rel=1e-13)
        assert memory.s[0] == pytest.approx(s, rel=1e-12)
        # far from the limit of 40 N m, the integral grows where the surface has one
        assert memory.integral[0] == pytest.approx(-0.015 + (0.0 if surface == "pd" else T * 0.05), rel=1e-13)


@pytest.mark.parametrize("law", ["smc", "linear-band-smc", "fuzzy-linear-band-smc"])
def test_the_literal_equivalent_control(law: str) -> None:
    """(98) read literally is tau_eq less M times the acceleration measured, (qd - qd before)/T; the velocity is kept.

    From 0.7 and -0.2 rad/s, 2 ms after 0.701 and -0.203, that is -0.5 and 1.5 rad/s^2.
    """
    M = TWO_LINK.terms(TWO_LINK.q, TWO_LINK.qd)[0]
    workable = call(law, TWO_LINK)[0]
    literal, memory = call(
        law, TWO_LINK, {"equivalent_control": "measured-acceleration"}, last_qd=np.array([0.701, -0.203])
    )
    # the difference of two velocities that are good to 1e-16, over 2 ms
    assert workable - literal == pytest.approx(M @ np.array([-0.5, 1.5]), rel=1e-11)
    assert np.array_equal(memory.velocity, TWO_LINK.qd)


def test_the_literal_law_starts_from_rest() -> None:
    """Memory starts at zero and so does every run: at its first instant at rest the acceleration is none."""
    at_rest = TWO_LINK._replace(qd=np.zeros(2))
    literal = call("smc", at_rest, {"equivalent_control": "measured-acceleration"})[0]
    assert np.array_equal(literal, call("smc", at_rest)[0])


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("with_model", [True, False])
@pytest.mark.parametrize("switching", ["sign", "saturation"])
def test_linear_band(case: Case, with_model: bool, switching: str) -> None:
    """[tau_eq +] K sat(s/phi), or K sgn(s) as (149) prints it, + kV Mbar s; s is kept for the record."""
    _, _, s = errors(case)
    switch = np.sign(s) if switching == "sign" else sat(s / 0.3)
    wanted = 0.3 * case.arm.flat.tau_max * switch + 20.0 * case.arm.flat.inertia_scale * s
    tau, memory = call("linear-band-smc", case, {"equivalent_control": with_model, "switching": switching})
    assert tau == pytest.approx(wanted + (equivalent(case) if with_model else 0.0), rel=EXACT)
    assert memory.s == pytest.approx(s, rel=EXACT)


def test_super_twisting_by_hand() -> None:
    """At s = 0.25 rad/s: Mbar (4 x 0.5 + w), and w grows by 30 T; beyond the torque limit it waits along s alone.

    The pendulum's Mbar is 0.5 kg m^2 and its limit 40 N m.
    """
    case = Case(
        pendulum(gravity=0.0),
        pendulum_terms,
        np.zeros(1),
        np.zeros(1),
        Reference(np.zeros(1), np.array([0.25]), np.zeros(1)),
    )
    mbar = float(case.arm.flat.inertia_scale[0])

    def after(w: float, s: float, qd: float = 0.0) -> tuple[float, float]:
        controller = pack("super-twisting", 1, {"equivalent_control": False}, lam=10.0, k1=4.0, k2=30.0)
        memory = filled("super-twisting", 1, {"w": np.array([w])})
        tau = np.zeros(1)
        ref, speed = case.ref._replace(qd=np.array([qd + s])), np.array([qd])
        controller.law.function(
            controller.gains, replace(case.arm.flat, control_period=T), 0.0, case.q, speed, ref, memory, tau
        )
        return float(tau[0]), float(memory.w[0])

    assert after(0.0, 0.25) == pytest.approx((mbar * 2.0, 30.0 * T), rel=EXACT)
    assert after(0.0, 0.25, qd=1.5) == after(0.0, 0.25)  # of the error alone, however fast the arm moves
    assert after(3.0, -0.25) == pytest.approx((mbar * (3.0 - 2.0), 3.0 - 30.0 * T), rel=EXACT)
    beyond = 41.0 / mbar
    assert after(beyond, 0.25)[1] == beyond
    assert after(beyond, -0.25)[1] == pytest.approx(beyond - 30.0 * T, rel=EXACT)


def feels(law: str, options: Options, part: str) -> bool:
    """Whether a law's first torque depends on an error of position, or of speed, as its equation says."""
    if law == "fuzzy-linear-band-smc":
        parts = (options["compensation"], options["band"]) != ("off", "off") or options["linear"]
        return bool(parts or (options["equivalent_control"] and part == "qd"))
    if part == "qd" and (law, options.get("surface")) == ("smc", "pi"):
        return bool(options["equivalent_control"])
    if part == "qd" and law == "joint-impedance":
        return options["damping"] == "velocity-error"
    return not (law in ("fuzzy-pi", "position-servo") and part == "qd")


@pytest.mark.parametrize("law", list(EQUATIONS))
@pytest.mark.parametrize("part", ["q", "qd"])
def test_torque_pushes_against_the_error(law: str, part: str) -> None:
    """From rest at the wanted position, asking for more position or speed raises the torque, for less lowers it."""
    here = Case(pendulum(), pendulum_terms, np.array([0.3]), np.zeros(1), Reference(np.array([0.3]), *np.zeros((2, 1))))
    for options in forms(law):
        base = call(law, here, options)[0][0]
        for change in (0.02, -0.02):
            moved = here._replace(ref=here.ref._replace(**{part: getattr(here.ref, part) + change}))
            push = (call(law, moved, options)[0][0] - base) * change
            assert push > 0.0 if feels(law, options, part) else push == 0.0, options


@pytest.mark.parametrize("law", list(EQUATIONS))
def test_wanted_acceleration_enters_through_the_mass_matrix(law: str) -> None:
    """With a model in the law d tau / d qdd_ref = M; without one the wanted acceleration has no effect."""
    M = TWO_LINK.terms(TWO_LINK.q, TWO_LINK.qd)[0]
    change = np.array([0.3, -0.7])
    more = TWO_LINK._replace(ref=TWO_LINK.ref._replace(qdd=TWO_LINK.ref.qdd + change))
    for options in forms(law):
        uses_model = bool(options.get("equivalent_control", law == "computed-torque"))
        difference = call(law, more, options)[0] - call(law, TWO_LINK, options)[0]
        # an absolute tolerance, because the difference is of torques up to 900 N m, each good to 1e-14 of itself
        assert difference == pytest.approx(M @ change if uses_model else np.zeros(2), abs=2e-11), options


def torque_at(s: float, law: str, options: Options) -> float:
    """Return the pendulum's torque at zero error and sliding variable `s`, gravity left out."""
    at = Case(pendulum(), pendulum_terms, np.zeros(1), np.zeros(1), Reference(np.zeros(1), np.array([s]), np.zeros(1)))
    return float(call(law, at, {"equivalent_control": False, **options})[0][0])


@pytest.mark.parametrize(("law", "slope"), [("smc", 0.0), ("linear-band-smc", 20.0 * 0.5)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_band_is_continuous_at_its_edge(law: str, slope: float, side: float) -> None:
    """At |s| = phi the band gives the full switching torque K = 12 N m, and the torque on both sides meets there."""
    options: Options = {"switching": "saturation"}
    edge, eps = side * 0.3, 1e-9
    at_edge = torque_at(edge, law, options)
    assert at_edge == pytest.approx(side * (12.0 + slope * 0.3), rel=EXACT)
    inside, outside = torque_at(edge - side * eps, law, options), torque_at(edge + side * eps, law, options)
    # the steepest slope there is K/phi + Kd = 50 N m s/rad; a jump would be of the order of K
    assert abs(inside - at_edge) < 60.0 * eps
    assert abs(outside - at_edge) < 60.0 * eps
    assert (at_edge - inside) * side > 0.9 * eps * (40.0 + slope)


@pytest.mark.parametrize(
    ("law", "options"),
    [
        ("smc", {"switching": "sign"}),
        ("linear-band-smc", {"switching": "sign"}),
        ("fuzzy-linear-band-smc", {"band": "sign"}),
    ],
)
def test_sign_laws_jump_at_zero(law: str, options: Options) -> None:
    """Sgn: -K below zero, nothing at zero, +K above: K = 0.3 of 40 N m; all else is 1e-300 times a gain there."""
    assert [torque_at(s, law, options) for s in (-1e-300, 0.0, 1e-300)] == [-12.0, 0.0, 12.0]


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


@pytest.mark.parametrize("surface", ["pi", "pid"])
def test_anti_windup_of_a_surface(surface: str) -> None:
    """As that of PID. The torque is 0.6 (25 e + the wanted acceleration) + 12 sgn(s), and the limit is 40 N m."""
    form: Options = {"surface": surface, "switching": "sign", "equivalent_control": True}
    for e, wanted, torque, moved in ((2.0, 0.0, 42.0, 0.0), (0.2, 0.0, 15.0, 0.2), (-0.1, 100.0, 46.5, -0.1)):
        for side in (1.0, -1.0):
            ref = Reference(*(side * np.array([x]) for x in (e, 0.0, wanted)))
            case = Case(pendulum(gravity=0.0), pendulum_terms, np.zeros(1), np.zeros(1), ref)
            tau, memory = call("smc", case, form, np.zeros(1))
            assert tau[0] == pytest.approx(side * torque, rel=1e-12)
            assert memory.integral[0] == pytest.approx(T * side * moved, rel=1e-12)


@pytest.mark.parametrize("law", list(EQUATIONS))
def test_memory_starts_at_zero_and_is_the_only_state(law: str) -> None:
    """New memory is all zero, one array per joint; two first calls give the same torque, whatever ran in between."""
    memory = find_law(law).new_memory(2)
    assert all(not np.any(array) for array in memory)
    for options in forms(law):
        first = call(law, TWO_LINK, options)[0]
        call(law, PENDULUM, options)
        assert np.array_equal(first, call(law, TWO_LINK, options)[0]), options
