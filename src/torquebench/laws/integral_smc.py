"""Integral sliding mode: a nominal loop, and a switching term that acts from the first instant on."""

from __future__ import annotations

from typing import Annotated, NamedTuple, get_args

from torquebench.kernel import Array, sat, sign
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope
from torquebench.laws.sliding_mode import PID, SIGN, Switch, SwitchBand, surface_of
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics
from torquebench.robot.flat_model import Model
from torquebench.tuning import pole, robust


class IntegralSmcGains(NamedTuple):
    """Gains and options of the law."""

    lam: Annotated[
        Array,
        get_args(Slope)[1]._replace(meaning="slope lambda: the nominal loop has a double pole at lambda/2", auto=pole),
    ]
    kr: Annotated[
        Array, Gain("robust gain kR, a fraction of the torque limit, K = kR tau_max", "1", True, None, robust)
    ]
    phi: SwitchBand
    switching: Switch


class IntegralSmcMemory(NamedTuple):
    """The sliding variable; what it begins from; 1 once it has begun; the integral of the error."""

    s: Array
    start: Array
    begun: Array
    integral: Array


@controller("integral-smc", gains=IntegralSmcGains, memory=IntegralSmcMemory)
def integral_smc(
    gains: IntegralSmcGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: IntegralSmcMemory,
    tau: Array,
) -> None:
    """Integral sliding mode: tau = M^ (qdd_ref + lambda de + (lambda/2)^2 e) + N^ + K sgn(s), or K sat(s/phi).

    With s = de + lambda e + (lambda/2)^2 int e less its value at the start, so that s = 0 from the first instant on and
    the error follows the nominal loop e'' + lambda e' + (lambda/2)^2 e = 0 without a reaching phase. Utkin and Shi,
    Proceedings of the 35th IEEE Conference on Decision and Control (1996), 4591. Needs a model and a K above what the
    model leaves over. Their filtered form, in which sgn acts in the computer alone, is left out: in sliding its torque
    is a filter rate times Mbar s, as the saturated form has it. After a step of the reference in mid-motion there is a
    reaching phase again. The integral stops growing while the torque is beyond its limit in the error's direction.
    """
    for i in range(len(tau)):
        lam, e, de = gains.lam[i], ref.q[i] - q[i], ref.qd[i] - qd[i]
        model.scratch.free[i] = ref.qdd[i] + lam * de + 0.25 * lam * lam * e
    inverse_dynamics(model, q, qd, model.scratch.free, tau)
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        s = surface_of(PID, gains.lam[i], e, ref.qd[i] - qd[i], memory.integral[i])
        if memory.begun[i] == 0.0:
            memory.begun[i], memory.start[i] = 1.0, s
        s -= memory.start[i]
        memory.s[i] = s
        tau[i] += gains.kr[i] * model.tau_max[i] * (sign(s) if gains.switching == SIGN else sat(s / gains.phi[i]))
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
