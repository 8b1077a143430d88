"""A law in native form: its own source, compiled behind one fixed signature and cached on disk."""

from __future__ import annotations

from types import FunctionType
from typing import Any

from numba.extending import register_jitable

from torquebench.kernel import is_foreign
from torquebench.kernel.struct import at, is_structure, layout, structure, vector
from torquebench.laws.law import Law, Nothing
from torquebench.references import Reference
from torquebench.robot.model import Model
from torquebench.sim.checked_math import with_checked_math
from torquebench.sim.closed_loop import COMPLETED, RAISED
from torquebench.sim.law_digest import law_digest
from torquebench.sim.native_calls import LAW_SIGNATURE, native

belief_at = at(Model)
law_function: Any = None
gains_class: Any = Nothing
memory_class: Any = Nothing
"""What `adapter` names; each law has an adapter of its own, which means something else by them."""


def adapter(
    gains: int,
    belief: int,
    t: float,
    n: int,
    q: int,
    qd: int,
    q_ref: int,
    qd_ref: int,
    qdd_ref: int,
    memory: int,
    tau: int,
) -> int:
    """Call a law with what lies at some addresses; arguments as of `LAW_SIGNATURE`."""
    try:
        law_function(
            structure(gains_class, gains),
            belief_at(belief),
            t,
            vector(q, n),
            vector(qd, n),
            Reference(vector(q_ref, n), vector(qd_ref, n), vector(qdd_ref, n)),
            structure(memory_class, memory),
            vector(tau, n),
        )
    except Exception:  # noqa: BLE001  compiled code knows no other kind
        return RAISED
    return COMPLETED


def compile_law(law: Law) -> Any:
    """Compile a law, or load it from the cache on disk, and return numba's native function.

    The law's function is compiled as it stands. A division by zero in it, an argument outside the domain of a function
    of `math`, and an element beyond the end of an array end the run as they do interpreted.

    Raises:
        numba.core.errors.NumbaError: the law cannot be compiled.
        TypeError: its gains or memory hold something that compiled code cannot receive.
    """
    for name, cls in (("gains", law.gains_type), ("memory", law.memory_type or Nothing)):
        if not (is_structure(cls) and len(cls._fields) > 0):
            raise TypeError(f"its {name} are a {cls.__name__}, wanted a NamedTuple class with fields")
        layout(cls)
    function: Any = law.function
    jitable = register_jitable(
        error_model="python",
        boundscheck=is_foreign(function),
        _nrt=False,
        forceinline=True,
    )
    means = {
        "law_function": jitable(with_checked_math(function)),
        "gains_class": law.gains_type,
        "memory_class": law.memory_type or Nothing,
    }
    # numba finds an adapter on disk by its name and code; the code is the same for all laws, so the name tells
    own = FunctionType(adapter.__code__, {**globals(), **means})
    own.__name__ = own.__qualname__ = f"{law.name}_{law_digest(law)}"
    return native(LAW_SIGNATURE, own)
