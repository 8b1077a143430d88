"""From the arguments of `simulate` to the arrays that both paths work on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from torquebench.kernel import Array
from torquebench.laws.law import Law, Nothing
from torquebench.references import Reference
from torquebench.robot.model import Model
from torquebench.sim.chain import Chain
from torquebench.sim.job import Job
from torquebench.sim.plant import NativePlant, Plant


@dataclass(frozen=True, slots=True)
class Setup:
    """One run, ready to go."""

    law: Law
    gains: Any
    belief: Model
    memory: Any
    """The law's memory: a NamedTuple of rows of ``job.memory``."""
    plant: Plant
    native: NativePlant | None
    """The plant's native form when the run is to be compiled."""
    job: Job


def set_up(
    law: Law,
    gains: Any,
    belief: Model,
    plant: Plant,
    desired: Reference,
    chain: Chain,
    *,
    control_period: float,
    substeps: int,
    position_noise: Array | None,
    disturbance: Array | None,
    native: NativePlant | None,
) -> Setup:
    """Allocate a run.

    Args:
        law, gains: The law and its gains, which an interpreted law may write to.
        belief: What the law believes, for this run alone: it may write to the scratch space.
        plant: The truth.
        desired: Desired motion at the control instants, (N, n).
        chain: Sensors and actuators.
        control_period: Time between control instants [s].
        substeps: Physics steps in it.
        position_noise, disturbance: Sampled at the control instants, (N, n), or None.
        native: The plant's native form, when the run is to be compiled.
    """
    n_steps, n = desired.q.shape
    none = np.zeros((0, n))
    fields = law.memory_type._fields if law.memory_type is not None else ()
    block = np.zeros((len(fields), n))
    memory = law.memory_type(*block) if law.memory_type is not None and fields else Nothing(np.zeros(0))

    decay = chain.decay(plant.timestep, control_period)
    delay = min(chain.delay_steps(control_period), n_steps)
    measured = position_noise is not None or chain.velocity_rate > 0.0 or chain.quantum > 0.0 or delay > 0
    acting = len(decay) > 0 or disturbance is not None
    # one block for all records: the operating system hands out its pages, which is slow, only once
    records = np.empty((4 + 2 * measured + acting + len(fields), n_steps, n))
    one = iter(records)
    # copies: they become the trajectory's, which nobody may write to, and the caller's own arrays stay the caller's
    inputs = [x if is_fixed(x) else np.array(x, dtype=np.float64, order="C") for x in desired]
    q, qd = (np.zeros(n), np.zeros(n)) if native is None else (native.q, native.qd)
    measured_q, measured_qd = (np.zeros(n), np.zeros(n)) if measured else (q, qd)
    fresh_q, fresh_qd = (np.zeros(n), np.zeros(n)) if delay > 0 else (measured_q, measured_qd)
    job = Job(
        substeps=substeps,
        control_period=control_period,
        tau_max=np.array(plant.tau_max),
        q_ref=inputs[0],
        qd_ref=inputs[1],
        qdd_ref=inputs[2],
        disturbance=none if disturbance is None else np.ascontiguousarray(disturbance, dtype=np.float64),
        position_noise=none if position_noise is None else np.ascontiguousarray(position_noise, dtype=np.float64),
        velocity_gain=chain.velocity_gain(control_period),
        quantum=chain.quantum,
        decay=decay,
        q=q,
        qd=qd,
        fresh_q=fresh_q,
        fresh_qd=fresh_qd,
        late=np.zeros((delay, 2, n)),
        measured_q=measured_q,
        measured_qd=measured_qd,
        output=np.zeros(n),
        torque=np.zeros((3, n)),
        memory=block,
        record_q=next(one),
        record_qd=next(one),
        record_q_meas=next(one) if measured else none,
        record_qd_meas=next(one) if measured else none,
        record_tau_law=next(one),
        record_tau=next(one),
        record_tau_applied=next(one) if acting else none,
        record_memory=records[len(records) - len(fields) :],
        at=np.zeros(1, dtype=np.int64),
        call=np.zeros(7, dtype=np.int64),
    )
    return Setup(law, gains, belief, memory, plant, native, job)


def is_fixed(x: Array) -> bool:
    """Whether an array is immutable and can be shared."""
    flags = x.flags
    return not flags.writeable and flags.c_contiguous and x.base is None and x.dtype == np.float64
