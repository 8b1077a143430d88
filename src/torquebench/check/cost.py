"""What a call of a law costs on each path."""

from __future__ import annotations

import statistics
import time
from functools import lru_cache
from typing import Any

import numpy as np

from torquebench.chain import IDEAL
from torquebench.check.cases import arm, combinations, gains_of
from torquebench.check.paths import plant_of
from torquebench.check.report import Cost
from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.references import Reference, Sine
from torquebench.robot.flat_model import own_copy
from torquebench.sim.interpreted import call_law
from torquebench.sim.job import Setup, set_up
from torquebench.sim.native import RUN_SIGNATURE, NativeRun, job_at, law_of, native, obstacle

ROUNDS, CALLS = 9, 200
"""Rounds of timing, of whose times the median is taken, and calls in each."""


def measure(law: Law) -> Cost:
    """Return what a call costs on each path, on six joints, at a state that stays."""
    t: Array = 0.001 * np.arange(CALLS, dtype=np.float64)
    desired = Sine(1.0, 0.5)(t)
    desired = Reference(*(np.repeat(x, arm("puma560").n, axis=1) for x in desired))
    plant: Any = plant_of("puma560", "analytic")
    compiled = not obstacle(plant, law)
    options = combinations(law)[0]
    setup = set_up(
        law,
        law.pack_gains(plant.n, gains_of(law, plant.n, options, 1), options),
        own_copy(arm("puma560").flat, control_period=0.001),
        plant,
        desired,
        IDEAL,
        control_period=0.001,
        substeps=1,
        position_noise=None,
        disturbance=None,
        native=plant.native() if compiled else None,
    )
    setup.job.measured_q[:] = desired.q[0] - 0.01
    python = statistics.median(_interpreted(setup) for _ in range(ROUNDS))
    if not compiled:
        return Cost(python, None)
    run = NativeRun(setup, plant.native())  # kept: it holds what the job's addresses point to
    calls = _repeat().ctypes
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        calls(setup.job.address, 0, CALLS)
        times.append((time.perf_counter() - start) / CALLS * 1e6)
    del run
    return Cost(python, statistics.median(times))


def _interpreted(setup: Setup) -> float:
    """Return the time of one interpreted call [us]."""
    job = setup.job
    refs = [Reference(job.q_ref[k], job.qd_ref[k], job.qdd_ref[k]) for k in range(CALLS)]
    start = time.perf_counter()
    for k in range(CALLS):
        call_law(
            setup.law,
            setup.gains,
            setup.belief,
            k * job.control_period,
            job.measured_q,
            job.measured_qd,
            refs[k],
            setup.memory,
        )
    return (time.perf_counter() - start) / CALLS * 1e6


@lru_cache(maxsize=1)
def _repeat() -> Any:
    """Return a native function (job, first, last) -> 0 that calls a job's law and nothing else."""

    def repeat(address: int, first: int, last: int) -> int:
        job = job_at(address)
        for k in range(first, last):
            law_of(job, k)
        return 0

    return native(RUN_SIGNATURE, repeat)
