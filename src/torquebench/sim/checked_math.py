"""`math` as compiled laws see it: outside a function's domain it raises, as Python's does, instead of giving NaN.

A law that squashes an infinity, `sat(math.exp(x))`, would otherwise go on where Python stops. `floor` raises beyond
the range of an integer of 64 bits too, where Python goes on.
"""

from __future__ import annotations

import math
from math import atan, atan2, copysign, fabs, inf, isfinite, isnan, nan, pi, tanh  # these raise nothing
from types import FunctionType, ModuleType
from typing import Any

from numba.extending import register_jitable

from torquebench.kernel.twin import rebound

__all__ = [
    "acos",
    "asin",
    "atan",
    "atan2",
    "copysign",
    "cos",
    "cosh",
    "exp",
    "expm1",
    "fabs",
    "floor",
    "inf",
    "isfinite",
    "isnan",
    "log",
    "log1p",
    "nan",
    "pi",
    "sin",
    "sinh",
    "sqrt",
    "tan",
    "tanh",
]
WHOLE = 9223372036854775808.0
"""2^63, the first whole number that does not fit into an integer of 64 bits."""


@register_jitable
def sin(x: float) -> float:
    """Sine."""
    if abs(x) == inf:
        raise ValueError("math domain error")
    return math.sin(x)


@register_jitable
def cos(x: float) -> float:
    """Cosine."""
    if abs(x) == inf:
        raise ValueError("math domain error")
    return math.cos(x)


@register_jitable
def tan(x: float) -> float:
    """Tangent."""
    if abs(x) == inf:
        raise ValueError("math domain error")
    return math.tan(x)


@register_jitable
def asin(x: float) -> float:
    """Inverse sine."""
    if abs(x) > 1.0:
        raise ValueError("math domain error")
    return math.asin(x)


@register_jitable
def acos(x: float) -> float:
    """Inverse cosine."""
    if abs(x) > 1.0:
        raise ValueError("math domain error")
    return math.acos(x)


@register_jitable
def sqrt(x: float) -> float:
    """Square root."""
    if x < 0.0:
        raise ValueError("math domain error")
    return math.sqrt(x)


@register_jitable
def exp(x: float) -> float:
    """Exponential."""
    y = math.exp(x)
    if y == inf and x < inf:
        raise OverflowError("math range error")
    return y


@register_jitable
def expm1(x: float) -> float:
    """Exponential less one."""
    y = math.expm1(x)
    if y == inf and x < inf:
        raise OverflowError("math range error")
    return y


@register_jitable
def sinh(x: float) -> float:
    """Hyperbolic sine."""
    y = math.sinh(x)
    if abs(y) == inf and abs(x) < inf:
        raise OverflowError("math range error")
    return y


@register_jitable
def cosh(x: float) -> float:
    """Hyperbolic cosine."""
    y = math.cosh(x)
    if y == inf and abs(x) < inf:
        raise OverflowError("math range error")
    return y


@register_jitable
def log(x: float) -> float:
    """Natural logarithm."""
    if x <= 0.0:
        raise ValueError("math domain error")
    return math.log(x)


@register_jitable
def log1p(x: float) -> float:
    """Natural logarithm of 1 + x."""
    if x <= -1.0:
        raise ValueError("math domain error")
    return math.log1p(x)


@register_jitable
def floor(x: float) -> int:
    """Largest whole number not above x."""
    if not abs(x) < WHOLE:
        raise ValueError("cannot convert to an integer")
    return math.floor(x)


def with_checked_math(function: FunctionType) -> FunctionType:
    """Return a function of the same code for which `math` is this module, under whatever name it was imported."""

    def stand_in(value: Any) -> Any:
        if value is math:
            return _MODULE
        name = getattr(value, "__name__", "")
        return getattr(_MODULE, name) if name in __all__ and value is getattr(math, name) else value

    return rebound(function, stand_in)


_MODULE = ModuleType("math")
for _name in __all__:
    setattr(_MODULE, _name, globals()[_name])
