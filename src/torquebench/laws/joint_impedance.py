"""Joint impedance: a spring and a damper at each joint, as Franka's examples have it."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array
from torquebench.laws.declare import Option
from torquebench.laws.law import controller
from torquebench.laws.parts import Damping, Stiffness
from torquebench.references import Reference
from torquebench.robot.dynamics import bias_forces
from torquebench.robot.flat_model import Model


class Gains(NamedTuple):
    """Gains of the joint impedance law."""

    kp: Stiffness
    kd: Damping
    damping: Annotated[
        int,
        Option(
            "what the damper acts on: the velocity, -Kd qd, as in libfranka; or the velocity's error, "
            "Kd (qd_ref - qd), as in Polymetis and DROID",
            ("velocity", "velocity-error"),
        ),
    ]


@controller("joint-impedance", gains=Gains)
def joint_impedance(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array
) -> None:
    """Joint impedance: tau = Kp e - Kd qd + C^(q, qd) qd + g^(q), with e = q_ref - q.

    libfranka, examples/joint_impedance_control.cpp: K (q_d - q) - D dq + coriolis, K 600 600 600 600 250 150 50
    N m/rad, D 50 50 50 50 30 25 15 N m s/rad. There the robot adds gravity to what it is told; here nothing does, so
    that the law adds it. Damping the velocity lags a moving reference by Kd qd_ref / Kp; damping the velocity's error
    does not.
    """
    bias_forces(model, q, qd, tau)
    for i in range(len(tau)):
        rate = ref.qd[i] - qd[i] if gains.damping == 1 else -qd[i]
        tau[i] += gains.kp[i] * (ref.q[i] - q[i]) + gains.kd[i] * rate
