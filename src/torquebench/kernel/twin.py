"""Kernels as plain Python, compiled by nothing: the same source on Python's numbers, or on whole columns of numbers.

Compiling a kernel takes seconds, and most work needs fewer: a short run, or a term of the dynamics at some thousand
instants. What Python or numpy computes here has the bytes of the compiled kernel, because both do the same operations
in the same order and take the sine from the same library.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core import config

from torquebench.kernel import Array, is_foreign
from torquebench.kernel.struct import Structure

BLOCK = 4096
"""States that are computed at once."""
FEW = 4
"""States up to which one after the other is quicker than all at once."""
WORTH = 300_000
"""States whose terms take as long as rows of numbers as it takes to compile what computes them: some 4 s."""

_mapped: Counter[Any] = Counter()
"""States mapped so far by kernels that are not compiled yet, by the compiled form that there is."""


def rebound(function: FunctionType, stand_in: Callable[[Any], Any]) -> FunctionType:
    """Return a function of the same code in which every name of its module that it uses means ``stand_in(value)``."""
    named = function.__code__.co_names
    seen = {name: stand_in(value) if name in named else value for name, value in function.__globals__.items()}
    return FunctionType(function.__code__, seen, function.__name__, function.__defaults__, function.__closure__)


def _twin(kernel: Any, own_math: ModuleType, done: dict[Any, FunctionType]) -> Any:
    """Return a kernel, or a function that calls kernels, as plain Python.

    Args:
        kernel: The function.
        own_math: What `math` is in kernels.
        done: Twins that are made already, by function.
    """
    function = getattr(kernel, "py_func", kernel)
    own = own_math if getattr(function, "is_kernel", False) else math  # a law's own `math` raises, compiled too

    def stand_in(value: Any) -> Any:
        if value is math:
            return own
        plain = getattr(value, "py_func", value)
        called = getattr(plain, "is_kernel", False) and not is_foreign(plain)
        return _twin(plain, own_math, done) if called else value

    if function not in done:
        done[function] = function  # one that calls itself
        done[function] = rebound(function, stand_in)
    return done[function]


def _math(**own: Callable[[Any], Any]) -> ModuleType:
    module = ModuleType("math")
    module.__dict__.update({**vars(math), **own})
    return module


_NUMBERS = _math(
    sin=lambda x: math.sin(x) if abs(x) < math.inf else math.nan,
    cos=lambda x: math.cos(x) if abs(x) < math.inf else math.nan,
)
"""Gives NaN for what has no sine, as compiled code does."""


def _each(function: Callable[[float], float]) -> Callable[[Any], Any]:
    """Return a function of a number or of a column, each element of which it takes by itself."""

    def of(x: Any) -> Any:
        if isinstance(x, Column):
            return np.fromiter(map(function, x.tolist()), np.float64, len(x)).view(Column)
        return function(x)

    return of


_COLUMNS = _math(sin=_each(math.sin), cos=_each(math.cos), exp=_each(math.exp))


@lru_cache(maxsize=256)
def on_numbers(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel, or a function that calls kernels of this package, as plain Python on `python_numbers`."""
    twin: Callable[..., Any] = _twin(kernel, _NUMBERS, {})
    return twin


