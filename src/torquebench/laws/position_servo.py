"""Position servo: each joint's drive by itself, without a model of the arm."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Damping, Stiffness
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import none


class Gains(NamedTuple):
    """Gains of the position servo."""

    kp: Stiffness
    kd: Damping
    ki: Annotated[
        Array,
        Gain("integral gain; zero leaves the integral out, as servos are delivered", "N m/(rad s)", False, auto=none),
    ]


class Memory(NamedTuple):
    """State of the position servo."""

    integral: Array


@controller("position-servo", gains=Gains, memory=Memory)
def position_servo(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array
) -> None:
    """Position servo: tau = kp e - kd qd + ki int e, with e = q_ref - q; sags under gravity by g/kp without ki.

    The law of servo drives (Dynamixel, MuJoCo's `position` actuator with kp and kv): the joint by itself, told a
    position and nothing else. The integral waits while the torque is beyond its limit in the error's direction.
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        tau[i] = gains.kp[i] * e - gains.kd[i] * qd[i] + gains.ki[i] * memory.integral[i]
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
