"""The closed loop compiled: the loop's own source, calling law and plant by address, without holding the GIL."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from numba import types
from numba.extending import register_jitable

from torquebench.kernel.struct import at
from torquebench.sim.closed_loop import compiled_closed_loop
from torquebench.sim.job import Job
from torquebench.sim.native_calls import call_law, call_step, native

RUN_SIGNATURE = types.int64(types.int64, types.int64, types.int64)
"""status = run(job, first, last)."""


job_at = at(Job)


@register_jitable(_nrt=False)
def law_of(job: Job, k: int) -> int:
    """Call the job's law at control instant k."""
    c = job.call
    return call_law(
        c[0],
        (
            c[1],
            c[2],
            k * job.control_period,
            c[6],
            job.measured_q.ctypes.data,
            job.measured_qd.ctypes.data,
            job.q_ref[k].ctypes.data,
            job.qd_ref[k].ctypes.data,
            job.qdd_ref[k].ctypes.data,
            c[3],
            job.record_tau_law[k].ctypes.data,
        ),
    )


@register_jitable(_nrt=False)
def step_of(job: Job, substeps: int, varying: int) -> None:
    """Step the job's plant."""
    call_step(job.call[4], (job.call[5], job.torque.ctypes.data, substeps, varying))


@lru_cache(maxsize=1)
def compiled_loop() -> Any:
    """Return the compiled loop, a native function (job, first, last) -> status."""

    def run(address: int, first: int, last: int) -> int:
        return compiled_closed_loop(job_at(address), first, last, law_of, step_of)

    return native(RUN_SIGNATURE, run)
