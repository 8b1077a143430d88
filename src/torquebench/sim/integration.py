"""Runge-Kutta and semi-implicit Euler on the analytic dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from torquebench.kernel import Array, kernel
from torquebench.kernel.struct import Structure
from torquebench.robot.dynamics import forward_dynamics
from torquebench.robot.model import Model
from torquebench.sim.friction import Resistance, resist


@kernel
def rk4_steps(
    model: Model,
    friction: Resistance,
    q: Array,
    qd: Array,
    start: Array,
    middle: Array,
    end: Array,
    h: float,
    steps: int,
    work: Array,
) -> None:
    """Advance `q`, `qd` (n,) by `steps` steps of length `h` [s] of the classical Runge-Kutta method.

    Args:
        model: The plant's dynamics.
        friction: Friction of its joints.
        q, qd: State, overwritten [rad, rad/s].
        start, middle, end: Torque at these times of each step, (n,) [N m].
        h: Step [s].
        steps: Number of steps.
        work: Working memory, (6, n).
    """
    n = len(q)
    position, velocity, acceleration, sum_v, sum_a = work[0], work[1], work[2], work[3], work[4]
    rough = len(friction.viscous) > 0
    for _ in range(steps):
        for i in range(n):
            position[i], velocity[i] = q[i], qd[i]
            sum_v[i] = sum_a[i] = 0.0
        for stage in range(4):
            torque = start if stage == 0 else end if stage == 3 else middle
            if rough:
                resist(friction, velocity, torque, work[5])
                forward_dynamics(model, position, velocity, work[5], acceleration)
            else:
                forward_dynamics(model, position, velocity, torque, acceleration)
            weight = 2.0 if stage == 1 or stage == 2 else 1.0
            ahead = h if stage == 2 else 0.5 * h
            for i in range(n):
                sum_v[i] += weight * velocity[i]
                sum_a[i] += weight * acceleration[i]
                position[i] = q[i] + ahead * velocity[i]
                velocity[i] = qd[i] + ahead * acceleration[i]
        for i in range(n):
            q[i] += h / 6.0 * sum_v[i]
            qd[i] += h / 6.0 * sum_a[i]


@kernel
def euler_steps(
    model: Model, friction: Resistance, q: Array, qd: Array, torque: Array, h: float, steps: int, work: Array
) -> None:
    """Advance `q`, `qd` by `steps` steps of semi-implicit Euler; arguments as in `rk4_steps`."""
    acceleration, net = work[2], torque
    for _ in range(steps):
        if len(friction.viscous) > 0:
            net = work[5]
            resist(friction, qd, torque, net)
        forward_dynamics(model, q, qd, net, acceleration)
        for i in range(len(q)):
            qd[i] += h * acceleration[i]
            q[i] += h * qd[i]


@dataclass(frozen=True, eq=False)
class Integrated(Structure):
    """An analytic plant as compiled code sees it."""

    model: Model
    friction: Resistance
    rk4: bool
    timestep: float
    q: Array
    qd: Array
    work: Annotated[Array, 2]


@kernel
def integrate(arm: Integrated, start: Array, middle: Array, end: Array, steps: int) -> None:
    """Advance `arm` by `steps` time steps under the torque (n,) [N m] at the start, middle and end of each."""
    if arm.rk4:
        rk4_steps(arm.model, arm.friction, arm.q, arm.qd, start, middle, end, arm.timestep, steps, arm.work)
    else:
        euler_steps(arm.model, arm.friction, arm.q, arm.qd, start, arm.timestep, steps, arm.work)
