"""The seven aggregations by definition, and tables of them: what the definition is, and how far a table may be off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import skfuzzy

from tests.fuzzy.independent import brute_force
from torquebench.fuzzy import FuzzySystem, Rule, Variable, builtin_system, prepare
from torquebench.fuzzy.fis import TABLE
from torquebench.fuzzy.system import AGGREGATIONS
from torquebench.fuzzy.table import activations, centre, defined_outputs, degrees, fuzzy_set, moments, universe
from torquebench.kernel import Array

SAME = 1e-10
"""The same sums in another order: hundreds of roundings, and a quotient whose divisor may be small."""
UNEVEN = Variable.of({"N": (-3.0, -2.0, -0.5), "Z": (-1.0, 0.25, 1.5), "P": (0.5, 2.0, 3.0)}, -2.0, 2.0)


def uneven(**operators: str) -> FuzzySystem:
    """Return a lopsided system of nine rules, two of them missing, whose inputs and output have different units."""
    small = Variable.of({"N": (-0.2, -0.1, 0.1), "Z": (0.0, 0.12, 0.24), "P": (0.1, 0.3, 0.4)}, -0.1, 0.3)
    cells = [(a, b) for a in UNEVEN.names for b in small.names]
    consequents = ["N", "N", "Z", "N", None, "P", "Z", "P", None]
    rules = tuple(Rule(when, then) for when, then in zip(cells, consequents, strict=True) if then)
    output = Variable.of({"N": (-15.0, -10.0, -1.0), "Z": (-4.0, 0.0, 4.0), "P": (1.0, 8.0, 15.0)}, -8.0, 12.0)
    return FuzzySystem("uneven", (UNEVEN, small), output, rules, **operators)


def inputs(count: int, seed: int) -> tuple[Array, Array]:
    """Return random pairs of inputs."""
    x, y = np.random.default_rng(seed).uniform(-1.05, 1.05, (2, count))
    return x, y


@pytest.mark.parametrize("defuzzification", ["coa", "cog"])
@pytest.mark.parametrize("conjunction", ["min", "product"])
@pytest.mark.parametrize("aggregation", AGGREGATIONS)
@pytest.mark.parametrize("make", [uneven, lambda **operators: replace(builtin_system("pd-49"), **operators)])
def test_each_aggregation_against_brute_force(
    make: Callable[..., FuzzySystem], aggregation: str, conjunction: str, defuzzification: str
) -> None:
    """What is taken for the definition is the equation of the reading, rule by rule and point by point."""
    system = make(aggregation=aggregation, conjunction=conjunction, defuzzification=defuzzification)
    assert isinstance(system.output, Variable)
    triangles = [[(t.a, t.b, t.d) for t in variable.terms] for variable in (*system.inputs, system.output)]
    x, y = inputs(25, 4)
    x, y = np.append(x, [0.0, 1.0, -1.0 / 3.0]), np.append(y, [0.0, 1.0, 1.0 / 3.0])  # nodes, where rules fire wholly
    found = defined_outputs(system, x, y, 241)
    for a, b, got in zip(x, y, found, strict=True):
        own = [min(max(z, -1.0), 1.0) * v.half + v.middle for z, v in zip((a, b), system.inputs, strict=True)]
        wanted = brute_force(
            own[0],
            own[1],
            triangles[:2],
            triangles[2],
            system.table,
            aggregation,
            conjunction == "product",
            defuzzification == "cog",
            241,
        )
        normalised = (wanted - system.output.middle) / system.output.half
        assert got == pytest.approx(0.0 if np.isnan(wanted) else normalised, abs=SAME)


def test_no_two_aggregations_are_the_same() -> None:
    """At one point the seven give seven different outputs."""
    outputs = [
        defined_outputs(uneven(aggregation=name), np.array([0.31]), np.array([-0.2]))[0] for name in AGGREGATIONS
    ]
    assert len(set(np.round(outputs, 4))) == 7


def test_the_centre_is_scikit_fuzzys() -> None:
    """Of many sets at once the centre is what `skfuzzy.defuzz` gives for each; of an empty one there is none."""
    system = uneven()
    u = universe(system.output, 121)  # type: ignore[arg-type]
    terms = degrees(system.output, u)  # type: ignore[arg-type]
    x, y = inputs(40, 5)
    sets = fuzzy_set(system, terms, activations(system, x, y))
    centres = centre(*moments(u, sets), u[-1] - u[0])
    for mu, got in zip(sets, centres, strict=True):
        if mu.sum() == 0.0:
            assert np.isnan(got)
        else:
            assert got == pytest.approx(skfuzzy.defuzz(u, mu, "centroid"), abs=1e-12)


TABLED = [
    pytest.param(replace(builtin_system("pd-9"), aggregation=name), id=name)
    for name in AGGREGATIONS
    if name not in ("max-min", "sum-min")
] + [
    pytest.param(replace(builtin_system("pd-25"), aggregation="max-bounded-product", conjunction="product"), id="25"),
    pytest.param(replace(builtin_system("pd-9"), aggregation="max-bounded-sum", defuzzification="cog"), id="cog"),
    pytest.param(uneven(), id="uneven"),
    pytest.param(uneven(aggregation="sum-min", conjunction="product"), id="uneven sum"),
]


@pytest.mark.parametrize("system", TABLED)
def test_the_bound_holds(system: FuzzySystem, figure: Callable[[str, float, str], None]) -> None:
    """On 10^4 random inputs no table is further from its definition than its bound says, nor is the bound idle."""
    prepared = prepare(system)
    assert prepared.fis.method == TABLE
    assert prepared.bound > 0.0
    x, y = inputs(10_000, 6)
    gap = float(np.max(np.abs(prepared.outputs(x, y) - defined_outputs(system, x, y))))
    assert gap <= prepared.bound
    assert gap > 0.05 * prepared.bound  # ten times the true error would be no information
    assert prepared.bound < 0.04 or system.name == "uneven"  # which jumps to 0 where rules are missing
    figure(f"table of {system.name}, {system.aggregation}, {system.conjunction}", gap, f"<= {prepared.bound:.2g}")


@pytest.mark.slow
@pytest.mark.parametrize("defuzzification", ["coa", "cog"])
@pytest.mark.parametrize("conjunction", ["min", "product"])
@pytest.mark.parametrize("aggregation", [name for name in AGGREGATIONS if name not in ("max-min", "sum-min")])
@pytest.mark.parametrize("name", ["pd-49", "pd-25"])
def test_the_bound_holds_for_every_operator(
    name: str, aggregation: str, conjunction: str, defuzzification: str
) -> None:
    """The same for all combinations of operators on the larger built-in systems."""
    operators = {"aggregation": aggregation, "conjunction": conjunction, "defuzzification": defuzzification}
    prepared = prepare(replace(builtin_system(name), **operators))
    x, y = inputs(10_000, 7)
    gap = float(np.max(np.abs(prepared.outputs(x, y) - defined_outputs(prepared.system, x, y))))
    assert gap <= prepared.bound + 1e-13  # some are exact in bilinear cells


def test_nodes_are_exact() -> None:
    """At the corners of the terms and on every node between, the table holds the definition's output itself."""
    system = uneven()
    prepared = prepare(system)
    corners = np.array([-0.25, 0.25, 0.5, 0.125])
    x, y = np.repeat(corners, 4), np.tile(np.array([-0.5, 0.0, 0.1, 0.7]), 4)
    assert prepared.outputs(x, y) == pytest.approx(defined_outputs(system, x, y), abs=1e-12)
    for place in (prepared.fis.x_breaks, prepared.fis.y_breaks):
        assert (place[0], place[-1]) == (-1.0, 1.0)
        assert np.all(np.diff(place) > 0.0)


