"""What the loop evaluates beside scikit-fuzzy's control API, and that a difference is noticed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.fuzzy.test_tables import uneven
from torquebench.fuzzy import BUILTIN, Functions, FuzzySystem, Rule, Variable, builtin_system, prepare
from torquebench.fuzzy.fis import SUGENO, TABLE
from torquebench.fuzzy.oracle import CONTROL, DEFUZZ, MEMBERSHIP, compare, scikit_fuzzy
from torquebench.fuzzy.system import AGGREGATIONS
from torquebench.fuzzy.table import defined_outputs


def steps() -> FuzzySystem:
    """Return a system with upright sides, shoulders, a rule that is missing, and a term that no rule has."""
    variable = Variable.of({"N": (-1.0, -1.0, -0.5, 0.0), "Z": (-0.3, 0.0, 0.0, 0.4), "P": (0.2, 0.2, 1.0, 1.0)})
    output = Variable.of({"low": (-1.0, -1.0, 0.0), "mid": (-0.5, 0.0, 0.5), "high": (0.0, 1.0, 1.0), "far": (1, 2, 3)})
    return FuzzySystem("steps", (variable,), output, (Rule(("N",), "low"), Rule(("P",), "high")))


AT_ONCE = (("pd-9", "min"), ("pd-9", "product"), ("pd-25", "min"))
"""scikit-fuzzy takes seconds for those of more rules, which are tried with -m slow."""


@pytest.mark.parametrize(
    ("name", "conjunction"),
    [
        pytest.param(name, conjunction, marks=[pytest.mark.slow] * ((name, conjunction) not in AT_ONCE))
        for name in BUILTIN
        for conjunction in ("min", "product")
    ],
)
def test_the_built_in_systems_beside_the_control_api(
    name: str, conjunction: str, figure: Callable[[str, float, str], None]
) -> None:
    """The closed form is what `skfuzzy.control` computes from the same rules, but for corners cut off by its steps."""
    found = compare(prepare(replace(builtin_system(name), conjunction=conjunction)))
    assert (found.by, found.table) == (CONTROL, 0.0)
    assert found.within
    assert 0.0 < found.difference < 1e-4
    assert found.difference < found.steps < 0.1
    figure(f"{name}, {conjunction}, against skfuzzy.control", found.difference, f"<= {found.steps:.1g}")


@pytest.mark.parametrize(
    "system", [uneven(), uneven(conjunction="product"), steps()], ids=["uneven", "product", "steps"]
)
def test_tables_beside_the_control_api(system: FuzzySystem) -> None:
    """Uneven terms, upright sides, missing rules: the table is within its bound of what `skfuzzy.control` computes."""
    prepared = prepare(system)
    assert prepared.fis.method == TABLE
    found = compare(prepared)
    assert (found.by, found.table) == (CONTROL, prepared.bound)
    assert found.within


@pytest.mark.parametrize("defuzzification", ["coa", "cog"])
@pytest.mark.parametrize("aggregation", AGGREGATIONS)
def test_the_other_operators_beside_defuzz(aggregation: str, defuzzification: str) -> None:
    """What the control API cannot express is put together from scikit-fuzzy's memberships and its `defuzz`."""
    operators = {"aggregation": aggregation, "defuzzification": defuzzification}
    found = compare(prepare(replace(builtin_system("pd-9"), **operators)), (8, 7))
    assert found.by == (CONTROL if (aggregation, defuzzification) == ("max-min", "coa") else DEFUZZ)
    assert found.within


def test_functions_beside_memberships() -> None:
    """Of Sugeno's method scikit-fuzzy has the memberships; the weighted mean is written out."""
    variable = Variable.of({"N": (-1.0, -0.7, 0.2), "P": (-0.1, 0.4, 1.5)}, -2.0, 2.0)
    output = Functions.of({"a": 0.5, "b": (0.1, -0.3, 0.7)}, -1.0, 2.0)
    rules = tuple(Rule((p, q), "a" if p == q else "b") for p in "NP" for q in "NP")
    prepared = prepare(FuzzySystem("sugeno", (variable, variable), output, rules))
    assert prepared.fis.method == SUGENO
    found = compare(prepared)
    assert (found.by, found.table, found.steps) == (MEMBERSHIP, 0.0, 0.0)
    assert found.within


def test_the_definition_is_what_scikit_fuzzy_computes() -> None:
    """On the same points the vectorised definition, of which tables are made, is `skfuzzy.defuzz` of each set."""
    x, y = np.random.default_rng(2).uniform(-1.0, 1.0, (2, 40))
    for aggregation in ("sum-min", "max-bounded-product", "min-max"):
        system = uneven(aggregation=aggregation)
        by, outputs = scikit_fuzzy(system, x, y)
        assert by == DEFUZZ
        assert outputs == pytest.approx(defined_outputs(system, x, y), abs=1e-11)


@pytest.mark.parametrize("aggregation", ["max-min", "sum-min", "max-bounded-product"])
def test_a_wrong_rule_is_noticed(aggregation: str) -> None:
    """If the loop evaluated a system with one other consequent, the difference would be above the bound."""
    system = replace(builtin_system("pd-9"), aggregation=aggregation)
    rule = system.rules[0]
    other = next(then for then in system.output.names if then != rule.then)
    wrong = replace(system, rules=(rule._replace(then=other), *system.rules[1:]))
    assert not compare(replace(prepare(wrong), system=system)).within
