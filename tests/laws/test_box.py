"""The boxes in which tuning looks for gains: one rule for every law, and what a law may declare."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from tests.experiment.test_schema import shipped_laws
from torquebench import Array, Gain, find_law, load_model
from torquebench.chain import CHAINS
from torquebench.errors import ControllerError
from torquebench.laws.box import DIGITS, Box
from torquebench.laws.declare import declared_fields
from torquebench.laws.law import Law
from torquebench.tuning import BOXES, MULTIPLES

ARM = load_model("two-link")
SET = {"lam": 10.0, "kv": 20.0, "ki": 100.0}


def declare(search: Any, positive: bool = True, unit: str = "1/s") -> Box:
    """Return the box of a law with one gain of 2."""
    kind: Any = NamedTuple("Gains", [("k", Annotated[Array, Gain("gain", unit, positive, search=search)])])
    gains, *others = declared_fields("boxed", kind)
    return Box(Law("boxed", lambda *_: None, kind, None, gains, *others), ARM, given={"k": 2.0})


@pytest.mark.parametrize("law", shipped_laws())
@pytest.mark.parametrize("chain", ["ideal", "slow-delay"])
def test_what_auto_chooses_lies_in_the_box(law: str, chain: str) -> None:
    """Of every shipped law and joint; multiples are of the chosen gains themselves, so that 1 lies inside."""
    for arm in (ARM, load_model("puma560")):
        box = Box(law, arm, chain=CHAINS[chain])
        for side in box.sides:
            values = [1.0] if side.of else np.atleast_1d(box.given[side.gain])
            assert side.low < min(values) <= max(values) < side.high, side


@pytest.mark.parametrize("law", shipped_laws())
def test_gains_at_corners_are_ones_that_the_law_takes(law: str) -> None:
    """Every gain of both corners passes the law's own check, and is written in so many digits as it is run with."""
    box = Box(law, ARM)
    for share in (0.0, 0.5, 1.0):
        gains = box.gains([share] * len(box.sides))
        assert gains.keys() == box.given.keys()
        find_law(law).pack_gains(ARM.n, gains, {})
        for side in box.sides:
            for x in np.atleast_1d(gains[side.gain]):
                assert float(x) == float(f"{x:.{DIGITS}g}")


def test_a_unit_that_means_the_same_everywhere_has_one_number_for_all_joints() -> None:
    """Lambda goes from end to end of the box of 1/s by equal ratios: the middle is the geometric mean of both."""
    box = Box("computed-torque", ARM, given=SET)
    low, high, _ = BOXES["1/s"]
    values = [box.gains([share, 0.5, 0.5])["lam"] for share in (0.0, 0.5, 1.0)]
    assert values == [low, pytest.approx(math.sqrt(low * high), rel=0.5 * 10.0 ** (1 - DIGITS)), high]


def test_other_units_are_multiples_of_what_auto_chooses_beside_the_other_gains() -> None:
    """k_I = multiple x k_V lambda min(k_V, lambda) / 4 with both of the very point, whatever the config has.

    The tolerance is that of the digits: three of the rule, four of the product.
    """
    box = Box("computed-torque", ARM, given=SET)
    for shares, multiple in (((0.3, 0.7, 0.0), MULTIPLES[0]), ((0.6, 0.2, 1.0), MULTIPLES[1])):
        gains = box.gains(shares)
        wanted = multiple * gains["kv"] * gains["lam"] * min(gains["kv"], gains["lam"]) / 4.0
        assert gains["ki"] == pytest.approx(wanted, rel=6e-3)
    stiff = Box("joint-impedance", load_model("puma560"))
    chosen = find_law("joint-impedance").choose_gains(load_model("puma560"))
    for name, x in stiff.gains([1.0, 1.0]).items():
        np.testing.assert_allclose(x, 10.0 * np.array(chosen[name]), rtol=1e-3)


def test_a_gain_without_a_rule_is_looked_for_around_what_it_is() -> None:
    """A user's law says nothing of its unit: multiples of the config's own gain, 0.1 to 10."""
    box = declare(None, unit="not stated")
    assert [box.gains([share])["k"] for share in (0.0, 0.5, 1.0)] == [0.2, 2.0, 20.0]


def test_what_would_be_zero_stays_as_it_is() -> None:
    """Friction that a law does not believe in has no multiples: no dimension is spent on it."""
    names = [side.gain for side in Box("gravity-friction", ARM).sides]
    assert "viscous" not in names
    given = {"kp": 1.0, "kd": 1.0, "viscous": 0.4, "coulomb": 0.2, "speed": 0.02}
    box = Box("gravity-friction", ARM, given=given)
    assert box.gains([0.1] * len(box.sides))["viscous"] == 0.4


def test_a_law_declares_a_box_of_its_own() -> None:
    """Linear spacing goes by equal differences, and may begin at zero where zero is a gain."""
    box = declare((0.0, 8.0, "linear"), positive=False)
    assert [box.gains([share])["k"] for share in (0.0, 0.25, 1.0)] == [0.0, 2.0, 8.0]


@pytest.mark.parametrize(
    ("search", "positive"),
    [
        ((2.0, 1.0, "log"), True),
        ((0.0, 1.0, "log"), False),
        ((0.0, 1.0, "linear"), True),
        ((-1.0, 1.0, "linear"), False),
        ((1.0, math.inf, "log"), True),
        ((math.nan, 1.0, "linear"), False),
        ((1.0, 2.0, "logarithmic"), True),
        ((1.0, 2.0), True),
        (("1", 2.0, "log"), True),
        (3.0, True),
    ],
)
def test_a_box_that_is_none_is_refused_when_the_law_is_declared(search: Any, positive: bool) -> None:
    """The message names law, gain, what was given and what is wanted."""
    with pytest.raises(ControllerError, match=r"law 'boxed': search of gain 'k' is .*, wanted \(low, high"):
        declare(search, positive)
