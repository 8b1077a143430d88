"""Linear-quadratic regulator about the desired trajectory."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench.kernel import Array
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics, mass_matrix
from torquebench.robot.flat_model import Model
from torquebench.tuning import costly_error, costly_rate


class Gains(NamedTuple):
    """Weights of the cost, as Bryson's rule has them: what costs as much as the torque limit."""

    error: Annotated[
        Array,
        Gain("error that costs as much as the torque limit", "rad", auto=costly_error, search=(1e-3, 10.0, "log")),
    ]
    rate: Annotated[
        Array,
        Gain("rate of the error that costs as much", "rad/s", auto=costly_rate, search=(1e-2, 1e3, "log")),
    ]


@controller("lqr", gains=Gains)
def lqr(gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array) -> None:
    """LQR about the trajectory: tau = M^ qdd_ref + N^ at (q_ref, qd_ref), + P e + D de of least int cost.

    The cost of each joint is (e/error)^2 + (de/rate)^2 + (tau_fb/tau_max)^2, tau_fb the feedback's torque. Linearised
    about the trajectory, without the slopes of gravity and velocity torque and with the other joints held, the joint is
    M_ii(q_ref) dde = -tau_fb, and its Riccati equation, frozen at each instant, has the solution

        P = tau_max / error,    D = sqrt((tau_max / rate)^2 + 2 M_ii P).

    Anderson and Moore, Optimal Control: Linear Quadratic Methods (1990); Bryson and Ho, Applied Optimal Control (1975),
    for the weights. The linearisation of all joints together has no such solution: it needs a Riccati equation of
    order 2n, which one instant has no time for. So coupling is left to the feed-forward: optimal where M varies slowly
    and is diagonal. There is no integral: a load d leaves the error d/P, and noise of neither q nor qd enters the
    feed-forward.
    """
    M = model.scratch.matrix
    mass_matrix(model, ref.q, M)
    for i in range(len(tau)):
        model.scratch.free[i] = M[i, i]
    inverse_dynamics(model, ref.q, ref.qd, ref.qdd, tau)
    for i in range(len(tau)):
        P, rate = model.tau_max[i] / gains.error[i], model.tau_max[i] / gains.rate[i]
        D = math.sqrt(rate * rate + 2.0 * model.scratch.free[i] * P)
        tau[i] += P * (ref.q[i] - q[i]) + D * (ref.qd[i] - qd[i])
