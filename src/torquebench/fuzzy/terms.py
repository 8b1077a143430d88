"""Linguistic variables: a range of numbers, and named terms that overlap on it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.errors import Finding, FuzzyError
from torquebench.kernel import Array

Shape: TypeAlias = float | tuple[float, ...]
"""A number, the peak of a triangle; or a triangle's [a, b, c]; or a trapezoid's [a, b, c, d]."""

MAX_TERMS = 25
SAME = 1e-9
"""Corners of terms this close, in units of half the range, count as the same."""
FAR = 1e6
"""A term that reaches this many times as far as the range is taken for a slip."""
TERM = re.compile(r"[\w+-]{1,24}")
NONE = "none"
"""Stands in a rule table where there is no rule, so no term may have this name."""


class Term(NamedTuple):
    """A trapezoid: degree 0 outside its feet a and d, 1 between its shoulders b and c; a triangle has b = c."""

    name: str
    a: float
    b: float
    c: float
    d: float

    @property
    def peak(self) -> float:
        """Middle of the shoulders."""
        return 0.5 * (self.b + self.c)


class Ranged:
    """Something whose range, from `low` to `high`, the law sees as [-1, 1]."""

    __slots__ = ()
    low: float
    high: float

    @property
    def middle(self) -> float:
        """The number that the law sees as 0."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Half the width of the range: what the law sees as 1."""
        return 0.5 * (self.high - self.low)

    def range_errors(self) -> list[Finding]:
        """Return what is wrong with the range; the place is below the variable."""
        wrong = range_error(self.low, self.high)
        return [] if wrong is None else [Finding("range", "error", ("range",), wrong)]


@dataclass(frozen=True, slots=True)
class Variable(Ranged):
    """An input or output: its terms from low to high, and the range that the law sees as [-1, 1].

    Terms of an output may reach beyond the range; an input is clipped to it.
    """

    terms: tuple[Term, ...]
    low: float = -1.0
    high: float = 1.0

    @classmethod
    def of(cls, shapes: Mapping[str, Shape], low: float = -1.0, high: float = 1.0) -> Variable:
        """Return a variable from the shapes of its terms.

        Args:
            shapes: Name -> shape. A single number is the peak of a triangle whose feet lie under the neighbours'
                peaks; the first and the last such triangle are symmetric.
            low, high: The range.

        Raises:
            FuzzyError: a shape has a mistake.
        """
        mistakes = shape_errors(shapes)
        if mistakes:
            raise FuzzyError("(variable)", mistakes)
        spans = [_span(shape) for shape in shapes.values()]
        terms = []
        for k, (name, (a, b, c, d)) in enumerate(zip(shapes, spans, strict=True)):
            if math.isnan(a):
                a = spans[k - 1][2] if k > 0 else 2.0 * b - spans[k + 1][1]
                d = spans[k + 1][1] if k + 1 < len(spans) else 2.0 * b - spans[k - 1][2]
            terms.append(Term(name, a, b, c, d))
        return cls(tuple(terms), low, high)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term.name for term in self.terms)

    @property
    def reach(self) -> tuple[float, float]:
        """The lowest foot of the terms and the highest."""
        return min(term.a for term in self.terms), max(term.d for term in self.terms)

    def reaches(self, name: str) -> bool:
        """Whether anything in the range belongs to a term at all."""
        term = self.terms[self.names.index(name)]
        return term.a < self.high and term.d > self.low

    def corners(self) -> Array:
        """Return feet and shoulders of the terms, (n, 4), in units in which the range is [-1, 1]."""
        return (np.array([term[1:] for term in self.terms], dtype=np.float64) - self.middle) / self.half

    def errors(self) -> list[Finding]:
        """Return what is wrong with the variable; places are below it."""
        findings = self.range_errors()
        wrong = _repeated("terms", self.names) + shape_errors({term.name: term[1:] for term in self.terms})
        if not wrong and not findings:
            with np.errstate(over="ignore"):
                far = np.max(np.abs(self.corners()), axis=1)
            for term, distance in zip(self.terms, far, strict=True):
                if not distance <= FAR:
                    message = f"reaches beyond {FAR:g} times the range; change it, or the range"
                    wrong.append(Finding("far", "error", ("terms", term.name), message))
        return findings + wrong


