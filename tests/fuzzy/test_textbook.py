"""Textbook systems: curved terms, rules with OR or an input left open, beside scikit-fuzzy and an integral by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skfuzzy

from torquebench.experiment import load_systems
from torquebench.fuzzy import (
    Bell,
    Functions,
    FuzzySystem,
    Gaussian,
    Rule,
    Sigmoid,
    Variable,
    builtin_system,
    infer,
    prepare,
)
from torquebench.fuzzy.fis import SUGENO, TABLE
from torquebench.fuzzy.inference import fill_activations, fill_memberships
from torquebench.fuzzy.lint import lint
from torquebench.fuzzy.oracle import compare
from torquebench.fuzzy.table import defined_outputs
from torquebench.kernel import Array
from torquebench.robot.library import data_root

TIP = """\
fuzzy:
  tip:
    kind: mamdani
    inputs: # food, service
      - {range: [0, 10], terms: {poor: [0, 0, 5], ok: [0, 5, 10], good: [5, 10, 10]}}
      - {range: [0, 10], terms: {poor: [0, 0, 5], ok: [0, 5, 10], good: [5, 10, 10]}}
    output: {range: [0, 25], terms: {low: [0, 0, 13], medium: [0, 13, 25], high: [13, 25, 25]}}
    rules:
      - {if: [poor, any], then: low}
      - {if: [any, poor], then: low}
      - {if: [any, ok], then: medium}
      - {if: good, then: high}
      - {if: [any, good], then: high}
"""
TIPPER = """\
fuzzy:
  tipper:
    kind: mamdani
    inputs: # service, food
      - range: [0, 10]
        terms:
          poor: {kind: gaussian, mean: 0, sigma: 1.5}
          good: {kind: gaussian, mean: 5, sigma: 1.5}
          excellent: {kind: gaussian, mean: 10, sigma: 1.5}
      - {range: [0, 10], terms: {rancid: [0, 0, 1, 3], delicious: [7, 9, 10, 10]}}
    output: {range: [0, 30], terms: {cheap: [0, 5, 10], average: [10, 15, 20], generous: [20, 25, 30]}}
    rules:
      - {if: [poor, or, rancid], then: cheap}
      - {if: good, then: average}
      - {if: [excellent, or, delicious], then: generous}
"""
CURVES = {
    "left": Sigmoid(-0.6, -9.0),
    "bell": Bell(-0.2, 0.25, 2.5),
    "peak": Gaussian(0.3, 0.2),
    "flat": (0.2, 0.5, 0.6, 0.9),
    "right": Sigmoid(0.7, 11.0),
}


def written(folder: Path, text: str) -> FuzzySystem:
    """Return the only system of a file with some text."""
    (folder / "tip.yaml").write_text(text)
    systems = load_systems(folder / "tip.yaml")
    assert systems is not None
    (system,) = systems.values()
    return system


def tri(x: Any, a: float, b: float, c: float) -> Any:
    """Return the membership in a triangle, upright sides included."""
    rises = np.where(x >= a, 1.0, 0.0) if a == b else (np.asarray(x) - a) / (b - a)
    falls = np.where(x <= c, 1.0, 0.0) if b == c else (c - np.asarray(x)) / (c - b)
    return np.clip(np.minimum(rises, falls), 0.0, 1.0)


def centroid(heights: Sequence[float], terms: Sequence[Callable[[Array], Array]], u: Array) -> float:
    """Return the centre of the clipped and joined terms by the midpoint rule on points u."""
    mu = np.max([np.minimum(h, term(u)) for h, term in zip(heights, terms, strict=True)], axis=0)
    return float(np.sum(mu * u) / np.sum(mu))


@pytest.mark.parametrize(
    ("food", "service", "known"), [(6.5, 9.8, 19.858), (0, 0, 13 / 3), (10, 10, 21), (5, 5, 38 / 3), (3.3, 7.1, None)]
)
def test_the_classroom_tip(food: float, service: float, known: float | None, tmp_path: Path) -> None:
    """The tip is the centre of the clipped triangles: of their integral at 10^5 points, and what hands work out.

    Of 361 points corners are cut off, which is 5e-5 of a range of 25 here.
    """
    system = written(tmp_path, TIP)
    prepared = prepare(system)
    low, ok, good = (lambda x, k=k: tri(x, *((0, 0, 5), (0, 5, 10), (5, 10, 10))[k]) for k in range(3))
    heights = [max(low(food), low(service)), ok(service), max(good(food), good(service))]
    u = (np.arange(100_000) + 0.5) * 25 / 100_000
    shapes = ((0, 0, 13), (0, 13, 25), (13, 25, 25))
    wanted = centroid(heights, [lambda x, s=s: tri(x, *s) for s in shapes], u)
    if known is not None:
        assert wanted == pytest.approx(known, abs=5e-4)
    assert prepared.evaluate(food, service) == pytest.approx(wanted, abs=2e-4)
    assert abs(prepared.in_loop(food, service) - wanted) < prepared.bound * 12.5
    joined = written(tmp_path, TIP[: TIP.index("      - {if: [poor")] + JOINED)
    assert defined_outputs(joined, *normalised(food, service)) == defined_outputs(system, *normalised(food, service))


JOINED = """\
      - {if: [poor, or, poor], then: low}
      - {if: [any, ok], then: medium}
      - {if: [good, or, good], then: high}
