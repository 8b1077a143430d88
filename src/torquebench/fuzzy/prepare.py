"""From a definition to what kernels evaluate: exactly where there is a closed form, else from a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from torquebench.fuzzy.fis import MIN, PRODUCT, STAIRCASE, SUGENO, SUM, TABLE, UNION, Fis
from torquebench.fuzzy.inference import fill_outputs
from torquebench.fuzzy.system import FuzzySystem
from torquebench.fuzzy.table import defined_outputs, error_bound, grid_for, outputs_on
from torquebench.fuzzy.terms import EVERYTHING, SAME, Functions, Variable
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

    def evaluate(self, *values: float) -> float:
        """Return the output for one value of each input, all in the variables' own units.

        It is by definition: of a table, what the table was made of.

        Args:
            values: One for each input; each is clipped to its range.

        Raises:
            ValueError: there are more or fewer than inputs.
        """
        x, y = self._normalised(values)
        exact = self.outputs if self.fis.method != TABLE else partial(defined_outputs, self.system)
        output = self.system.output
        return output.middle + output.half * float(exact(x, y)[0])

    def in_loop(self, *values: float) -> float:
        """Return the output as the loop evaluates it; see `evaluate`."""
        output = self.system.output
        return output.middle + output.half * float(self.outputs(*self._normalised(values))[0])

    def _normalised(self, values: tuple[float, ...]) -> tuple[Array, Array]:
        pairs = zip(self.system.inputs, values, strict=True)
        at = [np.array([(value - variable.middle) / variable.half]) for variable, value in pairs]
        return at[0], at[-1]

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
    first, second = system.inputs[0], system.inputs[1] if len(system.inputs) == 2 else None
    rules = system.table if second is not None else np.repeat(system.table[:, None], 2, axis=1)
    # of the input that is not there everything is each of two terms
    y_terms = np.tile(EVERYTHING, (2, 1)) if second is None else second.rows(system.is_open[1])
    conjunction = PRODUCT if system.conjunction == "product" else MIN
    x_terms = first.rows(system.is_open[0])
    fis = Fis(TABLE, conjunction, len(system.inputs), rules.astype(np.int64), x_terms, y_terms)
    if system.either_table.size:
        fis = fis._replace(either=system.either_table.astype(np.int64))
    if isinstance(system.output, Functions):
        return Prepared(system, fis._replace(method=SUGENO, functions=_functions(system, system.output)), 0.0)
    form = _closed_form(system, system.output, rules)
    if form is not None:
        return Prepared(system, fis._replace(**form), 0.0)
    grids = grid_for(first), grid_for(second)
    table = outputs_on(system, grids[0].nodes(), grids[1].nodes())
    fis = fis._replace(table=table, x_breaks=grids[0].breaks, x_cells=grids[0].cells)
    fis = fis._replace(y_breaks=grids[1].breaks, y_cells=grids[1].cells)
    return Prepared(system, fis, error_bound(system, fis, grids))


def _functions(system: FuzzySystem, output: Functions) -> Array:
    """Return f0, f1, f2 of each function for normalised inputs and output, (m, 3)."""
    rows = np.zeros((len(output.coefficients), 3))
    for row, (_, (constant, *factors)) in zip(rows, output.coefficients, strict=True):
        row[0] = constant - output.middle
        for i, (variable, factor) in enumerate(zip(system.inputs, factors, strict=False)):
            row[0] += factor * variable.middle
            row[i + 1] = factor * variable.half
    return rows / output.half


def _closed_form(system: FuzzySystem, output: Variable, rules: IntArray) -> dict[str, Any] | None:
    """Return the fields of a `Fis` that is exact: method, spacing and middle of the output's terms, and the table."""
    if any(system.is_open) or system.either_table.size or any(term.curve for term in output.terms):
        return None
    corners = output.corners()
    last = len(corners) - 1
    if system.aggregation not in ("max-min", "sum-min") or last < 1 or not all(map(_is_partition, system.inputs)):
        return None
    first, spacing = corners[0, 1], float(corners[-1, 1] - corners[0, 1]) / last
    peaks = first + spacing * np.arange(last + 1)
    wanted = peaks[:, None] + spacing * np.array([-1.0, 0.0, 0.0, 1.0])
    if np.max(np.abs(corners - wanted)) > SAME:
        return None
    table = np.where(rules >= 0, rules - 0.5 * last, np.nan)
    method = STAIRCASE if _is_staircase(table) else UNION
    if (system.aggregation, system.defuzzification) != ("max-min", "coa"):
        method = SUM
    return {"method": method, "scale": spacing, "offset": float(0.5 * (first + corners[-1, 1])), "table": table}


def _is_partition(variable: Variable) -> bool:
    """Whether the terms are triangles evenly spaced from -1 to 1, each reaching to its neighbours' peaks.

    What lies outside [-1, 1] does not matter, as inputs are clipped: the outer terms may have any shape there.
    """
    if len(variable.terms) < 2 or any(term.curve for term in variable.terms):
        return False
    corners, peaks = variable.corners(), np.linspace(-1.0, 1.0, len(variable.terms))
    off = np.abs(corners - np.column_stack([np.roll(peaks, 1), peaks, peaks, np.roll(peaks, -1)]))
    off[0, :2], off[-1, 2:] = 0.0, 0.0
    return bool(np.max(off) <= SAME)


def _is_staircase(table: Array) -> bool:
    """Whether every 2x2 cell is b - 1 or b, then b twice, then b or b + 1; see `inference.staircase`."""
    b = table[:-1, 1:]
    rise = np.stack([b - table[:-1, :-1], table[1:, 1:] - b])
    return bool(np.all(table[1:, :-1] == b) and np.all((rise == 0.0) | (rise == 1.0)))
