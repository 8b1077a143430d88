"""Tables of outputs for systems without a closed form, and a bound on the error of interpolating in them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import fill_outputs
from torquebench.fuzzy.oracle import oracle
from torquebench.fuzzy.system import FuzzySystem
from torquebench.fuzzy.terms import SAME, Variable
from torquebench.kernel import Array

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
    """Return nodes that include every corner of an input's terms; None stands for an input that is not there."""
    if variable is None:
        return Grid(np.array([-1.0, 1.0]), 1)
    corners = np.sort(np.clip(np.append(variable.corners().ravel(), [-1.0, 1.0]), -1.0, 1.0))
    breaks = corners[np.append(True, np.diff(corners) > SAME)]
    breaks[-1] = 1.0
    return Grid(breaks, math.ceil(CELLS / (len(breaks) - 1)))


def fill_table(system: FuzzySystem, grids: tuple[Grid, Grid]) -> Array:
    """Return the outputs at all nodes by scikit-fuzzy, (N1, N2)."""
    return _on(system, grids[0].nodes(), grids[1].nodes())


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
    x, y = (_between(grid) if grid.cells > 1 or len(grid.breaks) > 2 else np.zeros(1) for grid in grids)
    error = np.empty(len(x) * len(y))
    xx, yy = (np.ascontiguousarray(a.ravel()) for a in np.meshgrid(x, y, indexing="ij"))
    fill_outputs(fis, xx, yy, error)
    error = error.reshape(len(x), len(y)) - _on(system, x, y)
    bound = float(np.max(np.abs(error)))
    for axis, points in enumerate((x, y)):
        if len(points) > 1:
            bound += 0.5 * float(np.max(np.abs(np.diff(error, axis=axis))))
    return bound


def _between(grid: Grid) -> Array:
    """Return the points in the middle of the thirds of the cells."""
    return grid.nodes(6)[1::2]


def _on(system: FuzzySystem, x: Array, y: Array) -> Array:
    """Return the outputs by scikit-fuzzy on the grid of x and y, (len(x), len(y))."""
    xx, yy = np.meshgrid(x, y, indexing="ij")
    return oracle(system, xx.ravel(), yy.ravel()).reshape(len(x), len(y))
