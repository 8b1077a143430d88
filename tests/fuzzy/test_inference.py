"""Exact inference: facts worked out by hand, an independent sum of areas, and scikit-fuzzy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.fuzzy.independent import exact_output
from torquebench.fuzzy import FuzzySystem, Rule, builtin_system, infer, prepare
from torquebench.fuzzy.fis import STAIRCASE, SUM, UNION, Fis
from torquebench.fuzzy.table import defined_outputs, universe
from torquebench.kernel import Array

PD49 = prepare(builtin_system("pd-49"))
ROUNDING = 1e-14
"""A few dozen roundings of numbers of order 1."""


def points(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Return random pairs of inputs, some of them beyond [-1, 1]."""
    x, y = np.random.default_rng(seed).uniform(-1.1, 1.1, (2, count))
    return x, y


FACTS = [(0.0, 0.0), (0.05, 0.151), (0.1, 0.245), (0.33, 0.6536), (0.5, 0.833), (0.8, 1.0)]


@pytest.mark.parametrize(("x", "wanted"), FACTS)
def test_published_facts(x: float, wanted: float) -> None:
    """FIS(x, x) to the digits it is known by."""
    assert infer(PD49.fis, x, x) == pytest.approx(wanted, abs=5e-4 if x != 0.33 else 5e-5)


def test_nothing_for_nothing() -> None:
    """No error, no output, to the last bit."""
    assert infer(PD49.fis, 0.0, 0.0) == 0.0


def test_a_point_by_hand() -> None:
    """At (1/6, 1/6) the rules Z-Z, Z-PS, PS-Z and PS-PS fire at 1/2: clipped triangles of 0, 1 and 2 thirds.

    Each has the area 3/4 in units of a third, neighbours share 1/4: (3/4 (0 + 1 + 2) - 1/4 (1/2 + 3/2)) / (9/4 - 2/4)
    = 1, so the output is one third. At (1/6, 0) only Z-Z and PS-Z fire, at 1/2: half a third.
    """
    assert infer(PD49.fis, 1.0 / 6.0, 1.0 / 6.0) == pytest.approx(1.0 / 3.0, rel=ROUNDING)
    assert infer(PD49.fis, 1.0 / 6.0, 0.0) == pytest.approx(1.0 / 6.0, rel=ROUNDING)


def on_axis(x: float) -> float:
    """Return FIS(x, 0) for 0 <= x <= 1/6, from areas.

    With d = 3x the rules Z-Z and PS-Z fire at 1 - d and d. In units of a third their areas are 1 - d^2 about 0 and
    d (2 - d) about 1, and they share d (1 - d) about 1/2: area 1 + d - d^2, moment 3d/2 - d^2/2.
    """
    d = 3.0 * x
    return (1.5 * d - 0.5 * d * d) / (1.0 + d - d * d) / 3.0


@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_slope_near_the_origin_along_each_input(second: bool, side: float) -> None:
    """The output follows the areas; its slope is 3/2 at the origin and 1.264 on average up to 0.05."""
    for x in np.linspace(0.0, 1.0 / 6.0, 21):
        value = infer(PD49.fis, *((0.0, side * x) if second else (side * x, 0.0)))
        assert value == pytest.approx(side * on_axis(x), abs=ROUNDING)
    assert on_axis(1e-9) / 1e-9 == pytest.approx(1.5, rel=1e-8)
    assert on_axis(0.05) / 0.05 == pytest.approx(1.264, abs=5e-4)


def test_slope_at_the_origin_along_the_diagonal() -> None:
    """The diagonal is steeper than both inputs together: with d = 3x, Z fires at 1 - d, PS and PM at d.

    Area 1 - d^2 + 2 d (2 - d) - 2 d (1 - d) = 1 + 2d - d^2, moment 3 d (2 - d) - 2 d (1 - d) = 4d - d^2: slope 4, so
    the output has no gradient there.
    """
    for x in (1e-9, 0.01, 0.1):
        d = 3.0 * x
        wanted = (4.0 * d - d * d) / (1.0 + 2.0 * d - d * d) / 3.0
        assert infer(PD49.fis, x, x) == pytest.approx(wanted, rel=1e-12)


def test_against_areas_summed_independently() -> None:
    """On 2000 random inputs, and on a grid of all peaks and midpoints, the closed form is the exact integral."""
    x, y = points(2000)
    grid = np.arange(-6, 7) / 6.0
    x, y = np.append(x, np.repeat(grid, 13)), np.append(y, np.tile(grid, 13))
    wanted = [exact_output(a, b) for a, b in zip(x, y, strict=True)]
    assert PD49.fis.method == STAIRCASE
    assert PD49.outputs(x, y) == pytest.approx(np.array(wanted), abs=1e-12)


