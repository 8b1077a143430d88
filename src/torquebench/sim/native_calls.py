"""Calls by address from compiled code: one fixed native signature for every law, and one for every plant."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from torquebench.kernel_cache import KernelCache, without_collection
from torquebench.packing_types import WORD

LAW_SIGNATURE = types.int64(*([types.int64] * 2), types.float64, *([types.int64] * 8))
"""status = law(gains, belief, t, n, q, qd, q_ref, qd_ref, qdd_ref, memory, tau): addresses but for t and n."""
STEP_SIGNATURE = types.int64(*([types.int64] * 4))
"""step(plant, torque, substeps, varying): addresses of the plant's structure and of three rows of torque."""


def caller(signature: Any) -> Any:
    """Return a function for compiled code that calls a native function of `signature` by its address.

    Args:
        signature: Of integers and doubles only; the function returned takes the address first.
    """

    def word(kind: types.Type) -> Any:
        return ir.DoubleType() if isinstance(kind, types.Float) else WORD

    native = ir.FunctionType(word(signature.return_type), [word(kind) for kind in signature.args])

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        arguments = [builder.extract_value(args[1], i) for i in range(len(signature.args))]
        return builder.call(builder.inttoptr(args[0], native.as_pointer()), arguments)

    @intrinsic
    def call(typingctx: Any, address: Any, arguments: Any) -> Any:
        return signature.return_type(types.int64, types.Tuple(signature.args)), build

    return call


def native(signature: Any, function: Any, error_model: str = "numpy") -> Any:
    """Compile a function to native form, or load it from the cache on disk.

    Args:
        signature: Of integers and doubles only.
        function: Its closure must hold only what keeps its value from process to process: plain functions, classes.
        error_model: ``numpy``: a division by zero gives infinity; ``python``: it raises.
    """
    options = {"error_model": error_model, "_nrt": False}
    compiled: Any = CFunc(function, (signature.args, signature.return_type), {}, options)
    compiled._cache = KernelCache(function)
    with without_collection():
        compiled.compile()
    return compiled


call_law = caller(LAW_SIGNATURE)
call_step = caller(STEP_SIGNATURE)