"""
"""OR, which under max-min is a rule for each of its two terms."""


def normalised(*values: float) -> list[Array]:
    """Return values from 0 to 10 as values from -1 to 1."""
    return [np.array([(value - 5.0) / 5.0]) for value in values]


@pytest.mark.parametrize(("inputs", "tip"), [((1, 2), 5.5586), ((2, 1), 7.0169), ((4, 5), 14.4585), ((7, 8), 20.3414)])
def test_matlabs_tipper(inputs: tuple[float, float], tip: float, tmp_path: Path) -> None:
    """On 101 points the tip is what MATLAB's documentation of evalfis prints; on 361 it is that within 0.02."""
    system = written(tmp_path, TIPPER)
    by_matlab = 15.0 + 15.0 * defined_outputs(system, *normalised(*inputs), points=101)[0]
    assert by_matlab == pytest.approx(tip, abs=5e-5)
    assert prepare(system).evaluate(*inputs) == pytest.approx(tip, abs=0.02)
    assert lint(prepare(system), is_law=False) == ()
    assert f"```yaml\n{TIPPER}```" in (data_root() / "docs" / "fuzzy.md").read_text(encoding="utf-8")


def test_curves_are_scikit_fuzzys() -> None:
    """The degrees are those of `gaussmf`, `gbellmf` and `sigmf` but for rounding, in units of another range too."""
    variable = Variable.of(
        {
            "falls": Sigmoid(12.0, -2.0),
            "g": Gaussian(11.0, 0.7),
            "b": Bell(14.0, 1.5, 3.0),
            "r": Sigmoid(17.0, 1.3),
        },
        10.0,
        20.0,
    )
    x = np.append(np.linspace(10.0, 20.0, 1001), [11.0, 14.0, 17.0])
    got = np.empty((len(x), 4))
    fill_memberships(variable.rows(), (x - 15.0) / 5.0, got)
    wanted = [
        skfuzzy.sigmf(x, 12.0, -2.0),
        skfuzzy.gaussmf(x, 11.0, 0.7),
        skfuzzy.gbellmf(x, 1.5, 3.0, 14.0),
        skfuzzy.sigmf(x, 17.0, 1.3),
    ]
    assert got == pytest.approx(np.column_stack(wanted), abs=1e-13)


SLOW = pytest.mark.slow


