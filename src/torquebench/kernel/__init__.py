"""The dialect of laws and dynamics: one decorator, and the scalar functions every law shares.

Code marked `@kernel` uses only arithmetic, `math.*`, array indexing and loops of fixed order (no ``**``, no
``np.exp``, no ``np.sum``, no ``@``), so that the same source gives the same bytes interpreted
(``NUMBA_DISABLE_JIT=1``) and compiled. `torquebench.dialect` has the rules, and ``tests/test_kernel_rules.py`` holds
every kernel to them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast, overload

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config

from torquebench.kernel.cache import KernelCache

Array: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
_F = TypeVar("_F", bound=Callable[..., Any])


@overload
def kernel(function: _F) -> _F: ...
@overload
def kernel(*, inline: bool) -> Callable[[_F], _F]: ...
def kernel(function: _F | None = None, *, inline: bool = False) -> _F | Callable[[_F], _F]:
    """Compile `function` with numba, cached on disk, without any value-changing optimisation.

    Args:
        function: The kernel.
        inline: Whether to copy it into kernels that call it: for short ones that take tuples of many arrays, which
            cost more to hand over than such a kernel costs to run.
    """
    if function is None:
        return lambda wrapped: _compiled(wrapped, inline)
    return _compiled(function, inline)


def _compiled(function: _F, inline: bool) -> _F:
    function.is_kernel, function.is_inline = True, inline  # type: ignore[attr-defined]
    compiler = numba.njit(
        boundscheck=is_foreign(function),
        error_model="numpy",
        fastmath=False,
        inline="always" if inline else "never",
        _nrt=False,
    )
    compiled = compiler(function)
    # numba would not see that a number which a user's kernel names has changed; compiled laws are kept whole
    if not config.DISABLE_JIT and not is_foreign(function):
        compiled._cache = KernelCache(function)
    return cast(_F, compiled)


def is_foreign(function: Callable[..., Any]) -> bool:
    """True for a user's function, whose indices are checked at run time; this package's own kernels are tested."""
    return not function.__module__.startswith("torquebench.")


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
