"""Computed torque with a momentum observer of the disturbance."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench.kernel import Array, clip
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics, momentum_balance
from torquebench.robot.flat_model import Model
from torquebench.tuning import acceleration_rate, observed_slope, residual_pole


class Gains(NamedTuple):
    """Gains of the law; lambda and kV act on accelerations."""

    lam: Annotated[Array, Gain("slope lambda; the position gain is lambda kV", "1/s", auto=observed_slope)]
    kv: Annotated[Array, Gain("rate gain kV of an acceleration", "1/s", auto=acceleration_rate)]
    wo: Annotated[Array, Gain("pole wo of the observer", "1/s", auto=residual_pole)]


class Memory(NamedTuple):
    """What the observer keeps.

    The residual r, its estimate of the disturbance [N m]; momentum M^ qd [N m s], and its rate C^' qd - g^ [N m];
    the momentum expected next but for half of the rate there; 1 once there is one.
    """

    residual: Array
    momentum: Array
    rate: Array
    expected: Array
    seen: Array


@controller("disturbance-observer", gains=Gains, memory=Memory)
def disturbance_observer(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array
) -> None:
    """Computed torque with momentum observer: tau = M^ (qdd_ref + kV de + lambda kV e) + N^ - r, dr/dt = wo (d - r).

    r = wo (p - int (tau + C^' qd - g^ + r)), p = M^ qd: De Luca and Mattone, IEEE ICRA 2003 and 2005; as the
    disturbance observer of a law, Mohammadi et al., Control Engineering Practice 21 (2013), 253. d is all torque that
    the model does not have: load, friction, its own errors. No acceleration is measured and no matrix inverted. With a
    right model r has one real pole for each joint, exp(-wo T) from instant to instant, whatever the arm does: the
    torque is constant between instants, and the rest of the momentum's rate is taken as the mean of both ends, good to
    T^2.

    Assumes that d varies slowly beside wo. tau in it is the torque within its limit, so that nothing winds up; a torque
    that the actuators do not give, by lag or delay, is seen as a disturbance and limits wo. Against what depends on the
    acceleration, as a wrong inertia does, r comes late by 1/wo.
    """
    momentum_balance(model, q, qd, memory.momentum, memory.rate)
    for i in range(len(tau)):
        met = (memory.momentum[i] - memory.expected[i]) / model.control_period - 0.5 * memory.rate[i]
        moved = -math.expm1(-gains.wo[i] * model.control_period) * (met - memory.residual[i])
        memory.residual[i] += memory.seen[i] * moved
        wanted = gains.kv[i] * (ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i]))
        model.scratch.free[i] = ref.qdd[i] + wanted
    inverse_dynamics(model, q, qd, model.scratch.free, tau)
    for i in range(len(tau)):
        tau[i] -= memory.residual[i]
        given = clip(tau[i], model.tau_max[i]) + 0.5 * memory.rate[i]
        memory.expected[i] = memory.momentum[i] + model.control_period * given
        memory.seen[i] = 1.0
