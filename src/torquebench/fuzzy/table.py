"""What a Mamdani system's output is by definition, on points of the output's universe, and tables of it.

Terms are scikit-fuzzy's `trimf` and `trapmf`, and its curves by the loop's own kernel, as numpy's exponential differs
from one processor to another. The centre of a set is that of `skfuzzy.defuzz(..., "centroid")`, exact
for the broken line through the points, here for many sets at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import fill_memberships, fill_outputs
from torquebench.fuzzy.system import AGGREGATIONS, POINTS, FuzzySystem
from torquebench.fuzzy.terms import ANY, SAME, Variable
from torquebench.kernel import Array

Degrees: TypeAlias = Callable[[Variable, Array], Array]
_CHUNK = 2_000_000  # numbers in a temporary array: 16 MB


def universe(variable: Variable, points: int) -> Array:
    """Return evenly spaced points from the lowest foot of the terms to the highest, in the variable's own units."""
    return np.linspace(*variable.reach, points)


def degrees(variable: Variable, values: Array) -> Array:
    """Return the degree of each of `values` (N,), in the variable's own units, to each term, (N, n)."""
    from skfuzzy import trapmf, trimf

    columns = np.empty((len(values), len(variable.terms)))
    if any(term.curve for term in variable.terms):
        fill_memberships(variable.rows(), (values - variable.middle) / variable.half, columns)
    for k, t in enumerate(variable.terms):
        if t.curve is None:
            columns[:, k] = trimf(values, [t.a, t.b, t.d]) if t.b == t.c else trapmf(values, t.corners)
    return columns


def activations(system: FuzzySystem, x: Array, y: Array, degrees: Degrees = degrees) -> Array:
    """Return how much each rule fires, (N, rules).

    Args:
        system: The system.
        x, y: Normalised inputs, (N,); y is ignored by a system of one input.
        degrees: From a variable and values in its own units to the degree of each to each term.
    """
    fires = np.ones((len(x), len(system.rules)))
    some = np.zeros_like(fires)
    is_product = system.conjunction == "product"
    for i, (variable, values) in enumerate(zip(system.inputs, (x, y), strict=False)):
        degree = degrees(variable, variable.middle + variable.half * np.clip(values, -1.0, 1.0))
        every = np.column_stack([degree, np.ones(len(values))])
        chosen = every[:, [(*variable.names, ANY).index(rule.when[i]) for rule in system.rules]]
        fires = fires * chosen if is_product else np.fmin(fires, chosen)
        some = some + chosen - some * chosen if is_product else np.fmax(some, chosen)
    return np.where([rule.either for rule in system.rules], some, fires)


