"""Sugeno's method against the weighted mean worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from torquebench.fuzzy import Functions, FuzzySystem, Prepared, Rule, Variable, prepare
from torquebench.fuzzy.system import rules_of_table

EXACT = 1e-14
E = Variable.of({"N": -2.0, "Z": 0.0, "P": 2.0}, -2.0, 2.0)
DE = Variable.of({"slow": (-6.0, -6.0, -3.0, 3.0), "fast": (-3.0, 3.0, 6.0, 6.0)}, -6.0, 6.0)


def system(functions: dict[str, float | tuple[float, ...]], conjunction: str = "min", **more: float) -> Prepared:
    """Return three by two rules with consequents A, B, C, A, B, C."""
    rules = rules_of_table([E.names, DE.names], [["A", "B"], ["C", "A"], ["B", "C"]])
    return prepare(FuzzySystem("s", (E, DE), Functions.of(functions, **more), rules, conjunction))


def at(prepared: Prepared, e: float, de: float) -> float:
    """Return the output for inputs in their own units."""
    return float(prepared.outputs(np.array(e / 2.0), np.array(de / 6.0)))


@pytest.mark.parametrize(
    ("conjunction", "weights"),
    [
        # e = 0.5: Z 3/4, P 1/4; de = 1.5: slow 1/4, fast 3/4
        ("min", (0.25, 0.75, 0.25, 0.25)),
        ("product", (3 / 16, 9 / 16, 1 / 16, 3 / 16)),
    ],
)
def test_constants(conjunction: str, weights: tuple[float, ...]) -> None:
    """Z-slow C, Z-fast A, P-slow B, P-fast C: the mean of 30, 10, 20, 30 with the weights of the rules, in range 40."""
    prepared = system({"A": 10.0, "B": 20.0, "C": 30.0}, conjunction, low=-40.0, high=40.0)
    c, a, b, d = weights
    wanted = (30.0 * (c + d) + 10.0 * a + 20.0 * b) / (a + b + c + d) / 40.0
    assert at(prepared, 0.5, 1.5) == pytest.approx(wanted, rel=EXACT)
    assert prepared.bound == 0.0
    assert at(prepared, 0.0, -5.0) == pytest.approx(0.75, rel=EXACT)  # Z-slow alone: C


def test_functions_of_the_inputs() -> None:
    """0.3 e + 0.6 de (132) in the inputs' own units, alone where one rule fires, averaged where two do."""
    prepared = system({"A": (0.0, 0.3, 0.6), "B": (1.0, -1.0, 0.0), "C": -2.0}, low=-8.0, high=4.0)
    # the law's 0 is the middle of the range, -2, its 1 is 4, six away
    assert at(prepared, -2.0, -4.0) == pytest.approx((0.3 * -2.0 + 0.6 * -4.0 + 2.0) / 6.0, rel=EXACT)  # N-slow: A
    assert at(prepared, -2.0, 5.0) == pytest.approx((1.0 + 2.0 + 2.0) / 6.0, rel=EXACT)  # N-fast: B
    # e = -1: N and Z at 1/2; de = 5: fast: B and A
    mean = 0.5 * (1.0 + 1.0) + 0.5 * (0.3 * -1.0 + 0.6 * 5.0)
    assert at(prepared, -1.0, 5.0) == pytest.approx((mean + 2.0) / 6.0, rel=EXACT)


def test_ranges_need_not_be_about_zero() -> None:
    """An input from 10 to 30 and one from -1 to 5 enter the functions as what they are, not as what the law sees."""
    first, second = (
        Variable.of({"each": (0.0, 10.0, 30.0, 40.0)}, 10.0, 30.0),
        Variable.of({"all": (-9, -1, 5, 9)}, -1, 5),
    )
    functions = Functions.of({"f": (7.0, 0.5, -2.0)}, -10.0, 30.0)
    prepared = prepare(FuzzySystem("far", (first, second), functions, (Rule(("each", "all"), "f"),)))
    # the law's 0.4 and -0.5 are 24 and 0.5
    assert prepared.outputs(np.array(0.4), np.array(-0.5)) == pytest.approx((7.0 + 12.0 - 1.0 - 10.0) / 20.0, rel=EXACT)


def test_inputs_are_clipped_before_the_functions_see_them() -> None:
    """Beyond the range a function of the input stays what it is at the end of the range."""
    prepared = system({"A": (0.0, 1.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 1.0, 0.0)}, low=-2.0, high=2.0)
    assert at(prepared, 1.3, 0.0) == pytest.approx(0.65, rel=EXACT)
    assert at(prepared, 7.0, 0.0) == 1.0
    assert at(prepared, -7.0, 99.0) == -1.0


def test_no_rule_no_output() -> None:
    """Where no rule fires the output is 0, whatever the middle of the range."""
    lonely = FuzzySystem("s", (E, DE), Functions.of({"A": 3.0}, 1.0, 5.0), (Rule(("P", "slow"), "A"),))
    prepared = prepare(lonely)
    assert at(prepared, -1.0, 0.0) == 0.0
    assert at(prepared, 2.0, -5.0) == 0.0  # 3 is the middle of 1 to 5
    assert at(prepare(FuzzySystem("s", (E, DE), Functions.of({"A": 4.0}, 1.0, 5.0), lonely.rules)), 2.0, -5.0) == 0.5


def test_one_input() -> None:
    """Two constants at the ends of one input: a straight line between them."""
    variable = Variable.of({"N": -1.0, "P": 1.0})
    rules = rules_of_table([variable.names], [["low", "high"]])
    prepared = prepare(FuzzySystem("line", (variable,), Functions.of({"low": -0.4, "high": 0.8}), rules))
    x = np.linspace(-1.0, 1.0, 11)
    assert prepared.outputs(x, np.full(11, 0.3)) == pytest.approx(0.2 + 0.6 * x, abs=EXACT)
