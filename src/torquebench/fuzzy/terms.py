"""Linguistic variables: a range of numbers, and named terms that overlap on it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from torquebench.errors import Fault, Finding, FuzzyError
from torquebench.fuzzy.fis import BELL, GAUSSIAN, SIGMOID, STRAIGHT
from torquebench.kernel import Array
from torquebench.keys import Key, Kinds, declared_keys

MAX_TERMS = 25
SAME = 1e-9
"""Corners of terms this close, in units of half the range, count as the same."""
FAR = 1e6
"""A term that reaches this many times as far as the range is taken for a slip."""
TERM = re.compile(r"[\w+-]{1,24}")
NONE = "none"
"""Stands in a rule table where there is no rule, so no term may have this name."""
ANY = "any"
"""Stands in a rule for an input that is left open, so no term may have this name."""
TRACE = 1e-12
"""A degree below counts as none, where the feet of a curved term are asked for."""
FULL = 1.0 - 1e-9
"""A degree above counts as 1, where the shoulders of a curved term are asked for."""

SHAPES = Kinds("shape of a term")


@SHAPES("gaussian")
@dataclass(frozen=True)
class Gaussian:
    """Degree exp(-(x - mean)^2 / (2 sigma^2))."""

    mean: Annotated[float, Key("Where the degree is 1, in the variable's own units", "1")]
    sigma: Annotated[float, Key("Distance from there at which it is exp(-1/2) = 0.607", "1", above=0.0)]

    def where(self, degree: float) -> tuple[float, float]:
        """Return between which numbers the degree is at least so much."""
        far = self.sigma * math.sqrt(-2.0 * math.log(degree))
        return self.mean - far, self.mean + far

    def row(self, middle: float, half: float) -> tuple[float, ...]:
        """Return how kernels see it: centre, width, exponent, nothing, code, where the range is [-1, 1]."""
        return (self.mean - middle) / half, self.sigma / half, 0.0, 0.0, GAUSSIAN


@SHAPES("bell")
@dataclass(frozen=True)
class Bell:
    """Degree 1 / (1 + abs((x - centre) / width)^(2 slope)), the generalised bell."""

    centre: Annotated[float, Key("Where the degree is 1, in the variable's own units", "1")]
    width: Annotated[float, Key("Distance from there at which it is 1/2", "1", above=0.0)]
    slope: Annotated[
        float, Key("Half the exponent: a larger one makes steeper sides", "1", at_least=0.1, at_most=100.0)
    ]

    def where(self, degree: float) -> tuple[float, float]:
        """Return between which numbers the degree is at least so much."""
        far = self.width * math.exp(math.log(1.0 / degree - 1.0) / (2.0 * self.slope))
        return self.centre - far, self.centre + far

    def row(self, middle: float, half: float) -> tuple[float, ...]:
        """Return how kernels see it; see `Gaussian.row`."""
        return (self.centre - middle) / half, self.width / half, 2.0 * self.slope, 0.0, BELL


@SHAPES("sigmoid")
@dataclass(frozen=True)
class Sigmoid:
    """Degree 1 / (1 + exp(-slope (x - centre))), a shoulder: to the right where the slope is above 0, else left."""

    centre: Annotated[float, Key("Where the degree is 1/2, in the variable's own units", "1")]
    slope: Annotated[float, Key("Four times the slope there; below 0 for a term that falls", "1")]

    def faults(self) -> Iterator[Fault]:
        """Yield what is wrong with it."""
        if self.slope == 0.0:
            yield Fault(("slope",), got="0", wanted="more than 0 for a term that rises, less for one that falls")

    def where(self, degree: float) -> tuple[float, float]:
        """Return between which numbers the degree is at least so much."""
        end = self.centre + math.log(degree / (1.0 - degree)) / self.slope
        return (end, math.inf) if self.slope > 0.0 else (-math.inf, end)

    def row(self, middle: float, half: float) -> tuple[float, ...]:
        """Return how kernels see it; see `Gaussian.row`."""
        return (self.centre - middle) / half, 1.0, self.slope * half, 0.0, SIGMOID


Curve: TypeAlias = Gaussian | Bell | Sigmoid
Shape: TypeAlias = float | tuple[float, ...] | Curve
"""A number, the peak of a triangle; or a triangle's [a, b, c]; or a trapezoid's [a, b, c, d]; or a curve."""


class Term(NamedTuple):
    """A trapezoid: degree 0 outside its feet a and d, 1 between its shoulders b and c; a triangle has b = c.

    Of a curved term the feet are where its degree is `TRACE`, and the shoulders where it is `FULL`; a sigmoid has only
    one of each, the others are infinite.
    """

    name: str
    a: float
    b: float
    c: float
    d: float
    curve: Curve | None = None

    @property
    def peak(self) -> float:
        """Middle of the shoulders; of a sigmoid, the one that there is."""
        if math.isinf(self.b) or math.isinf(self.c):
            return self.c if math.isinf(self.b) else self.b
        return 0.5 * (self.b + self.c)

    @property
    def corners(self) -> tuple[float, float, float, float]:
        """Feet and shoulders."""
        return self.a, self.b, self.c, self.d

    @property
    def shape(self) -> Shape:
        """How it is given: a curve, or feet and shoulders."""
        return self.curve or self.corners

    @property
    def base(self) -> float:
        """Width at its feet; of a curve that of the triangle that is as wide half-way up."""
        if self.curve is None:
            return self.d - self.a
        low, high = self.curve.where(0.5)
        return 2.0 * (high - low)


EVERYTHING = (-2.0, -2.0, 2.0, 2.0, STRAIGHT)
"""Term as kernels see it, to which everything in [-1, 1] belongs."""


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
        curves = [shape if isinstance(shape, Curve) else None for shape in shapes.values()]
        terms = []
        for k, (name, (a, b, c, d)) in enumerate(zip(shapes, spans, strict=True)):
            if math.isnan(a):
                a = spans[k - 1][2] if k > 0 else 2.0 * b - spans[k + 1][1]
                d = spans[k + 1][1] if k + 1 < len(spans) else 2.0 * b - spans[k - 1][2]
            terms.append(Term(name, a, b, c, d, curves[k]))
        return cls(tuple(terms), low, high)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term.name for term in self.terms)

    @property
    def reach(self) -> tuple[float, float]:
        """The lowest foot of the terms and the highest; a curved term, which has none, reaches through the range."""
        curved = (self.low, self.high)
        ends = [curved if term.curve else (term.a, term.d) for term in self.terms]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def reaches(self, name: str) -> bool:
        """Whether anything in the range belongs to a term at all; to `ANY` everything does."""
        if name == ANY:
            return True
        term = self.terms[self.names.index(name)]
        return term.a < self.high and term.d > self.low

    def corners(self) -> Array:
        """Return feet and shoulders of the terms, (n, 4), in units in which the range is [-1, 1]."""
        return (np.array([term.corners for term in self.terms], dtype=np.float64) - self.middle) / self.half

    def rows(self, is_open: bool = False) -> Array:
        """Return the terms as kernels see them, (n, 5), in units in which the range is [-1, 1].

        Args:
            is_open: Whether a last one, to which everything belongs, is added.
        """
        straight = np.column_stack([self.corners(), np.full(len(self.terms), STRAIGHT)])
        rows = [
            row if term.curve is None else term.curve.row(self.middle, self.half)
            for term, row in zip(self.terms, straight, strict=True)
        ]
        return np.array([*rows, EVERYTHING] if is_open else rows, dtype=np.float64)

    def breaks(self) -> Array:
        """Return where the terms have corners, or, curved ones, are at 1 %, 50 % and 99 %; normalised, sorted."""
        straight = [term.corners for term in self.terms if term.curve is None]
        curved = [term.curve.where(degree) for term in self.terms if term.curve for degree in (0.01, 0.5, 0.99)]
        places = np.array([x for ends in (*straight, *curved) for x in ends], dtype=np.float64)
        return np.sort((places - self.middle) / self.half)

    def errors(self) -> list[Finding]:
        """Return what is wrong with the variable; places are below it."""
        findings = self.range_errors()
        wrong = _repeated("terms", self.names) + shape_errors({term.name: term.shape for term in self.terms})
        if not wrong and not findings:
            with np.errstate(over="ignore"):
                rows = np.abs(self.rows()[:, :4])
            for term, row in zip(self.terms, rows, strict=True):
                if term.curve is not None and not min(row[1], row[2] or 1.0) >= 1.0 / FAR:
                    message = f"is narrower than {1.0 / FAR:g} of the range, or flatter; change it, or the range"
                    wrong.append(Finding("far", "error", ("terms", term.name), message))
                elif not np.max(row) <= FAR:
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
    if ANY in names and key == "terms":
        wrong[ANY] = f"'{ANY}' in a rule leaves the input open, without a term of that name: remove it, or rename it"
    return [Finding("name", "error", (key, name), message) for name, message in wrong.items()]


def _span(shape: Shape) -> tuple[float, float, float, float]:
    """Return feet and shoulders; the feet of a lone peak are NaN."""
    if isinstance(shape, Curve):
        (a, d), (b, c) = shape.where(TRACE), shape.where(FULL)
        return a, b, c, d
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
        for (_, low), (name, high) in itertools.pairwise(shapes.items()):
            (_, under), (_, above) = _order(low), _order(high)
            if not _order(low) < _order(high):
                below = f"is not above that of the term before it, {under:g}"
                wrong[name] = f"its peak, {above:g}, {below}: list the terms from low to high"
    return misnamed + [Finding("shape", "error", ("terms", name), text) for name, text in wrong.items() if text]


def _order(shape: Shape) -> tuple[int, float]:
    """Return where a term stands among others: sigmoids that fall before all, those that rise after all."""
    if isinstance(shape, Sigmoid):
        return (1 if shape.slope > 0.0 else -1), shape.centre
    _, b, c, _ = _span(shape)
    return 0, 0.5 * (b + c)


def _curve_error(curve: Curve) -> str:
    cls: Any = type(curve)
    for declared in declared_keys(cls):
        value = getattr(curve, declared.attribute)
        wanted = declared.key.fault(value)
        if wanted is not None:
            return f"its {declared.name} is {value:g}, wanted {wanted}"
    faults = curve.faults() if isinstance(curve, Sigmoid) else ()
    return next((f"its {fault.path[-1]} is {fault.got}, wanted {fault.wanted}" for fault in faults), "")


def _shape_error(shape: Shape, is_alone: bool) -> str:
    if isinstance(shape, Curve):
        return _curve_error(shape)
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