def defined_outputs(system: FuzzySystem, x: Array, y: Array, points: int = POINTS) -> Array:
    """Return the output of a Mamdani system by its definition, normalised, (N,); 0 where the set is empty.

    Args:
        system: The system.
        x, y: Normalised inputs, (N,), clipped to [-1, 1]; y is ignored by a system of one input.
        points: Number of points of the output's universe.
    """
    if not isinstance(system.output, Variable):
        raise TypeError(f"system '{system.name}' has functions for consequents, wanted terms")
    u = universe(system.output, points)
    terms = degrees(system.output, u)
    step = max(1, _CHUNK // points)
    parts = [slice(k, k + step) for k in range(0, len(x), step)]
    centres = np.concatenate([_centres(system, u, terms, activations(system, x[part], y[part])) for part in parts])
    return np.where(np.isnan(centres), 0.0, (centres - system.output.middle) / system.output.half)


def _centres(system: FuzzySystem, u: Array, terms: Array, fires: Array) -> Array:
    if over_rules(system) is not np.add:
        return centre(*moments(u, fuzzy_set(system, terms, fires)), u[-1] - u[0])
    # area and moment of a sum are sums, and many inputs share an activation: the sets need not all be made
    combine = AGGREGATIONS[system.aggregation].combine
    total = np.zeros((2, len(fires)))
    for w, rule in zip(fires.T, system.rules, strict=True):
        values, where = np.unique(w, return_inverse=True)
        mu = combine(values[:, None], terms[None, :, system.output.names.index(rule.then)])
        total += np.array(moments(u, mu))[:, where]
    return centre(total[0], total[1], u[-1] - u[0])


def over_rules(system: FuzzySystem) -> np.ufunc:
    """Return how the rules' sets are joined: added up for ``cog``, else as the aggregation says."""
    return np.add if system.defuzzification == "cog" else AGGREGATIONS[system.aggregation].over_rules


def fuzzy_set(system: FuzzySystem, terms: Array, fires: Array) -> Array:
    """Return the membership of the set whose centre is the output, (N, points).

    Args:
        system: The system.
        terms: Membership of its output's terms, (points, m).
        fires: How much each rule fires, (N, rules).
    """
    join, combine = over_rules(system), AGGREGATIONS[system.aggregation].combine
    consequents = np.array([system.output.names.index(rule.then) for rule in system.rules])
    if join is not np.add:
        # `combine` is monotone in the activation: of rules with one consequent the strongest decides
        kept = np.unique(consequents)
        fires = np.column_stack([fires[:, consequents == k].max(axis=1) for k in kept])
        consequents = kept
    first, *others = (combine(w[:, None], terms[None, :, k]) for w, k in zip(fires.T, consequents, strict=True))
    joined: Array = first
    for mu in others:
        join(joined, mu, out=joined)
    return joined


def moments(u: Array, mu: Array) -> tuple[Array, Array]:
    """Return the area under each set, (N,), and its first moment about zero, (N,).

    Args:
        u: Evenly spaced points, (points,).
        mu: Membership at these, (N, points), a straight line between two of them.
    """
    h = u[1] - u[0]
    weight, moment = np.full(len(u), h), h * u
    weight[[0, -1]] *= 0.5
    moment[0], moment[-1] = h * (2.0 * u[0] + u[1]) / 6.0, h * (2.0 * u[-1] + u[-2]) / 6.0
    # not BLAS: its sums depend on the number of threads
    return np.einsum("ij,j->i", mu, weight), np.einsum("ij,j->i", mu, moment)


def centre(area: Array, moment: Array, width: float) -> Array:
    """Return the centre of area, (N,); NaN where the set is empty, compared with `width`, that of the universe."""
    centres = np.full(len(area), np.nan)
    np.divide(moment, area, out=centres, where=area > 1e-12 * width)
    return centres


CELLS = 96
"""Cells of a table along each input, at least."""


class Grid(NamedTuple):
    """Nodes along one input: `cells` equal steps between each two breaks."""

    breaks: Array
    cells: int

    def nodes(self, per_cell: int = 1) -> Array:
        """Return the nodes, with `per_cell` steps in each cell."""
        steps = np.linspace(0.0, 1.0, self.cells * per_cell + 1)[:-1]
        inner = self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * steps
        return np.append(inner.ravel(), self.breaks[-1])


def grid_for(variable: Variable | None) -> Grid:
    """Return nodes that include the breaks of an input's terms; None stands for an input that is not there."""
    if variable is None:
        return Grid(np.array([-1.0, 1.0]), 1)
    corners = np.sort(np.clip(np.append(variable.breaks(), [-1.0, 1.0]), -1.0, 1.0))
    breaks = corners[np.append(True, np.diff(corners) > SAME)]
    breaks[-1] = 1.0
    return Grid(breaks, math.ceil(CELLS / (len(breaks) - 1)))


def outputs_on(system: FuzzySystem, x: Array, y: Array) -> Array:
    """Return the outputs by definition on the grid of x and y, (len(x), len(y)); arguments as of `defined_outputs`."""
    xx, yy = np.meshgrid(x, y, indexing="ij")
    return defined_outputs(system, xx.ravel(), yy.ravel()).reshape(len(x), len(y))


def error_bound(system: FuzzySystem, fis: Fis, grids: tuple[Grid, Grid]) -> float:
    """Return a bound on |interpolated - by definition|, measured and not proved.

    The error is evaluated at three points to a cell along each input, in the middle of the cell's thirds. Every input
    lies within a sixth of a cell of such a point, so the bound is the greatest error found there, plus, for each input,
    half the greatest difference of the error between neighbouring points: that is the steepest slope found times half
    the points' distance. It holds unless the error is steeper somewhere between two of these points.

    Args:
        system: The system.
        fis: It as a table.
        grids: The table's nodes along both inputs.
    """
    # the middles of the thirds of the cells
    x, y = (grid.nodes(6)[1::2] if grid.cells > 1 or len(grid.breaks) > 2 else np.zeros(1) for grid in grids)
    error = np.empty(len(x) * len(y))
    xx, yy = (np.ascontiguousarray(a.ravel()) for a in np.meshgrid(x, y, indexing="ij"))
    fill_outputs(fis, xx, yy, error)
    error = error.reshape(len(x), len(y)) - outputs_on(system, x, y)
    slopes = [np.abs(np.diff(error, axis=axis)) for axis in (0, 1)]
    return float(sum((0.5 * np.max(slope) for slope in slopes if slope.size), np.max(np.abs(error))))
