"""MuJoCo's C functions for compiled code, called by name."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import types

from torquebench.sim.plant import NativeError

_STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)
_ON = types.void(types.intp, types.intp)
SIGNATURES = {
    "mj_step": _ON,
    "mj_forward": _ON,
    "mj_kinematics": _ON,
    "mj_comPos": _ON,
    "mj_crb": _ON,
    "mj_comVel": _ON,
    "mj_rne": types.void(types.intp, types.intp, types.int32, types.intp),
    "mj_factorI": types.void(types.intp, types.intp, types.int32, *[types.intp] * 4),
    "mj_solveLD": types.void(types.intp, types.intp, types.intp, types.int32, types.int32, *[types.intp] * 4),
}
"""What is called, by name; the last two are exported by the library but not declared in its header."""


def function(name: str) -> Any:
    """Return one of `SIGNATURES` for use in compiled code."""
    return types.ExternalFunction(name, SIGNATURES[name])


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Make the functions of `SIGNATURES` known to compiled code by name, and return MuJoCo's library.

    Raises:
        NativeError: the library that the Python package has loaded is not found, or lacks a function.
    """
    folder = Path(mujoco.__file__).parent
    found = sorted(p for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco*.dll") for p in folder.glob(pattern))
    if len(found) != 1:
        raise NativeError(f"{len(found)} MuJoCo libraries in its package, wanted one")
    opened = ctypes.CDLL(str(found[0]))
    for name in SIGNATURES:
        try:
            address = ctypes.cast(getattr(opened, name), ctypes.c_void_p).value
        except AttributeError as error:
            raise NativeError(f"MuJoCo {mujoco.__version__} exports no {name}") from error
        llvm.add_symbol(name, address)
    return opened


def addresses(m: Any, d: Any) -> tuple[int, int]:
    """Return the addresses of a model and its data after checking that the library sees them there.

    The library is asked for a state that was written through the Python bindings.

    Raises:
        NativeError: it answers with another state.
    """
    call = library().mj_getState
    call.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
    call.restype = None
    try:
        at = int(m._address), int(d._address)
    except AttributeError as error:
        raise NativeError(f"MuJoCo {mujoco.__version__} does not tell where its structures lie") from error
    mark = np.arange(1.0, 1.0 + m.nq + m.nv)
    before = np.concatenate([d.qpos, d.qvel])
    d.qpos[:], d.qvel[:] = mark[: m.nq], mark[m.nq :]
    seen = np.zeros(m.nq + m.nv)
    call(*at, seen.ctypes.data, _STATE)
    d.qpos[:], d.qvel[:] = before[: m.nq], before[m.nq :]
    if not np.array_equal(seen, mark):
        raise NativeError("MuJoCo's library reads another state than its Python bindings write")
    return at
