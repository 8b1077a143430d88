"""Super-twisting: a second-order sliding mode whose torque is continuous."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench.kernel import Array, sign
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import twist, twist_rate


class SuperTwistingGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    k1: Annotated[
        Array, Gain("gain of |s|^1/2 sgn(s), times the model's inertia scale Mbar", "rad^0.5/s^1.5", auto=twist)
    ]
    k2: Annotated[Array, Gain("gain of the integral of sgn(s), times Mbar", "rad/s^3", auto=twist_rate)]
    equivalent_control: UseModel


class SuperTwistingMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded; the integral w; the velocity seen last."""

    s: Array
    w: Array
    velocity: Array


@controller("super-twisting", gains=SuperTwistingGains, memory=SuperTwistingMemory)
def super_twisting(
    gains: SuperTwistingGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: SuperTwistingMemory,
    tau: Array,
) -> None:
    """Super-twisting: tau = [tau_eq +] Mbar (k1 |s|^1/2 sgn(s) + w), dw/dt = k2 sgn(s), with s = de + lambda e.

    Levant, International Journal of Control 58 (1993), 1247; gains of any k2 above the bound on the disturbance's rate
    and k1 large beside it suffice: Moreno and Osorio, IEEE Transactions on Automatic Control 57 (2012), 1035. w stops
    growing while the torque is beyond its limit in the direction of s.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        switch = sign(s)
        memory.s[i] = s
        tau[i] += model.inertia_scale[i] * (gains.k1[i] * math.sqrt(abs(s)) * switch + memory.w[i])
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * s > 0.0):
            memory.w[i] += model.control_period * gains.k2[i] * switch