def test_it_is_odd_and_symmetric_and_clips() -> None:
    """FIS(-x, -y) = -FIS(x, y), FIS(y, x) = FIS(x, y), and inputs beyond 1 count as 1."""
    x, y = points(20000, 1)
    z = PD49.outputs(x, y)
    assert PD49.outputs(-x, -y) == pytest.approx(-z, abs=1e-12)
    assert PD49.outputs(y, x) == pytest.approx(z, abs=1e-12)
    assert np.array_equal(PD49.outputs(np.clip(x, -1.0, 1.0), np.clip(y, -1.0, 1.0)), z)
    assert PD49.outputs(np.array([math.inf]), np.array([1e300])) == 1.0
    assert np.max(np.abs(z)) <= 1.0
    for bad in ((math.nan, 0.0), (0.0, math.nan)):
        assert math.isnan(infer(PD49.fis, *bad))


def test_every_rule_matters() -> None:
    """At its own peak each of the 49 rules alone decides; taking it away changes the output there."""
    system = PD49.system
    for k, rule in enumerate(system.rules):
        i, j = (system.inputs[0].names.index(word) for word in rule.when)
        at = (i - 3) / 3.0, (j - 3) / 3.0
        wanted = min(max(at[0] + at[1], -1.0), 1.0)
        assert infer(PD49.fis, *at) == pytest.approx(wanted, abs=ROUNDING)
        without = prepare(replace(system, rules=system.rules[:k] + system.rules[k + 1 :])).fis
        assert without.method == UNION
        assert infer(without, *at) == 0.0  # where nothing fires


@pytest.mark.parametrize("name", ["pd-49", "pd-25", "pd-9"])
@pytest.mark.parametrize("conjunction", ["min", "product"])
def test_the_general_exact_path_equals_the_staircase_path(name: str, conjunction: str) -> None:
    """Both closed forms give the same on the tables that both can do."""
    fis = prepare(replace(builtin_system(name), conjunction=conjunction)).fis
    assert fis.method == STAIRCASE
    general = fis._replace(method=UNION)
    for x, y in zip(*points(5000, 2), strict=True):
        assert infer(general, x, y) == pytest.approx(infer(fis, x, y), abs=ROUNDING)


def random_system(rng: np.random.Generator, terms: int, holes: float, conjunction: str) -> FuzzySystem:
    """Return a system of even triangles with a random table, some rules of which may be missing."""
    base = builtin_system({3: "pd-9", 5: "pd-25", 7: "pd-49"}[terms])
    names = base.inputs[0].names
    rules = [Rule(rule.when, str(rng.choice(names))) for rule in base.rules if rng.random() >= holes]
    return replace(base, name="random", rules=tuple(rules or base.rules), conjunction=conjunction)


@pytest.mark.parametrize("conjunction", ["min", "product"])
@pytest.mark.parametrize("holes", [0.0, 0.3])
@pytest.mark.parametrize("terms", [3, 5, 7])
def test_random_tables_against_areas_summed_independently(terms: int, holes: float, conjunction: str) -> None:
    """Any table on even triangles, with missing rules too, is evaluated exactly; scikit-fuzzy comes close."""
    rng = np.random.default_rng(terms)
    for _ in range(4):
        system = random_system(rng, terms, holes, conjunction)
        prepared = prepare(system)
        assert (prepared.fis.method, prepared.bound) == (UNION, 0.0)
        peaks = np.linspace(-1.0, 1.0, terms)
        x, y = rng.uniform(-1.05, 1.05, (2, 60))
        wanted = [exact_output(a, b, peaks, system.table, conjunction == "product") for a, b in zip(x, y, strict=True)]
        assert prepared.outputs(x, y) == pytest.approx(np.array(wanted), abs=1e-12)
        # corners cut on points 1/300 apart or less, which counts for more in a set of small area
        assert prepared.outputs(x, y) == pytest.approx(defined_outputs(system, x, y, 1201), abs=3e-4)


@pytest.mark.parametrize("terms", [3, 5, 7])
def test_rounding_fires_no_rule_on_a_peak(terms: int) -> None:
    """On the peaks, where a missing rule leaves nothing to fire, the output is 0, as scikit-fuzzy has it too."""
    system = random_system(np.random.default_rng(terms), terms, 0.4, "min")
    peaks = np.linspace(-1.0, 1.0, terms)
    x, y = (axis.ravel() for axis in np.meshgrid(peaks, peaks, indexing="ij"))
    found = prepare(system).outputs(x, y)
    missing = np.array([system.table[i, j] < 0 for i in range(terms) for j in range(terms)])
    assert 0 < np.count_nonzero(missing) < len(missing)
    assert np.all(found[missing] == 0.0)
    assert found == pytest.approx(defined_outputs(system, x, y, 1201), abs=3e-4)


