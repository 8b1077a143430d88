"""What scikit-fuzzy says a fuzzy system's output is, and how far the loop's own evaluation is from that.

`skfuzzy.control` computes max-min with the centre of area, from the rules alone. It lacks the other operators:
there scikit-fuzzy gives memberships and the centre of each set (`defuzz`). Of Sugeno's method it has memberships only.
"""

from __future__ import annotations

import operator
import warnings
from collections.abc import Collection
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from torquebench.fuzzy.fis import TABLE
from torquebench.fuzzy.prepare import Prepared
from torquebench.fuzzy.system import AGGREGATIONS, POINTS, FuzzySystem
from torquebench.fuzzy.table import activations, degrees, fuzzy_set, moments, over_rules, universe
from torquebench.fuzzy.terms import ANY, TRACE, Bell, Functions, Gaussian, Sigmoid, Variable
from torquebench.kernel import Array

COUNTS = (32, 30)
"""Inputs along each axis of the grid: with 31 and 29 steps, primes, few fall on a system's symmetries."""
ROUNDING = 1e-9
"""Difference that is put down to rounding, in the output's normalised units."""


class Comparison(NamedTuple):
    """The loop's own evaluation of a system beside scikit-fuzzy's, on a grid of inputs; outputs are normalised."""

    by: str
    """What of scikit-fuzzy was asked."""
    grid: tuple[int, ...]
    """Inputs along each axis."""
    difference: float
    """Largest difference."""
    at: tuple[float, ...]
    """Normalised inputs where it is."""
    table: float
    """Part of the bound: the error of interpolation, `Prepared.bound`."""
    steps: float
    """Part of the bound, the largest of all inputs: a fuzzy set that is a broken line through points of the output's
    universe, with corners cut off between them."""
    within: bool
    """Whether the difference is within its bound at each input."""

    def __str__(self) -> str:
        grid = " x ".join(map(str, self.grid))
        at = ", ".join(f"{x:.3g}" for x in self.at)
        parts = {"interpolation": self.table, "steps of scikit-fuzzy's universe": self.steps, "rounding": ROUNDING}
        bound = ", ".join(f"{name} at most {value:.2g}" for name, value in parts.items() if value)
        return (
            f"{self.by} on {grid} inputs: largest difference {self.difference:.2g}, at ({at}), "
            f"{'within' if self.within else 'ABOVE'} its bound ({bound})"
        )


def compare(prepared: Prepared, counts: tuple[int, int] = COUNTS) -> Comparison:
    """Compare what the control loop evaluates with scikit-fuzzy.

    The bound at each input is `table` + `steps` there + ROUNDING. Of `steps`: a line that bends by d between two points
    h apart, drawn straight, is wrong by an area of at most h^2 d / 8, and one that jumps by j by at most h j / 2. So a
    set is wrong by at most h / 4 times the sum of its second differences, and its centre by that times its width over
    its area.

    Args:
        prepared: The system, as the loop has it.
        counts: Inputs along each axis.
    """
    system = prepared.system
    axes = [np.linspace(-1.0, 1.0, count) for count in counts[: len(system.inputs)]]
    x, y = (a.ravel() for a in np.meshgrid(axes[0], axes[1] if len(axes) == 2 else np.zeros(1), indexing="ij"))
    by, outputs = scikit_fuzzy(system, x, y)
    difference = np.abs(prepared.outputs(x, y) - outputs)
    # on the same points a table is only interpolated
    is_same = isinstance(system.output, Functions) or (prepared.fis.method == TABLE and by != CONTROL)
    steps = np.zeros(len(x)) if is_same else _error_of_steps(system, x, y)
    worst = int(np.argmax(difference))
    return Comparison(
        by,
        tuple(len(axis) for axis in axes),
        float(difference[worst]),
        tuple(float(axis[worst]) for axis in (x, y)[: len(axes)]),
        prepared.bound,
        float(np.max(steps)),
        bool(np.all(difference <= prepared.bound + steps + ROUNDING)),
    )


CONTROL, DEFUZZ, MEMBERSHIP = "skfuzzy.control", "skfuzzy.defuzz", "skfuzzy's membership functions"


def memberships(variable: Variable, values: Array) -> Array:
    """Return what scikit-fuzzy says the degree of each of `values` (N,), in own units, to each term is, (N, n)."""
    from skfuzzy import gaussmf, gbellmf, sigmf

    columns = degrees(variable, values)  # of the straight terms, scikit-fuzzy's own
    for column, term in zip(columns.T, variable.terms, strict=True):
        match term.curve:
            case Gaussian(mean, sigma):
                column[:] = gaussmf(values, mean, sigma)
            case Bell(centre, width, slope):
                column[:] = gbellmf(values, width, slope, centre)
            case Sigmoid(centre, slope):
                column[:] = sigmf(values, centre, slope)
    return columns