def test_where_nothing_fires_the_output_is_zero() -> None:
    """Around the missing middle rule the definition has an empty set; table and definition say 0."""
    system = uneven()
    lonely = replace(system, rules=system.rules[:1])
    x, y = np.array([0.9, 0.5]), np.array([0.9, -0.9])
    assert defined_outputs(lonely, x, y).tolist() == [0.0, 0.0]
    assert prepare(lonely).outputs(x, y).tolist() == [0.0, 0.0]


def test_a_system_is_prepared_once() -> None:
    """Equal definitions share one table."""
    assert prepare(uneven()) is prepare(uneven())


def test_one_input() -> None:
    """A system of one input ignores the second; exact and tabulated agree within the bound."""
    variable = Variable.of({"N": -1.0, "Z": 0.0, "P": 1.0})
    rules = tuple(Rule((name,), name) for name in variable.names)
    exact = prepare(FuzzySystem("one", (variable,), variable, rules))
    table = prepare(FuzzySystem("one", (variable,), variable, rules, aggregation="max-bounded-product"))
    x = np.linspace(-1.1, 1.1, 301)
    assert exact.bound == 0.0
    assert table.fis.method == TABLE
    assert table.fis.table.shape[1] == 2
    for prepared in (exact, table):
        alone = prepared.outputs(x, np.zeros_like(x))
        assert np.array_equal(prepared.outputs(x, np.full_like(x, 0.37)), alone)
        assert np.max(np.abs(alone - defined_outputs(prepared.system, x, x))) <= max(prepared.bound, 1e-4)
    # by hand: at 1/2 the terms Z and P are clipped at 1/2, areas 3/4 about 0 and 1 that share 1/4 about 1/2
    assert exact.outputs(np.array(0.5), np.array(0.0)) == pytest.approx(0.5, abs=1e-14)
    # at 1/4: 15/16 about 0, 7/16 about 1, shared 3/16 about 1/2: (7/16 - 3/32) / (19/16)
    assert exact.outputs(np.array(0.25), np.array(0.0)) == pytest.approx(11.0 / 38.0, abs=1e-14)
