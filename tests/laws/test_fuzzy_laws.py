"""The paper's proposed law and the fuzzy controllers against their equations, part by part and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arms import pendulum, pendulum_terms
from tests.fuzzy.independent import exact_output
from tests.laws.calls import CASES, EXACT, INTEGRAL, TWO_LINK, Case, T, call, equivalent, errors, gains_of, sat
from tests.laws.forms import Options, filled
from torquebench.fuzzy import Functions, FuzzySystem, Rule, Variable
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference


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
        pendulum(gravity=0.0),
        pendulum_terms,
        np.zeros(1),
        np.zeros(1),
        Reference(np.array([0.05]), np.array([0.5]), np.zeros(1)),
    )
    options = {"equivalent_control": False}
    fuzzy = call("fuzzy-linear-band-smc", case, options)[0] - call("linear-band-smc", case, options)[0]
    assert fuzzy[0] == pytest.approx(0.2 * 40.0 * 31.0 / 69.0, rel=1e-13)


@pytest.mark.parametrize("case", CASES)
def test_the_parts_of_the_proposed_law(case: Case) -> None:
    """Leaving a part out takes its term away and no other: band, linear term, compensation and integral, by hand.

    At lambda 10, phi 0.3, K = 0.3 tau_max, Kd = 20 Mbar, KF = 0.2 tau_max with ge = 0.2 and gd = 2, KI = 50 Mbar.
    """
    e, de, s = errors(case)
    limit, scale = case.arm.flat.tau_max, case.arm.flat.inertia_scale
    x, y = sat(e / 0.2), sat(de / 2.0)
    rules = np.array([exact_output(*pair) for pair in zip(x, y, strict=True)])
    whole = call("fuzzy-linear-band-smc", case, integral=INTEGRAL)[0]

    def less(**option: str | bool) -> Array:
        return whole - call("fuzzy-linear-band-smc", case, option, INTEGRAL)[0]

    # differences of torques up to 130 N m, each good to 1e-14 of itself
    assert less(band="off") == pytest.approx(0.3 * limit * sat(s / 0.3), abs=1e-11)
    assert less(band="sign") == pytest.approx(0.3 * limit * (sat(s / 0.3) - np.sign(s)), abs=1e-11)
    assert less(linear=False) == pytest.approx(20.0 * scale * s, abs=1e-11)
    assert less(integral=False) == pytest.approx(50.0 * scale * INTEGRAL[: case.n], abs=1e-11)
    assert less(compensation="off") == pytest.approx(0.2 * limit * rules, abs=1e-11)
    assert less(compensation="clipped-sum") == pytest.approx(0.2 * limit * (rules - sat(x + y)), abs=1e-11)
    assert less(equivalent_control=False) == pytest.approx(equivalent(case), abs=1e-11)


def test_nothing_is_left_when_every_part_is_out() -> None:
    """Without band, linear term, compensation, integral and model the law asks for no torque, and s is still kept."""
    nothing: Options = {
        "equivalent_control": False,
        "compensation": "off",
        "integral": False,
        "band": "off",
        "linear": False,
    }
    tau, memory = call("fuzzy-linear-band-smc", TWO_LINK, nothing, INTEGRAL)
    assert tau.tolist() == [0.0, 0.0]
    assert memory.s == pytest.approx(errors(TWO_LINK)[2], rel=EXACT)
    assert np.array_equal(memory.integral, INTEGRAL)


FUZZY_POINT = Case(
    pendulum(),
    pendulum_terms,
    np.array([0.2]),
    np.array([0.1]),
    Reference(np.array([0.25]), np.array([0.6]), np.ones(1)),
)
"""E = 0.05 and de = 0.5: with ge = 0.2 and gd = 2 both inputs are 1/4, where FIS = 31/69 (see above)."""


def test_the_fuzzy_controllers_by_hand() -> None:
    """KF = 0.2 of 40 N m. FIS(1/4, 1/4) = 31/69 and FIS(1/4, 0) = 9/38; gi is 0.1 rad s.

    At (1/4, 0) Z and PS of the error hold to 1/4 and 3/4, and Z of the other input wholly: areas 7/16 and 15/16 about 0
    and 1/3 that share 3/16 about 1/6, so (15 - 3/2) / (7 + 15 - 3) / 3 = 9/38.
    """
    kf = 0.2 * 40.0
    both, one = 31.0 / 69.0, 9.0 / 38.0
    assert call("fuzzy-pd", FUZZY_POINT)[0][0] == pytest.approx(kf * both, rel=1e-13)
    for integral, second in ((0.0, one), (0.025, both)):
        start = np.array([integral])
        tau, memory = call("fuzzy-pi", FUZZY_POINT, integral=start)
        assert tau[0] == pytest.approx(kf * second, rel=1e-13)
        assert memory.integral[0] == pytest.approx(integral + T * 0.05, rel=1e-13)
        tau, memory = call("fuzzy-pid", FUZZY_POINT, integral=start)
        assert tau[0] == pytest.approx(0.5 * kf * (both + second), rel=1e-13)
        assert memory.integral[0] == pytest.approx(integral + T * 0.05, rel=1e-13)


@pytest.mark.parametrize("law", ["fuzzy-pi", "fuzzy-pid"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_fuzzy_integral_stops_at_its_scale(law: str, side: float) -> None:
    """Beyond gi the fuzzy system sees no more of it: the integral waits there, and comes back with the error."""

    def moved(e: float, start: float) -> float:
        ref = Reference(np.array([0.2 + e]), np.array([0.1]), np.zeros(1))
        return float(call(law, FUZZY_POINT._replace(ref=ref), integral=np.array([start]))[1].integral[0] - start)

    assert moved(side * 0.05, side * 0.1) == 0.0
    assert moved(side * 0.05, side * 0.2) == 0.0
    assert moved(side * 0.05, side * 0.0999) == pytest.approx(side * T * 0.05, rel=1e-9)
    assert moved(side * -0.05, side * 0.2) == pytest.approx(side * T * -0.05, rel=1e-9)


@pytest.mark.parametrize("law", ["fuzzy-pd", "fuzzy-pi", "fuzzy-pid"])
@pytest.mark.parametrize(("system", "peaks"), [("pd-49", 7), ("pd-25", 5), ("pd-9", 3)])
def test_the_fuzzy_controllers_with_any_number_of_rules(law: str, system: str, peaks: int) -> None:
    """With 49, 25 and 9 rules: the torque is KF times what the independent inference gives on that many triangles."""

    def fis(x: float, y: float) -> float:
        return exact_output(x, y, np.linspace(-1.0, 1.0, peaks))

    e, de, _ = errors(TWO_LINK)
    start = np.array([0.02, -0.07])
    found = find_law(law)
    gains = found.pack_gains(2, gains_of(law, {}), {}, system)
    tau, memory = np.zeros(2), filled(law, 2, {"integral": start})
    found.function(gains, TWO_LINK.arm.flat, 0.0, TWO_LINK.q, TWO_LINK.qd, TWO_LINK.ref, memory, tau)
    x, y, z = e / 0.2, de / 2.0, start / 0.1
    rate = np.array([fis(*pair) for pair in zip(x, y, strict=True)])
    total = np.array([fis(*pair) for pair in zip(x, z, strict=True)])
    wanted = {"fuzzy-pd": rate, "fuzzy-pi": total, "fuzzy-pid": 0.5 * (rate + total)}[law]
    assert tau == pytest.approx(0.2 * TWO_LINK.arm.flat.tau_max * wanted, rel=EXACT)


def test_the_fuzzy_controllers_with_sugenos_method() -> None:
    """Rules whose consequents are functions: with constant terms everywhere FIS(x, y) = 0.1 + 0.5 x - 0.3 y."""
    everywhere = Variable.of({"all": (-1.0, -1.0, 1.0, 1.0)})
    system = FuzzySystem(
        "plane", (everywhere, everywhere), Functions.of({"f": (0.1, 0.5, -0.3)}), (Rule(("all", "all"), "f"),)
    )
    e, de, _ = errors(TWO_LINK)
    found = find_law("fuzzy-pd")
    tau = np.zeros(2)
    gains = found.pack_gains(2, gains_of("fuzzy-pd", {}), {}, system)
    found.function(gains, TWO_LINK.arm.flat, 0.0, TWO_LINK.q, TWO_LINK.qd, TWO_LINK.ref, found.new_memory(2), tau)
    plane = 0.1 + 0.5 * sat(e / 0.2) - 0.3 * sat(de / 2.0)
    assert tau == pytest.approx(0.2 * TWO_LINK.arm.flat.tau_max * plane, rel=EXACT)


def test_the_first_input_is_the_error_and_the_second_its_rate() -> None:
    """With a system that is not symmetric in its inputs: FIS(lambda e/gd, de/gd), not the reverse."""
    first, second = Variable.of({"N": -1.0, "P": 1.0}), Variable.of({"all": (-1.0, -1.0, 1.0, 1.0)})
    rules = (Rule(("N", "all"), "a"), Rule(("P", "all"), "b"))
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
