"""The analytic plant's step in native form."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from torquebench.kernel.struct import at, vector
from torquebench.sim.integration import Integrated, integrate
from torquebench.sim.native_calls import STEP_SIGNATURE, native

arm_at = at(Integrated)


@lru_cache(maxsize=1)
def compiled_step() -> Any:
    """Return the step, a native function (arm, torque, substeps, varying) -> 0; see `STEP_SIGNATURE`."""

    def step(address: int, torque: int, substeps: int, varying: int) -> int:
        arm = arm_at(address)
        n = len(arm.q)
        start, middle, end = vector(torque, n), vector(torque + 8 * n, n), vector(torque + 16 * n, n)
        if not varying:
            middle, end = start, start
        integrate(arm, start, middle, end, substeps)
        return 0

    return native(STEP_SIGNATURE, step)