def curved(conjunction: str = "min", sugeno: bool = False, **operators: Any) -> FuzzySystem:
    """Return a system with every shape on both sides, open rules and one with OR."""
    variable = Variable.of(CURVES)
    names = variable.names
    rules = [Rule((a,), a) for a in names] + [Rule(("any", b), b) for b in names[1:]]
    rules += [Rule(("left", "right"), "bell"), Rule(("left", "peak"), "flat", either=True)]
    output: Any = variable
    if sugeno:
        output = Functions.of({name: (0.3 * k - 0.6, 0.2, -0.1 * k) for k, name in enumerate(names)})
    return FuzzySystem("curved", (variable, variable), output, tuple(rules), conjunction, **operators)


@pytest.mark.parametrize(
    ("conjunction", "sugeno"),
    [
        ("min", False),
        ("product", True),
        pytest.param("min", True, marks=SLOW),
        pytest.param("product", False, marks=SLOW),
    ],
)
def test_beside_scikit_fuzzy(conjunction: str, sugeno: bool) -> None:
    """Curves, OR and open inputs: the loop's own evaluation is within its bound of what scikit-fuzzy says."""
    prepared = prepare(curved(conjunction, sugeno))
    assert prepared.fis.method == (SUGENO if sugeno else TABLE)
    found = compare(prepared)
    assert found.within
    assert found.difference < (1e-9 if sugeno else 0.02)
    wrong = curved(conjunction, sugeno).rules
    wrong = (*wrong[:-1], wrong[-1]._replace(either=False))
    assert not compare(replace(prepared, system=replace(prepared.system, rules=wrong))).within


@pytest.mark.parametrize("aggregation", ["sum-min", "max-bounded-product", "max-algebraic-sum"])
def test_the_other_operators_beside_scikit_fuzzy(aggregation: str) -> None:
    """OR is one rule with the greater activation: under a sum not two rules."""
    assert compare(prepare(curved(aggregation=aggregation)), (9, 8)).within


@pytest.mark.parametrize("width", [1e-3, 0.02, 0.3])
def test_the_bound_holds_for_narrow_and_wide_curves(width: float) -> None:
    """No term is missed between the nodes of a table, however narrow: 10^4 inputs, a third of them upon it."""
    terms = {"N": Gaussian(-0.5, width), "Z": Bell(0.1, width, 2.0), "P": Sigmoid(0.6, 2.0 / width)}
    variable = Variable.of(terms)
    output = Variable.of({"rest": -1.0, "N": 0.0, "Z": 0.5, "P": 1.0})
    rules = (Rule(("any",), "rest"), *(Rule((name,), name) for name in terms))
    system = FuzzySystem("narrow", (variable,), output, rules)
    prepared = prepare(system)
    random = np.random.default_rng(3)
    x = np.concatenate([random.uniform(-1.0, 1.0, 6000), *(random.normal(c, width, 1500) for c in (-0.5, 0.1, 0.6))])
    x = np.clip(x, -1.0, 1.0)
    gap = float(np.max(np.abs(prepared.outputs(x, x) - defined_outputs(system, x, x))))
    assert 0.0 < gap <= prepared.bound < 0.2


def test_both_paths_give_the_same_bytes() -> None:
    """Compiled and interpreted, curves have the same degrees, and a Sugeno system of them the same output."""
    fis = prepare(curved("product", sugeno=True)).fis
    rows = Variable.of(CURVES).rows(is_open=True)
    x = np.concatenate([np.linspace(-1.0, 1.0, 301), [-0.2, 0.3, 5e-324, -0.0, 0.7, 1e-17]])
    compiled, interpreted = np.empty((2, len(x), len(rows)))
    fill_memberships(rows, x, compiled)
    fill_memberships.py_func(rows, x, interpreted)
    assert compiled.tobytes() == interpreted.tobytes()
    outputs = [[f(fis, a, b) for a in x[::17] for b in x[::19]] for f in (infer, infer.py_func)]
    assert outputs[0] == outputs[1]


