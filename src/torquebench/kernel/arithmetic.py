"""Digests of the last bits that processor and libraries give, for fixed numbers: to laws, and to numpy's arrays."""

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


@functools.cache
def arrays() -> str:
    """Return the digest of numpy's: functions of arrays, and products, solutions and eigenvalues of small matrices.

    Its linear algebra picks other routines for other processors, in which sums have another order.
    """
    numbers = 0.3 * np.arange(SIZE) + 0.1
    table = [
        np.sin(numbers),
        np.exp(-0.1 * numbers),
        np.log(numbers),
        np.cumsum(np.sqrt(numbers)),
        np.fft.rfft(numbers),
    ]
    for n in (3, 6, 7, 24):
        a = np.sin(numbers[: n * n]).reshape(n, n)
        b = a @ a.T + n * np.eye(n)
        table += [b, a @ numbers[:n], np.linalg.solve(b, numbers[:n]), np.linalg.eigvalsh(b), np.linalg.inv(b)]
    return hashlib.sha256(b"".join(part.tobytes() for part in table)).hexdigest()[:16]
