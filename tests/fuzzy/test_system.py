"""Definitions: what shapes stand for, what the built-in systems are, and every reason to refuse one."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from typing import Any, get_args

import numpy as np
import pytest

from torquebench.errors import ControllerError, FuzzyError
from torquebench.fuzzy import Bell, Functions, FuzzySystem, Gaussian, Rule, Sigmoid, Variable, builtin_system, prepare
from torquebench.fuzzy.fis import STAIRCASE
from torquebench.fuzzy.inference import fill_memberships
from torquebench.fuzzy.system import CONJUNCTIONS, DEFUZZIFICATIONS, rules_of_table
from torquebench.fuzzy.table import degrees

BASE = builtin_system("pd-9")


def test_a_peak_reaches_to_its_neighbours() -> None:
    """Feet lie under the neighbours' peaks or shoulders; a triangle at the end is symmetric."""
    terms = Variable.of({"A": -1.0, "B": 0.0, "C": (0.0, 0.5, 0.7, 1.0), "D": 2.0}, -1.0, 2.0).terms
    assert [term.corners for term in terms] == [
        (-2.0, -1.0, -1.0, 0.0),
        (-1.0, 0.0, 0.0, 0.5),
        (0.0, 0.5, 0.7, 1.0),
        (0.7, 2.0, 2.0, 3.3),
    ]
    assert [term.peak for term in terms] == [-1.0, 0.0, 0.6, 2.0]


def test_corners_are_normalised() -> None:
    """The range becomes [-1, 1]."""
    variable = Variable.of({"A": 1.0, "B": 3.0}, 1.0, 5.0)
    assert variable.corners().tolist() == [[-2.0, -1.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]]
    assert (variable.middle, variable.half) == (3.0, 2.0)


def test_membership_is_scikit_fuzzys() -> None:
    """Triangles, trapezoids and vertical sides have the degrees that `trimf` and `trapmf` give them."""
    variable = Variable.of(
        {
            "wall": (-2.0, -2.0, -1.0, -0.5),
            "ramp": (-1.0, -1.0, 0.0),
            "roof": (-0.5, 0.2, 0.9),
            "flat": (0.1, 0.4, 0.6, 0.6),
            "edge": (0.6, 2.0, 2.0),
        },
        -2.0,
        2.0,
    )
    x = np.append(np.linspace(-2.0, 2.0, 801), variable.corners().ravel() * 2.0)
    got = np.empty((len(x), 5))
    fill_memberships(variable.rows(), x / 2.0, got)
    assert got == pytest.approx(degrees(variable, x), abs=1e-12)
    assert set(np.unique(got[[0, 800]])) <= {0.0, 1.0}