def test_what_rules_fire() -> None:
    """Of the rule table with a last row and column for inputs left open, each cell has what its rules fire with."""
    system = curved()
    prepared = prepare(system)
    assert system.columns == ((*CURVES, "any"),) * 2
    fired = np.full(prepared.fis.rules.shape, np.nan)
    fill_activations(prepared.fis, 0.3, -0.2, fired)
    at = {name: k for k, name in enumerate(system.columns[0])}
    assert fired[at["peak"], at["any"]] == 1.0
    assert fired[at["any"], at["bell"]] == 1.0
    left = 1.0 / (1.0 + math.exp(9.0 * 0.9))
    peak = math.exp(-0.5 * (0.5 / 0.2) ** 2)
    assert fired[at["left"], at["peak"]] == pytest.approx(max(left, peak), rel=1e-12)
    assert fired[at["bell"], at["bell"]] == 0.0


def test_lint_knows_open_rules_and_curves() -> None:
    """No rule is missing where an open one fires, a gap counts where the input is asked for, a curve may be thin."""
    base = builtin_system("pd-9")
    rows = tuple(Rule((name,), name) for name in ("N", "Z", "P"))
    assert lint(prepare(replace(base, rules=rows))) == ()
    found = lint(prepare(replace(base, rules=rows[:2])))
    assert {f.code for f in found} == {"missing-rule", "dead-term", "asymmetric"}
    assert sum(f.code == "missing-rule" for f in found) == 3
    (mirror,) = [f.message for f in found if f.code == "asymmetric"]
    assert mirror.endswith("rules without their mirror image: N and any")
    holes = Variable.of({"N": (-1, -1, -0.4), "Z": (-0.1, 0, 0.1), "P": (0.4, 1, 1)})
    assert lint(prepare(replace(base, rules=rows, inputs=(base.inputs[0], holes)))) == ()
    found = lint(prepare(replace(base, rules=rows, inputs=(holes, base.inputs[1]))))
    assert [f.code for f in found if f.code != "asymmetric"] == ["gap", "gap"]
    output = Variable.of({"N": -1.0, "Z": Gaussian(0.0, 0.005), "P": Sigmoid(0.5, 8.0)})
    assert [f.where for f in lint(prepare(replace(base, output=output))) if f.code == "thin-term"] == [
        ("output", "terms", "Z")
    ]
    dead = Variable.of({"N": Gaussian(-0.5, 0.3), "Z": 0.0, "P": Gaussian(9.0, 0.3)})
    found = lint(prepare(replace(base, inputs=(dead, base.inputs[1]))))
    assert ("inputs", 0, "terms", "P") in [f.where for f in found if f.code == "dead-term"]


def test_mistakes_in_a_file_of_systems_come_together(tmp_path: Path) -> None:
    """Each with its place and what was wanted; an unknown curve, a word that is not or, a term that is not there."""
    from torquebench.errors import ConfigError

    text = TIPPER.replace("gaussian, mean: 5, sigma: 1.5", "gausian, mean: 5, sigma: 1.5")
    text = text.replace("mean: 10, sigma: 1.5", "mean: 10, sigma: -1.5").replace(
        "[poor, or, rancid]", "[poor, xor, rancid]"
    )
    with pytest.raises(ConfigError) as refused:
        written(tmp_path, text)
    lines = [str(problem).partition("tip.yaml:")[2] for problem in refused.value.problems]
    assert [line.partition(": ")[0] for line in lines] == ["8:24", "9:56", "13:14"]
    assert "(did you mean 'gaussian'?)" in lines[0]
    assert "wanted more than 0" in lines[1]
    assert "'xor' in the middle" in lines[2]
    with pytest.raises(ConfigError, match=r"unknown term 'goood' of input 1 \(did you mean 'good'\?\)"):
        written(tmp_path, TIPPER.replace("if: good", "if: goood"))
