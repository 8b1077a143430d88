"""Active disturbance rejection control: an extended-state observer for each joint."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench.kernel import Array, clip
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import acceleration_rate, observed_inertia, observing_pole, observing_slope


class Gains(NamedTuple):
    """Gains of the law; lambda and kV act on accelerations."""

    lam: Annotated[Array, Gain("slope lambda; the position gain is lambda kV", "1/s", auto=observing_slope)]
    kv: Annotated[Array, Gain("rate gain kV of an acceleration", "1/s", auto=acceleration_rate)]
    wo: Annotated[
        Array,
        Gain("bandwidth wo of the observer, its triple pole", "1/s", auto=observing_pole, search=(2.0, 1000.0, "log")),
    ]
    m: Annotated[
        Array,
        Gain("inertia 1/b0 that the law takes, over Mbar", "1", auto=observed_inertia, search=(0.1, 10.0, "log")),
    ]


class Memory(NamedTuple):
    """State of the observer.

    Position z1 [rad], velocity z2 [rad/s], disturbance z3 as an acceleration [rad/s^2]; the torque that was given last,
    within its limit [N m]; 1 once a position was seen.
    """

    position: Array
    velocity: Array
    disturbance: Array
    torque: Array
    seen: Array


@controller("adrc", gains=Gains, memory=Memory)
def adrc(gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array) -> None:
    """Active disturbance rejection: tau = m Mbar (qdd_ref + kV (qd_ref - z2) + lambda kV (q_ref - z1) - z3).

    dz1 = z2 + 3 wo (q - z1), dz2 = z3 + tau / (m Mbar) + 3 wo^2 (q - z1), dz3 = wo^3 (q - z1): Han, IEEE Transactions
    on Industrial Electronics 56 (2009), 900, in the linear form of Gao, American Control Conference 2003, 4989. z3 is
    all that one joint does not know: gravity, the other joints, load, and the inertia's difference from m Mbar. No
    model; of the measurement, the position alone (the velocity where a run begins).

    The observer is the sampled one of Miklosovic, Radke and Gao, American Control Conference 2006: predict with the
    torque held over T, correct with the gains that put all three poles at exp(-wo T). Its torque is the one within its
    limit, so that nothing winds up. Assumes that z3 varies slowly beside wo; noise is amplified by wo^3, and an inertia
    far below m Mbar, or a delay near 1/wo, make the loop ring.
    """
    T = model.control_period
    for i in range(len(tau)):
        inertia, pole = gains.m[i] * model.inertia_scale[i], math.exp(-gains.wo[i] * T)
        if memory.seen[i] == 0.0:
            memory.position[i], memory.velocity[i], memory.seen[i] = q[i], qd[i], 1.0
        else:
            moved = memory.disturbance[i] + memory.torque[i] / inertia
            memory.position[i] += T * (memory.velocity[i] + 0.5 * T * moved)
            memory.velocity[i] += T * moved
        missed, left = q[i] - memory.position[i], 1.0 - pole
        memory.position[i] += (1.0 - pole * pole * pole) * missed
        memory.velocity[i] += 1.5 * left * left * (1.0 + pole) / T * missed
        memory.disturbance[i] += left * left * left / (T * T) * missed
        e, de = ref.q[i] - memory.position[i], ref.qd[i] - memory.velocity[i]
        tau[i] = inertia * (ref.qdd[i] + gains.kv[i] * (de + gains.lam[i] * e) - memory.disturbance[i])
        memory.torque[i] = clip(tau[i], model.tau_max[i])
