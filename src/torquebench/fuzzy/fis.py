"""A fuzzy system as kernels see it: numbers and arrays, and the method by which it is evaluated."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from torquebench.kernel import Array, IntArray

STAIRCASE = 0
"""Method: exact, max-min and centre of area, on a table whose 2x2 cells are stairs (see `inference.staircase`)."""
UNION = 1
"""Method: exact, max-min and centre of area, on any table."""
SUM = 2
"""Method: exact, the clipped consequents of all rules added up."""
SUGENO = 3
"""Method: exact, weighted mean of the rules' functions."""
TABLE = 4
"""Method: bilinear interpolation in a table of outputs."""

MIN, PRODUCT = 0, 1
"""Codes of the conjunction (AND); OR is its dual: the maximum, or a + b - a b."""
STRAIGHT, GAUSSIAN, BELL, SIGMOID = 0.0, 1.0, 2.0, 3.0
"""Codes of a term's shape: a trapezoid, or a curve."""


class Fis(NamedTuple):
    """A fuzzy inference system in normalised units: both inputs and the output are nominally in [-1, 1].

    A system of one input is stored as one of two whose second input makes no difference.
    """

    method: int
    """STAIRCASE, UNION, SUM, SUGENO or TABLE."""
    conjunction: int
    """MIN or PRODUCT."""
    inputs: int
    """Number of inputs, 1 or 2."""
    rules: Annotated[IntArray, 2]
    """Index of each rule's consequent, (n1, n2); -1 where there is no rule. Where rules leave an input open, its last
    term is one to which everything belongs."""
    x_terms: Annotated[Array, 2]
    """Terms of input 1, (n1, 5): feet and shoulders a <= b <= c <= d and the code STRAIGHT; or centre, width, exponent
    or slope, nothing, and the code of a curve."""
    y_terms: Annotated[Array, 2]
    """The same of input 2, (n2, 5)."""
    scale: float = 1.0
    """Exact methods: spacing of the output's terms."""
    offset: float = 0.0
    """Exact methods: middle of the output's terms."""
    table: Annotated[Array, 2] = np.zeros((2, 2))
    """Exact Mamdani methods: centre of each rule's consequent, (n1, n2) in units of `scale` from `offset`, NaN where
    there is no rule; TABLE: output at each node, (N1, N2)."""
    functions: Annotated[Array, 2] = np.zeros((0, 3))
    """SUGENO: consequent f0 + f1 x + f2 y of each name, (m, 3)."""
    x_breaks: Array = np.zeros(2)
    """TABLE: where the terms of input 1 have corners; nodes are evenly spaced between two of them."""
    y_breaks: Array = np.zeros(2)
    """The same of input 2."""
    x_cells: int = 1
    """TABLE: cells between two breaks of input 1."""
    y_cells: int = 1
    """The same of input 2."""
    either: Annotated[IntArray, 2] = np.zeros((0, 0), dtype=np.int64)
    """Index of the consequent of each rule that fires where one of two terms does (OR), (n1, n2), -1 where there is
    none; (0, 0) if there is no such rule."""
