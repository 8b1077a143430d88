"""A digest of the last bits that processor and C library give to the functions of laws, for fixed numbers."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable

import numpy as np

from torquebench.kernel import Array, kernel

SIZE = 2000
"""Numbers, so many that routines which differ in the last bit once in some hundred arguments do in one of them."""
COLUMNS = 10


@kernel
def fill(out: Array) -> None:
    """Fill a table, (SIZE, COLUMNS), with functions of the numbers 0.1, 0.4, 0.7 .., and with sums of their products.

    The last two columns are others where a product and a sum are rounded once, as a fused instruction does.
    """
    total = 0.0
    for k in range(SIZE):
        x = 0.3 * k + 0.1
        s, c = math.sin(x), math.cos(x)
        out[k, 0], out[k, 1] = s, c
        out[k, 2] = math.exp(-0.1 * x)
        out[k, 3] = math.tanh(0.01 * x)
        out[k, 4] = math.log(x)
        out[k, 5] = math.pow(x, 0.7)
        out[k, 6] = math.sqrt(x)
        out[k, 7] = math.atan2(s, x)
        out[k, 8] = s * s + c * c - 1.0
        total = total + s * x
        out[k, 9] = total


def digest(function: Callable[[Array], None]) -> str:
    """Return a digest of the table that a function fills, of 16 hexadecimal digits."""
    table = np.empty((SIZE, COLUMNS))
    function(table)
    return hashlib.sha256(table.tobytes()).hexdigest()[:16]


@functools.cache
def interpreted() -> str:
    """Return the digest of Python's numbers."""
    return digest(getattr(fill, "py_func", fill))


def compiled() -> str:
    """Return the digest of compiled code, which is compiled for it where it is not yet."""
    return digest(fill)