@dataclass(frozen=True, slots=True)
class Functions(Ranged):
    """Output of Sugeno's kind: each name is a function c0 + c1 x1 (+ c2 x2) of the inputs, in the inputs' own units."""

    coefficients: tuple[tuple[str, tuple[float, ...]], ...]
    """(name, (c0,) or (c0, c1[, c2])) in the order of the definition."""
    low: float = -1.0
    high: float = 1.0
    """The range that the law sees as [-1, 1]."""

    @classmethod
    def of(cls, shapes: Mapping[str, float | Sequence[float]], low: float = -1.0, high: float = 1.0) -> Functions:
        """Return functions from name -> a constant, or the numbers c0, c1 (, c2); `low` and `high` bound the range."""
        pairs = ((name, tuple(x) if isinstance(x, Sequence) else (float(x),)) for name, x in shapes.items())
        return cls(tuple(pairs), low, high)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the functions."""
        return tuple(name for name, _ in self.coefficients)

    def errors(self, inputs: int) -> list[Finding]:
        """Return what is wrong with the functions of so many `inputs`; places are below the variable."""
        findings = self.range_errors() + _repeated("functions", self.names) + _misnamed("functions", self.names)
        for name, numbers in self.coefficients:
            if len(numbers) not in (1, inputs + 1) or not all(map(math.isfinite, numbers)):
                wanted = f"wanted one, or {inputs + 1}: a constant and a factor of each input"
                message = f"got {len(numbers)} numbers, {wanted}"
                findings.append(Finding("function", "error", ("functions", name), message))
        return findings


def range_error(low: float, high: float) -> str | None:
    """Return why a variable cannot have the range from `low` to `high`, or None."""
    if low < high and math.isfinite(high - low):
        return None
    return f"got [{low:g}, {high:g}], wanted two finite numbers, the lower one first"


def _repeated(key: str, names: Sequence[str]) -> list[Finding]:
    twice = sorted({name for name in names if names.count(name) > 1})
    return [Finding("name", "error", (key, name), "this name is given twice") for name in twice]


def _misnamed(key: str, names: Iterable[str]) -> list[Finding]:
    wrong = {name: "its name is not 1 to 24 letters, digits, _, + or -" for name in names if not TERM.fullmatch(name)}
    if NONE in names:
        wrong[NONE] = f"'{NONE}' stands for a missing rule: choose another name"
    return [Finding("name", "error", (key, name), message) for name, message in wrong.items()]


def _span(shape: Shape) -> tuple[float, float, float, float]:
    """Return feet and shoulders; the feet of a lone peak are NaN."""
    if isinstance(shape, int | float):
        return math.nan, float(shape), float(shape), math.nan
    a, *middle, d = (float(x) for x in shape)
    return a, middle[0], middle[-1], d


def shape_errors(shapes: Mapping[str, Shape]) -> list[Finding]:
    """Return what is wrong with the shapes of a variable's terms; places are below the variable."""
    if not 1 <= len(shapes) <= MAX_TERMS:
        message = f"got {len(shapes)} terms, wanted 1 to {MAX_TERMS}"
        return [Finding("shape", "error", ("terms",), message)]
    wrong = {name: _shape_error(shape, len(shapes) == 1) for name, shape in shapes.items()}
    misnamed = _misnamed("terms", shapes)
    if not misnamed and not any(wrong.values()):
        for (_, low), (name, high) in itertools.pairwise((n, _span(s)) for n, s in shapes.items()):
            if not low[1] + low[2] < high[1] + high[2]:
                below = f"is not above that of the term before it, {0.5 * (low[1] + low[2]):g}"
                wrong[name] = f"its peak, {0.5 * (high[1] + high[2]):g}, {below}: list the terms from low to high"
    return misnamed + [Finding("shape", "error", ("terms", name), text) for name, text in wrong.items() if text]


def _shape_error(shape: Shape, is_alone: bool) -> str:
    numbers = shape if isinstance(shape, Sequence) else (shape,)
    got = f"got [{', '.join(f'{x:g}' for x in numbers)}]"
    if not all(map(math.isfinite, numbers)):
        return f"{got}, wanted finite numbers"
    if not isinstance(shape, Sequence):
        return "a peak alone has no neighbours to reach to: give [a, b, c]" if is_alone else ""
    wanted = "wanted 3 numbers (a triangle) or 4 (a trapezoid)"
    if len(shape) not in (3, 4):
        return f"got {len(shape)} numbers, {wanted}, or one number, a peak"
    if any(x > y for x, y in itertools.pairwise(shape)):
        return f"{got}, {wanted} in ascending order"
    return f"{got}, which has no width: move the feet apart" if shape[0] == shape[-1] else ""