def scikit_fuzzy(system: FuzzySystem, x: Array, y: Array) -> tuple[str, Array]:
    """Return what of scikit-fuzzy was asked, and the outputs, normalised, (N,); 0 where the set is empty.

    Args:
        system: The system.
        x, y: Normalised inputs, (N,), within [-1, 1]; y is ignored by a system of one input.
    """
    fires = activations(system, x, y, memberships)
    if isinstance(system.output, Variable) and (system.aggregation, system.defuzzification) != ("max-min", "coa"):
        return DEFUZZ, (_defuzzified(system, system.output, fires) - system.output.middle) / system.output.half
    normalised = np.zeros(len(x))
    live = np.max(fires, axis=1) > TRACE
    own = [v.middle + v.half * values[live] for v, values in zip(system.inputs, (x, y), strict=False)]
    if isinstance(system.output, Functions):
        by, outputs = MEMBERSHIP, _weighted_mean(system, system.output, fires[live], own)
    else:
        by, outputs = CONTROL, _controlled(system, system.output, own)
    normalised[live] = (outputs - system.output.middle) / system.output.half
    return by, normalised


def _controlled(system: FuzzySystem, output: Variable, values: list[Array]) -> Array:
    """Return the outputs by scikit-fuzzy's control API, (N,), in the output's own units."""
    from skfuzzy import control

    inputs = []
    for i, (variable, own) in enumerate(zip(system.inputs, values, strict=True)):
        # between the points of a universe scikit-fuzzy draws a membership straight
        points = own if any(term.curve for term in variable.terms) else ()
        ends = np.array([variable.low, variable.high, *points])
        inputs.append(control.Antecedent(_points(variable, ends), f"x{i}"))
        _add_terms(inputs[-1], variable, variable.names)
        inputs[-1][ANY] = np.ones(len(inputs[-1].universe))
    result = control.Consequent(_points(output, universe(output, POINTS)), "u")
    _add_terms(result, output, {rule.then for rule in system.rules})  # a term that no rule has would be an error
    rules = []
    for rule in dict.fromkeys(system.rules):
        terms = [variable[name] for variable, name in zip(inputs, rule.when, strict=True)]
        condition = reduce(operator.or_ if rule.either else operator.and_, terms)
        is_product = system.conjunction == "product"
        both, one_of = (np.multiply, _probabilistic_or) if is_product else (np.fmin, np.fmax)
        rules.append(control.Rule(condition, result[rule.then], and_func=both, or_func=one_of))
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules))
    for i, value in enumerate(values):
        simulation.input[f"x{i}"] = value
    with warnings.catch_warnings():
        # scikit-fuzzy calls np.maximum with three arguments, which numpy is about to drop
        warnings.filterwarnings("ignore", "Passing more than 2 positional arguments", DeprecationWarning)
        simulation.compute()
    outputs: Array = np.asarray(simulation.output["u"], dtype=np.float64)
    return outputs


def _probabilistic_or(a: Any, b: Any) -> Any:
    return a + b - a * b


def _points(variable: Variable, points: Array) -> Array:
    """Return points of a universe with the corners of its terms, and with both sides of a term's upright sides."""
    corners = np.array([term.corners for term in variable.terms if term.curve is None]).reshape(-1, 4)
    upright = np.concatenate([corners[corners[:, 0] == corners[:, 1], 0], corners[corners[:, 2] == corners[:, 3], 3]])
    sides = np.nextafter(upright, -np.inf), np.nextafter(upright, np.inf)
    every: Array = np.unique(np.concatenate([points, corners.ravel(), *sides]))
    return every


def _add_terms(variable: Any, own: Variable, names: Collection[str]) -> None:
    for name, membership in zip(own.names, memberships(own, variable.universe).T, strict=True):
        if name in names:
            variable[name] = membership


def _defuzzified(system: FuzzySystem, output: Variable, fires: Array) -> Array:
    """Return the centre of each input's set on POINTS points, one after the other, by `skfuzzy.defuzz`, (N,)."""
    from skfuzzy import defuzz

    u = universe(output, POINTS)
    terms = memberships(output, u)
    join, combine = over_rules(system), AGGREGATIONS[system.aggregation].combine
    consequents = [terms[:, output.names.index(rule.then)] for rule in system.rules]
    centres = np.full(len(fires), output.middle)
    for k, row in enumerate(fires):
        mu = join.reduce([combine(w, consequent) for w, consequent in zip(row, consequents, strict=True)])
        if np.trapezoid(mu, u) > 1e-12 * (u[-1] - u[0]):
            centres[k] = defuzz(u, mu, "centroid")
    return centres


def _weighted_mean(system: FuzzySystem, output: Functions, fires: Array, values: list[Array]) -> Array:
    """Return the mean of the rules' functions, weighted by how much the rules fire, (N,)."""
    numbers = {name: (*c, 0.0, 0.0)[: len(values) + 1] for name, c in output.coefficients}
    functions = np.column_stack([np.ones(len(fires)), *values]) @ np.array([numbers[r.then] for r in system.rules]).T
    mean: Array = np.average(functions, axis=1, weights=fires)
    return mean


def _error_of_steps(system: FuzzySystem, x: Array, y: Array) -> Array:
    """Bound what the steps of the output's universe change in the output, normalised, (N,); see `compare`."""
    output: Any = system.output
    u = universe(output, POINTS)
    sets = fuzzy_set(system, degrees(output, u), activations(system, x, y))
    bends = np.abs(np.diff(sets, 2, axis=1, prepend=0.0, append=0.0)).sum(axis=1)
    area = moments(u, sets)[0]
    width = u[-1] - u[0]
    wrong = 0.25 * (u[1] - u[0]) * bends * width
    bound = np.zeros(len(x))
    np.divide(wrong, area * output.half, out=bound, where=area > 1e-12 * width)
    return bound
