"""Arrays whose elements read as Python's own numbers, whose arithmetic is the one that compiled laws are given.

An element of a numpy array is a number of numpy's, which divides by zero without raising.
"""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numpy as np

from torquebench.kernel.struct import Structure


class Vector(np.ndarray[Any, Any]):
    """A vector of Python's numbers."""

    __slots__ = ()
    __getitem__ = np.ndarray.item  # type: ignore[assignment]


class Table(np.ndarray[Any, Any]):
    """An array of more dimensions; its rows are vectors of Python's numbers."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """Return an element as a number, or a part as an array of the same manner."""
        return python_numbers(np.ndarray.__getitem__(self, key))


def python_numbers(value: Any) -> Any:
    """Return views of an array, or of all arrays in a structure, whose elements are Python's numbers; no copies."""
    kind = type(value)
    if kind is np.ndarray:
        return value.view(Vector if value.ndim == 1 else Table)
    if kind is float or kind is int:
        return value
    if isinstance(value, Structure):
        return _structure(value)
    if isinstance(value, np.ndarray):
        return value.view(Vector if value.ndim == 1 else Table)
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
