"""Computed-torque control."""

from __future__ import annotations

from typing import Annotated, NamedTuple, get_args

from torquebench.kernel import Array
from torquebench.laws.law import controller
from torquebench.laws.parts import Integral, Rate, Slope
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics
from torquebench.robot.flat_model import Model
from torquebench.tuning import acceleration_rate, pole


class Gains(NamedTuple):
    """Gains of the computed-torque law; here they act on accelerations, without Mbar."""

    lam: Annotated[Array, get_args(Slope)[1]._replace(auto=pole)]
    kv: Annotated[Array, get_args(Rate)[1]._replace(auto=acceleration_rate)]
    ki: Integral


class Memory(NamedTuple):
    """State of the computed-torque law."""

    integral: Array


@controller("computed-torque", gains=Gains, memory=Memory)
def computed_torque(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array
) -> None:
    """Computed torque: tau = M^(q) (qdd_ref + kV de + lambda kV e + kI int e) + N^(q, qd).

    Markiewicz (1973), Bejczy (1974). The integral stops growing while the torque is beyond its limit in the
    error's direction.
    """
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        wanted = gains.kv[i] * (de + gains.lam[i] * e) + gains.ki[i] * memory.integral[i]
        model.scratch.free[i] = ref.qdd[i] + wanted
    inverse_dynamics(model, q, qd, model.scratch.free, tau)
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