@lru_cache(maxsize=256)
def on_columns(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel without branches on numbers as plain Python in which every number is a `Column`."""
    twin: Callable[..., Any] = _twin(kernel, _COLUMNS, {})
    return twin


class Column(np.ndarray[Any, Any]):
    """One number of a kernel at many states, (N,); like a number it is never changed, only replaced."""

    __slots__ = ()

    def __iadd__(self, other: Any) -> Any:  # type: ignore[misc]
        """Return the sum, which is another column."""
        return self + other

    def __isub__(self, other: Any) -> Any:  # type: ignore[misc]
        """Return the difference, which is another column."""
        return self - other

    def __imul__(self, other: Any) -> Any:  # type: ignore[misc]
        """Return the product, which is another column."""
        return self * other


class Columns:
    """An array of a kernel at many states: its shape, then (N,); its elements read as columns.

    Args:
        array: The numbers, (..., N).
    """

    __slots__ = ("array", "shape")

    def __init__(self, array: Array) -> None:
        self.array = array
        self.shape = array.shape[:-1]

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, key: Any) -> Any:
        part = self.array[key]
        return part.copy().view(Column) if part.ndim == 1 else Columns(part)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.array[key] = value


def map_states(
    kernel: Callable[..., None],
    model: Any,
    states: list[Array],
    *shapes: tuple[int, ...],
    branches: bool = False,
    rows: Callable[..., None] | None = None,
) -> list[Array]:
    """Return what a kernel ``(model, *states, *results)`` fills its results with, at each of N states.

    Args:
        kernel: The kernel.
        model: Its first argument, of which only a field ``scratch`` is written to.
        states: Its next arguments at each state, (N, ...).
        shapes: Shape of each result at one state.
        branches: Whether what it does depends on the numbers, so that each state must be taken by itself.
        rows: A kernel that does the same to all states, (N, ...), and may be compiled: it is used where it is compiled
            already, in this process or in the cache on disk, and from `WORTH` states in this process on.

    Returns:
        Each result, (N, *shape).
    """
    count = len(states[0])
    results = [np.empty((count, *shape)) for shape in shapes]
    if rows is not None and not config.DISABLE_JIT:
        given = [np.array(x) for x in states]  # which may be written to, so that there is one signature
        if _is_worth(rows, (model, *given, *results), count):
            rows(model, *given, *results)
            return results
    if branches or count <= FEW:
        function, own = on_numbers(kernel), python_numbers(model)
        for k in range(count):
            function(own, *(python_numbers(x[k]) for x in (*states, *results)))
        return results
    function = on_columns(kernel)
    for first in range(0, count, BLOCK):
        block = slice(first, first + BLOCK)
        seen = [Columns(np.ascontiguousarray(np.moveaxis(x[block], 0, -1))) for x in states]
        size = seen[0].array.shape[-1]
        filled = [Columns(np.empty((*shape, size))) for shape in shapes]
        function(_with_scratch(model, size), *seen, *filled)
        for result, columns in zip(results, filled, strict=True):
            result[block] = np.moveaxis(columns.array, -1, 0)
    return results


def _is_worth(rows: Any, arguments: tuple[Any, ...], count: int) -> bool:
    """Return whether to use a compiled kernel, or to compile it; see `map_states`."""
    if not rows.overloads and not rows._cache.holds(tuple(map(rows.typeof_pyval, arguments))):
        _mapped[rows] += count
        return _mapped[rows] >= WORTH
    return True


def _with_scratch(model: Any, count: int) -> Any:
    """Return a model with scratch space for `count` states, if it has any."""
    if not hasattr(model, "scratch"):
        return model
    twin, scratch = copy.copy(model), model.scratch
    columns = type(scratch)(*(Columns(np.zeros((*x.shape, count))) for x in scratch))
    object.__setattr__(twin, "scratch", columns)
    return twin


class Vector(np.ndarray[Any, Any]):
    """A vector of Python's numbers."""

    __slots__ = ()
    __getitem__ = np.ndarray.item  # type: ignore[assignment]


class Matrix(np.ndarray[Any, Any]):
    """An array of more dimensions; its rows are vectors of Python's numbers."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """Return an element as a number, or a part as an array of the same manner."""
        if type(key) is tuple and len(key) == self.ndim:
            return self.item(key)
        return np.ndarray.__getitem__(self, key).view(Vector if self.ndim == 2 else Matrix)


def python_numbers(value: Any) -> Any:
    """Return an array, or a structure of arrays, as views whose elements read as Python numbers."""
    kind = type(value)
    if kind is Vector or kind is float or kind is int:
        return value
    if kind is np.ndarray:
        return value.view(Vector if value.ndim == 1 else Matrix)
    if isinstance(value, Structure):
        return _structure(value)
    if isinstance(value, np.ndarray):
        return value.view(Vector if value.ndim == 1 else Matrix)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return kind(*[python_numbers(field) for field in value])
    return value


def _structure(value: Structure) -> Structure:
    """Convert a structure, which takes its time; it keeps the result, because a run has the same one at every call."""
    kept: Structure | None = vars(value).get("_python_numbers")
    if kept is None:
        kept = copy.copy(value)  # of the same words: the arrays are the same memory
        for field in dataclasses.fields(value):
            object.__setattr__(kept, field.name, python_numbers(getattr(value, field.name)))
        object.__setattr__(value, "_python_numbers", kept)
    return kept