@pytest.mark.parametrize(("name", "terms"), [("pd-49", 7), ("pd-25", 5), ("pd-9", 3)])
def test_built_in_systems(name: str, terms: int) -> None:
    """Terms are even from -1 to 1 for inputs and output, rule (i, j) -> i + j, end triangles are whole."""
    system = builtin_system(name)
    k = np.arange(terms)
    assert system.table.tolist() == np.clip(k[:, None] + k - (terms - 1) // 2, 0, terms - 1).tolist()
    assert len(system.rules) == terms * terms
    half = 2.0 / (terms - 1)
    wanted = np.linspace(-1.0, 1.0, terms)[:, None] + half * np.array([-1.0, 0.0, 0.0, 1.0])
    assert isinstance(system.output, Variable)
    for variable in (*system.inputs, system.output):
        assert variable.corners() == pytest.approx(wanted, abs=1e-15)
    assert system.output.corners()[-1, -1] == pytest.approx(1.0 + half)  # 4/3 for seven terms
    assert prepare(system).fis.method == STAIRCASE


def test_seven_rules_of_one_input() -> None:
    """s-7 has the rules i -> i, which are those of pd-49 where the second input is zero; points by hand.

    At 1/12 Z holds to 3/4 and PS to 1/4: clipped triangles about 0 and 1 third with areas 15/16 and 7/16 share 3/16
    about 1/2, (7 - 3/2) / (15 + 7 - 3) / 3 = 11/114. Half-way between two peaks the two sets balance.
    """
    system = builtin_system("s-7")
    assert system.rules == tuple(Rule((name,), name) for name in system.inputs[0].names)
    assert len(system.rules) == 7
    prepared, x = prepare(system), np.linspace(-1.2, 1.2, 481)
    assert prepared.outputs(np.array([1.0 / 12.0, 1.0 / 6.0]), np.zeros(2)) == pytest.approx(
        [11 / 114, 1 / 6], abs=1e-15
    )
    assert prepared.outputs(x, np.array(0.7)) == pytest.approx(
        prepare(builtin_system("pd-49")).outputs(x, np.array(0.0)), abs=1e-15
    )


def test_unknown_built_in_system() -> None:
    """The message names the nearest one."""
    with pytest.raises(ControllerError, match=r"unknown fuzzy system 'pd-94' \(did you mean 'pd-9'\?\)"):
        builtin_system("pd-94")


def test_units_do_not_matter() -> None:
    """The same system on [-2, 2], as in the paper's Fig 7, or with one input in mrad, gives the same law."""
    wide = Variable.of({"N": -2.0, "Z": 0.0, "P": 2.0}, -2.0, 2.0)
    small = Variable.of({"N": 0.0, "Z": 5e-3, "P": 1e-2}, 0.0, 1e-2)
    other = FuzzySystem("other", (wide, small), wide, BASE.rules)
    x, y = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 500))
    assert prepare(other).fis.method == STAIRCASE
    assert prepare(other).outputs(x, y) == pytest.approx(prepare(BASE).outputs(x, y), abs=1e-12)


def test_what_lies_beyond_the_range_of_an_input_does_not_matter() -> None:
    """Shoulders and triangles at the ends of an input are the same, and both are exact."""
    shoulders = Variable.of({"N": (-9.0, -3.0, -1.0, 0.0), "Z": (-1.0, 0.0, 1.0), "P": (0.0, 1.0, 1.0)})
    system = replace(BASE, name="shoulders", inputs=(shoulders, shoulders))
    x, y = np.random.default_rng(0).uniform(-1.2, 1.2, (2, 500))
    assert prepare(system).fis.method == STAIRCASE
    assert np.array_equal(prepare(system).outputs(x, y), prepare(BASE).outputs(x, y))


def test_a_definition_cannot_be_changed() -> None:
    """Systems are keys of the store of prepared ones."""
    with pytest.raises(FrozenInstanceError):
        BASE.conjunction = "product"  # type: ignore[misc]
    assert hash(BASE) == hash(replace(BASE))


def make(**changes: Any) -> FuzzySystem:
    """Return the nine rules with changes."""
    return replace(BASE, **changes)


