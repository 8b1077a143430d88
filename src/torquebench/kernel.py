"""The dialect of laws and dynamics: one decorator, and the scalar functions every law shares.

Code marked `@kernel` uses only arithmetic, `math.*`, array indexing and loops of fixed order (no ``**``, no
``np.exp``, no ``np.sum``, no ``@``), so that the same source gives the same bytes interpreted
(``NUMBA_DISABLE_JIT=1``) and compiled. ``tests/test_kernel_rules.py`` holds every kernel to it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config

from torquebench.kernel_cache import cache_folder

Array: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
_F = TypeVar("_F", bound=Callable[..., Any])


def kernel(function: _F) -> _F:
    """Compile `function` with numba, cached on disk, without any value-changing optimisation."""
    settings: Any = config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(cache_folder())
    try:
        return cast(_F, numba.njit(cache=True, error_model="numpy", fastmath=False)(function))
    finally:
        settings.CACHE_DIR = before


@kernel
def sign(x: float) -> float:
    """Switching function sgn(x): 1, 0 or -1; equation (96)."""
    if x > 0.0:
        return 1.0
    if x < 0.0:
        return -1.0
    return 0.0


@kernel
def sat(x: float) -> float:
    """Saturation: x clipped to [-1, 1]; equation (127)."""
    if x > 1.0:
        return 1.0
    if x < -1.0:
        return -1.0
    return x


@kernel
def clip(x: float, limit: float) -> float:
    """Clip x to [-limit, limit]."""
    if x > limit:
        return limit
    if x < -limit:
        return -limit
    return x
