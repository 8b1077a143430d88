"""Looks of controllers: told apart by every eye, on white and on a dark page, and a law keeps its hue."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.report.figures.colour_vision import SIGHT, XYZ, difference, lab, linear
from torquebench.report.looks import HUES, SERIES, looks
from torquebench.results import load_experiment

APART = 10.0
"""Least CIEDE2000 difference: about ten times what can just be seen side by side, as lines are thin and apart."""
FAMILIES = [f"law-{k}" for k in range(7)]
EXPERIMENTS = {
    "one law": {"a": "smc", "b": "smc"},
    "five of one law": {name: "smc" for name in "abcde"},
    "seven laws": {law: law for law in FAMILIES},
    "nine on a page": {
        **{"conventional": "smc", "band": "smc", "a": "linear-band-smc", "b": "computed-torque", "c": "pd-gravity"},
        **{"d": "pid", "e": "super-twisting", "f": "integral-smc", "g": "lqr"},
    },
    "the paper's three": {"a": "smc", "b": "linear-band-smc", "c": "fuzzy-linear-band-smc"},
    **{
        name: load_experiment(name).laws
        for name in ("fig9-chattering", "fig10-step", "fig11-noise", "families", "baselines", "scenarios", "fuzzy")
    },
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_no_two_controllers_look_alike(name: str) -> None:
    """Every colour occurs once, and any two differ by 12 in CIELAB (CIE76), five times what can just be seen."""
    found = looks(EXPERIMENTS[name])
    assert list(found) == list(EXPERIMENTS[name])
    assert len({look.colour for look in found.values()}) == len(found)
    for one, two in itertools.combinations(found.values(), 2):
        assert np.linalg.norm(lab(one.colour) - lab(two.colour)) >= 12.0, (one, two)


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize("sight", SIGHT)
def test_colour_blind_readers_have_a_second_sign(name: str, sight: str) -> None:
    """Two controllers that are close to a colour-blind eye (CIE76 below 11) have different dashes."""
    for one, two in itertools.combinations(looks(EXPERIMENTS[name]).values(), 2):
        near = np.linalg.norm(lab(one.colour, sight) - lab(two.colour, sight)) < 11.0
        assert not near or one.dash != two.dash, (one, two)


def test_a_law_keeps_its_hue() -> None:
    """Whatever else is compared and in whatever order, a known law alone has its own colour, and any keeps its own."""
    alone = {law: looks({"x": law})["x"] for law in HUES}
    assert {law: look.colour for law, look in alone.items()} == HUES
    for order in itertools.permutations(["smc", "pid", "zeta", "alpha"]):
        found = looks({f"a {law}": law for law in order})
        assert found["a smc"] == alone["smc"]
        assert found["a pid"] == alone["pid"]
        assert found == looks({f"a {law}": law for law in sorted(order)})
    assert looks({"a": "smc", "b": "pid"})["a"] == looks({"b": "pd", "a": "smc", "c": "pd"})["a"]


def test_variants_of_a_law_differ_in_lightness_alone() -> None:
    """Five controllers of one law go from dark to light in even steps; thirty still differ in every pair."""
    light = [lab(look.colour)[0] for look in looks({name: "linear-band-smc" for name in "abcde"}).values()]
    assert np.diff(light) == pytest.approx(np.full(4, 10.25), abs=0.5)  # colours have 8 bits
    many = looks({str(k): f"law {k % 9}" for k in range(30)})
    assert len({look.colour for look in many.values()}) == 30


def test_every_controller_is_seen_on_white_and_on_a_dark_page() -> None:
    """Contrast of at least 1.9 with white and with a dark page's #15171C: lines are wider than strokes of letters."""
    for laws in (*EXPERIMENTS.values(), {law: law for law in HUES}):
        for look in looks(laws).values():
            y = float(XYZ[1] @ linear(look.colour))
            dark = float(XYZ[1] @ linear("#15171C"))
            assert min(1.05 / (y + 0.05), (y + 0.05) / (dark + 0.05)) >= 1.9, look


def test_joints_are_no_controllers() -> None:
    """Colours of joints differ by 20 (CIE76) from every law's colour and from one another, to colour-blind eyes too."""
    for one, other in itertools.product(SERIES, HUES.values()):
        assert np.linalg.norm(lab(one) - lab(other)) >= 20.0, (one, other)
    for sight in ("normal", "protanopia", "deuteranopia"):
        for one, other in itertools.combinations(SERIES, 2):
            assert np.linalg.norm(lab(one, sight) - lab(other, sight)) >= 20.0, (one, other)


def test_the_difference_of_colours_is_the_published_one() -> None:
    """Pairs 1, 7, 17 and 25 of Sharma, Wu and Dalal's table."""
    for one, two, wanted in (
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ):
        assert difference(np.array(one), np.array(two)) == pytest.approx(wanted, abs=1e-4)


def test_greys_stay_grey_to_every_eye() -> None:
    """The rows of each matrix add up to 1."""
    for matrix in SIGHT.values():
        assert matrix.sum(axis=1) == pytest.approx(1.0, abs=2e-6)


def closest(colours: tuple[str, ...], sight: str) -> tuple[float, str, str]:
    """Return the least difference of two colours, and which they are."""
    return min((difference(lab(a, sight), lab(b, sight)), a, b) for a, b in itertools.combinations(colours, 2))


@pytest.mark.parametrize("sight", SIGHT)
def test_the_laws_own_colours_are_told_apart(sight: str) -> None:
    """Any two of the colours, and each from white and from black, which the page and the reference have."""
    assert closest((*HUES.values(), "#FFFFFF", "#000000"), sight)[0] >= APART


def test_the_check_catches_a_bad_palette() -> None:
    """A red and a green of equal lightness are one colour without the green cones."""
    pair = ("#B05A00", "#6E7A00")
    assert closest(pair, "normal")[0] > APART > closest(pair, "deuteranopia")[0]
