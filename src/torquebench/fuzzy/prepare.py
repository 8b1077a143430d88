"""From a definition to what kernels evaluate: exactly where there is a closed form, else from a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from torquebench.fuzzy.fis import MIN, PRODUCT, STAIRCASE, SUGENO, SUM, TABLE, UNION, Fis
from torquebench.fuzzy.inference import fill_outputs
from torquebench.fuzzy.system import FuzzySystem
from torquebench.fuzzy.table import error_bound, fill_table, grid_for
from torquebench.fuzzy.terms import SAME, Functions, Variable
from torquebench.kernel import Array, IntArray

METHODS = {
    STAIRCASE: "exact (closed form, stairs)",
    UNION: "exact (closed form)",
    SUM: "exact (sum of clipped triangles)",
    SUGENO: "exact (weighted mean)",
    TABLE: "table",
}
"""What each method is called."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A fuzzy system ready for the control loop."""

    system: FuzzySystem
    fis: Fis
    """What kernels get."""
    bound: float
    """Bound on the error of evaluation, in the output's normalised units: 0 for exact methods, else see
    `table.error_bound`."""

    @property
    def method(self) -> str:
        """How the system is evaluated, in words."""
        name = METHODS[self.fis.method]
        return name if self.fis.method != TABLE else f"{name} of {' x '.join(map(str, self.fis.table.shape))} nodes"

    def outputs(self, x: Array, y: Array) -> Array:
        """Return the outputs at pairs of normalised inputs, of the shape that `x` and `y` have together."""
        xx, yy = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        outputs = np.empty(xx.size)
        fill_outputs(self.fis, xx.ravel(), yy.ravel(), outputs)
        return outputs.reshape(xx.shape)


@lru_cache(maxsize=64)
def prepare(system: FuzzySystem) -> Prepared:
    """Return a system ready for the control loop.

    Exact: Sugeno's method; max-min with ``coa``, and sums of clipped consequents (sum-min, or max-min with ``cog``),
    when the terms of each input are triangles evenly spaced from end to end of its range, each reaching to its
    neighbours, and those of the output are evenly spaced triangles whose half-width equals their spacing. All other
    systems become a table of outputs by definition.
    """
    second = system.inputs[1] if len(system.inputs) == 2 else None
    rules = system.table if second is not None else np.repeat(system.table[:, None], 2, axis=1)
    nothing = np.zeros(2)
    fis = Fis(
        TABLE,
        PRODUCT if system.conjunction == "product" else MIN,
        len(system.inputs),
        1.0,
        0.0,
        np.zeros((2, 2)),
        rules.astype(np.int64),
        system.inputs[0].corners(),
        _certain() if second is None else second.corners(),
        np.zeros((0, 3)),
        nothing,
        nothing,
        1,
        1,
    )
    if isinstance(system.output, Functions):
        return Prepared(system, fis._replace(method=SUGENO, functions=_functions(system, system.output)), 0.0)
    form = _closed_form(system, system.output, rules)
    if form is not None:
        method, scale, offset, table = form
        return Prepared(system, fis._replace(method=method, scale=scale, offset=offset, table=table), 0.0)
    grids = grid_for(system.inputs[0]), grid_for(second)
    fis = fis._replace(
        table=fill_table(system, grids),
        x_breaks=grids[0].breaks,
        y_breaks=grids[1].breaks,
        x_cells=grids[0].cells,
        y_cells=grids[1].cells,
    )
    return Prepared(system, fis, error_bound(system, fis, grids))


def _certain() -> Array:
    """Return two terms that everything is, in place of the input that is not there."""
    return np.tile([-1.0, -1.0, 1.0, 1.0], (2, 1))


def _functions(system: FuzzySystem, output: Functions) -> Array:
    """Return f0, f1, f2 of each function for normalised inputs and output, (m, 3)."""
    rows = np.zeros((len(output.coefficients), 3))
    for row, (_, (constant, *factors)) in zip(rows, output.coefficients, strict=True):
        row[0] = constant - output.middle
        for i, (variable, factor) in enumerate(zip(system.inputs, factors, strict=False)):
            row[0] += factor * variable.middle
            row[i + 1] = factor * variable.half
    return rows / output.half


def _closed_form(system: FuzzySystem, output: Variable, rules: IntArray) -> tuple[int, float, float, Array] | None:
    """Return method, spacing and middle of the output's terms, and the consequents' centres in these units."""
    if system.aggregation == "sum-min" or (system.aggregation, system.defuzzification) == ("max-min", "cog"):
        method = SUM
    elif system.aggregation == "max-min":
        method = UNION
    else:
        return None
    corners = output.corners()
    spacing = _spacing(corners[:, 1])
    if spacing is None or not all(map(_is_partition, system.inputs)):
        return None
    wanted = corners[:, 1:2] + spacing * np.array([-1.0, 0.0, 0.0, 1.0])
    if np.max(np.abs(corners - wanted)) > SAME:
        return None
    last = len(corners) - 1
    offset = 0.5 * (corners[0, 1] + corners[-1, 1])
    table = np.where(rules >= 0, rules - 0.5 * last, np.nan)
    return STAIRCASE if method == UNION and _is_staircase(table) else method, spacing, float(offset), table


def _spacing(peaks: Array) -> float | None:
    """Return the distance between neighbouring peaks when it is always the same."""
    if len(peaks) < 2:
        return None
    spacing = float(peaks[-1] - peaks[0]) / (len(peaks) - 1)
    even = peaks[0] + spacing * np.arange(len(peaks))
    return spacing if np.max(np.abs(peaks - even)) <= SAME else None


def _is_partition(variable: Variable) -> bool:
    """Whether the terms are triangles evenly spaced from -1 to 1, each reaching to its neighbours' peaks.

    What lies outside [-1, 1] does not matter, as inputs are clipped: the outer terms may have any shape there.
    """
    if len(variable.terms) < 2:
        return False
    corners = variable.corners()
    corners[0, :2], corners[-1, 2:] = np.minimum(corners[0, :2], -1.0), np.maximum(corners[-1, 2:], 1.0)
    peaks = np.linspace(-1.0, 1.0, len(corners))
    wanted = np.column_stack([np.roll(peaks, 1), peaks, peaks, np.roll(peaks, -1)])
    wanted[0, :2], wanted[-1, 2:] = corners[0, :2], corners[-1, 2:]
    return bool(np.max(np.abs(corners - wanted)) <= SAME)


def _is_staircase(table: Array) -> bool:
    """Whether every 2x2 cell is b - 1 or b, then b twice, then b or b + 1; see `inference.staircase`."""
    b = table[:-1, 1:]
    rise = np.stack([b - table[:-1, :-1], table[1:, 1:] - b])
    return bool(np.all(table[1:, :-1] == b) and np.all((rise == 0.0) | (rise == 1.0)))