V = BASE.inputs[0]
BAD = {
    "three inputs": ({"inputs": (V, V, V)}, ("inputs",), "got 3 inputs, wanted 1 or 2"),
    "conjunction": ({"conjunction": "mini"}, ("conjunction",), "did you mean 'min'"),
    "aggregation": ({"aggregation": "max-mn"}, ("aggregation",), "did you mean 'max-min'"),
    "defuzzification": ({"defuzzification": "coo"}, ("defuzzification",), "wanted one of coa, cog"),
    "range": ({"output": replace(V, low=1.0)}, ("output", "range"), "got [1, 1]"),
    "infinite range": ({"inputs": (replace(V, high=np.inf), V)}, ("inputs", 0, "range"), "two finite numbers"),
    "endless range": ({"output": replace(V, low=-1.7e308, high=1.7e308)}, ("output", "range"), "two finite numbers"),
    "far": ({"inputs": (V, Variable.of({"N": -1.0, "Z": 0.0, "P": 3e6}))}, ("inputs", 1, "terms", "P"), "the range"),
    "thin curve": ({"inputs": (V, Variable.of({"N": Gaussian(0.0, 1e-7)}))}, ("inputs", 1, "terms", "N"), "narrower"),
    "far curve": ({"inputs": (V, Variable.of({"N": Gaussian(3e6, 1.0)}))}, ("inputs", 1, "terms", "N"), "beyond"),
    "twice": ({"inputs": (V, replace(V, terms=(V.terms[0], *V.terms)))}, ("inputs", 1, "terms", "N"), "given twice"),
    "no rule": ({"rules": ()}, ("rules",), "there is no rule"),
    "antecedent": ({"rules": (Rule(("N", "Q"), "P"),)}, ("rules", 0), "unknown term 'Q' of input 2"),
    "consequent": ({"rules": (Rule(("N", "P"), "PP"),)}, ("rules", 0), "'PP' (did you mean 'P'?)"),
    "long rule": ({"rules": (Rule(("N", "Z", "P"), "P"),)}, ("rules", 0), "names 3 terms after 'if'"),
    "empty rule": ({"rules": (Rule((), "P"),)}, ("rules", 0), "names 0 terms after 'if'"),
    "open or": ({"rules": (Rule(("N",), "P", either=True),)}, ("rules", 0), "'or' wants a term of each of two inputs"),
    "function": (
        {"output": Functions.of({"N": (1.0, 2.0), "Z": 0.0, "P": 1.0})},
        ("output", "functions", "N"),
        "wanted one, or 3",
    ),
    "name": (
        {"output": Functions.of({"N": 1.0, "Z": 0.0, "P": 1.0, "a b": 2.0})},
        ("output", "functions", "a b"),
        "letters",
    ),
    "idle": (
        {"rules": (Rule(("N", "Z"), "P"),), "inputs": (Variable.of({"N": (1.0, 1.5, 2.0)}), V)},
        ("rules",),
        "no rule ever fires",
    ),
    "spikes": (
        {"aggregation": "max-drastic-product", "output": Variable.of({"N": -1.0, "Z": 0.0012, "P": 1.0})},
        ("output", "terms", "Z"),
        "move it to",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_has_no_meaning_is_refused(what: str) -> None:
    """Each mistake is refused by one finding with its place, in the definition's own words."""
    changes, where, message = BAD[what]
    with pytest.raises(FuzzyError) as caught:
        make(**changes)
    findings = [f for f in caught.value.findings if f.where == where]
    assert len(findings) == 1, caught.value.findings
    assert message in findings[0].message
    assert findings[0].severity == "error"
    assert str(caught.value).startswith("fuzzy system 'pd-9': error: ")


SHAPES = {
    "none": ({}, ("terms",), "got 0 terms, wanted 1 to 25"),
    "many": ({f"t{k}": float(k) for k in range(26)}, ("terms",), "got 26 terms"),
    "lone peak": ({"A": 0.0}, ("terms", "A"), "no neighbours"),
    "two": ({"A": (0.0, 1.0)}, ("terms", "A"), "got 2 numbers"),
    "descending": ({"A": (0.0, 2.0, 1.0)}, ("terms", "A"), "in ascending order"),
    "width": ({"A": (1.0, 1.0, 1.0)}, ("terms", "A"), "no width"),
    "order": ({"A": 1.0, "B": 0.0}, ("terms", "B"), "from low to high"),
    "same": ({"A": 1.0, "B": 1.0}, ("terms", "B"), "from low to high"),
    "nan": ({"A": float("nan"), "B": 1.0}, ("terms", "A"), "finite"),
    "infinite": ({"A": (0.0, 1.0, float("inf")), "B": 1.0}, ("terms", "A"), "finite"),
    "reserved": ({"none": 0.0, "B": 1.0}, ("terms", "none"), "missing rule"),
    "any": ({"any": 0.0, "B": 1.0}, ("terms", "any"), "leaves the input open"),
    "no sigma": ({"A": Gaussian(0.0, 0.0)}, ("terms", "A"), "its sigma is 0, wanted more than 0"),
    "endless": ({"A": Gaussian(math.inf, 1.0)}, ("terms", "A"), "its mean is inf, wanted a finite number"),
    "slow bell": ({"A": Bell(0.0, 1.0, 0.01)}, ("terms", "A"), "its slope is 0.01, wanted at least 0.1"),
    "level": ({"A": Sigmoid(0.0, 0.0)}, ("terms", "A"), "its slope is 0, wanted more than 0 for a term that rises"),
    "curves": ({"A": Gaussian(1.0, 1.0), "B": Bell(0.5, 1.0, 1.0)}, ("terms", "B"), "its peak, 0.5, is not above"),
    "spaces": ({"very big": 0.0, "B": 1.0}, ("terms", "very big"), "letters"),
}


@pytest.mark.parametrize("what", SHAPES)
def test_shapes_that_are_refused(what: str) -> None:
    """Each mistake in a shape is one finding at the term."""
    shapes, where, message = SHAPES[what]
    with pytest.raises(FuzzyError) as caught:
        Variable.of(shapes)
    assert [f.where for f in caught.value.findings] == [where]
    assert message in caught.value.findings[0].message


def test_every_mistake_is_reported_at_once() -> None:
    """Three mistakes, three findings."""
    with pytest.raises(FuzzyError) as caught:
        make(conjunction="or", aggregation="sum", output=replace(V, high=-2.0))
    assert [f.where for f in caught.value.findings] == [("conjunction",), ("aggregation",), ("output", "range")]


def test_a_table_must_have_the_size_of_its_terms() -> None:
    """One row for each term of input 1, one column for each of input 2; none leaves a rule out."""
    rules = rules_of_table([("a", "b"), ("c", "d")], [["x", "none"], ["y", "z"]])
    assert rules == (Rule(("a", "c"), "x"), Rule(("b", "c"), "y"), Rule(("b", "d"), "z"))
    for rows in ([["x", "y"]], [["x"], ["y", "z"]], [["x", "y"], ["z"]]):
        with pytest.raises(ValueError, match="not one of 2 by 2"):
            rules_of_table([("a", "b"), ("c", "d")], rows)


def test_drastic_products_need_peaks_on_points() -> None:
    """The place a message proposes is accepted."""
    shapes: dict[str, Any] = {"N": (-2.0, -1.0, 0.0), "Z": (-1.0, 0.0012, 1.0), "P": (0.0, 1.0, 2.0)}
    with pytest.raises(FuzzyError) as caught:
        make(aggregation="max-drastic-product", output=Variable.of(shapes))
    proposed = float(caught.value.findings[0].message.partition("move it to ")[2].partition(",")[0])
    make(aggregation="max-drastic-product", output=Variable.of({**shapes, "Z": (-1.0, proposed, 1.0)}))
    assert abs(proposed) < 1.0 / 90.0  # the points' distance


def test_operators_are_those_of_the_schema() -> None:
    """What a config accepts is what a system accepts."""
    from torquebench.experiment.fuzzy_schema import MamdaniSystem
    from torquebench.fuzzy.system import AGGREGATIONS
    from torquebench.keys import declared_keys

    keys = {declared.name: get_args(declared.type) for declared in declared_keys(MamdaniSystem)}
    assert keys["conjunction"] == CONJUNCTIONS
    assert keys["aggregation"] == tuple(AGGREGATIONS)
    assert keys["defuzzification"] == DEFUZZIFICATIONS


LAZY = """
import sys
from torquebench.fuzzy import builtin_system, prepare
from torquebench.fuzzy.lint import lint
import torquebench.laws, torquebench.experiment.build
lint(prepare(builtin_system("pd-49")))
print("skfuzzy" in sys.modules)
"""


def test_scikit_fuzzy_is_loaded_only_for_tables() -> None:
    """Laws, configs and exact systems do without it."""
    done = subprocess.run([sys.executable, "-c", LAZY], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.split() == ["False"]