@pytest.mark.parametrize(("output_points", "promise", "count"), [(121, 4e-4, 20000), (1201, 1e-5, 20000)])
def test_against_scikit_fuzzy(
    output_points: int, promise: float, count: int, figure: Callable[[str, float, str], None]
) -> None:
    """What scikit-fuzzy computes on points of the output tends to the closed form; all 49 rules fire.

    The broken line through the points cuts the corners of the clipped triangles, an error of the second order in
    their distance: 1/45 and 1/450.
    """
    x, y = points(count, 3)
    fired = np.unique(np.clip(np.floor((np.clip(x, -1, 1) + 1) * 3), 0, 5) * 6 + np.floor((np.clip(y, -1, 1) + 1) * 3))
    assert len(fired) >= 36  # every cell, so every rule
    gap = float(np.max(np.abs(defined_outputs(PD49.system, x, y, output_points) - PD49.outputs(x, y))))
    figure(f"49 rules against scikit-fuzzy at {output_points} points", gap, f"<= {promise:g}")
    assert gap <= promise
    assert gap > promise / 100.0  # it is an independent computation


@pytest.mark.parametrize("conjunction", ["min", "product"])
@pytest.mark.parametrize("operators", [("sum-min", "coa"), ("sum-min", "cog"), ("max-min", "cog")])
def test_sums_of_clipped_triangles(conjunction: str, operators: tuple[str, str]) -> None:
    """Sum-min with either centre, and max-min with the centre of gravity, are w (2 - w) about each rule's centre."""
    rng = np.random.default_rng(9)
    for terms in (3, 5, 7):
        system = random_system(rng, terms, 0.2, conjunction)
        prepared = prepare(replace(system, aggregation=operators[0], defuzzification=operators[1]))
        assert prepared.fis.method == SUM
        x, y = rng.uniform(-1.05, 1.05, (2, 500))
        h = 2.0 / (terms - 1)
        peaks = -1.0 + h * np.arange(terms)
        u, v = (np.maximum(0.0, 1.0 - np.abs(np.clip(z, -1, 1)[:, None] - peaks) / h) for z in (x, y))
        w = u[:, :, None] * v[:, None, :] if conjunction == "product" else np.minimum(u[:, :, None], v[:, None, :])
        area = np.where(system.table >= 0, w * (2.0 - w), 0.0)
        total = area.sum(axis=(1, 2))
        wanted = np.where(total > 0, (area * peaks[system.table]).sum(axis=(1, 2)) / np.where(total > 0, total, 1), 0.0)
        assert prepared.outputs(x, y) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.filterwarnings("ignore:Passing more than 2 positional arguments:DeprecationWarning")
def test_scikit_fuzzys_own_control_system() -> None:
    """`skfuzzy.control`, with its own rules and its own inference, agrees on a handful of points."""
    from skfuzzy import control, trimf

    system = PD49.system
    inputs = [control.Antecedent(np.linspace(-1.0, 1.0, 601), name) for name in ("x", "y")]
    output = control.Consequent(universe(system.inputs[0], 1201), "z", defuzzify_method="centroid")
    for k, name in enumerate(system.inputs[0].names):
        peak = (k - 3) / 3.0
        for variable in (*inputs, output):
            variable[name] = trimf(variable.universe, [peak - 1.0 / 3.0, peak, peak + 1.0 / 3.0])
    x, y = inputs
    rules = [control.Rule(x[rule.when[0]] & y[rule.when[1]], output[rule.then]) for rule in system.rules]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules))
    for a, b in [(0.05, 0.05), (0.33, 0.33), (-0.7, 0.2), (0.9, -0.95), (0.61, 0.48)]:
        simulation.input["x"], simulation.input["y"] = a, b
        simulation.compute()
        # the inputs' triangles are interpolated between 601 points that include their peaks up to rounding
        assert simulation.output["z"] == pytest.approx(infer(PD49.fis, a, b), abs=2e-5)


def test_a_fis_holds_only_what_compiled_code_takes() -> None:
    """Integers, floats and C-contiguous arrays of 8-byte numbers, nothing else."""
    for name, value in PD49.fis._asdict().items():
        if isinstance(value, np.ndarray):
            assert value.flags.c_contiguous, name
            assert value.dtype in (np.float64, np.int64), name
        else:
            assert type(value) in (int, float), name
    assert len(Fis._fields) == len(set(Fis._fields))
