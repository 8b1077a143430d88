"""The arm integrated without MuJoCo: Runge-Kutta or semi-implicit Euler on the analytic dynamics."""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array, kernel
from torquebench.robot.arm import RobotModel
from torquebench.robot.dynamics import forward_dynamics
from torquebench.robot.model import Model, own_copy
from torquebench.sim.plant import check_scheme


@kernel
def rk4_steps(model: Model, q: Array, qd: Array, tau: Array, h: float, steps: int, work: Array) -> None:
    """Advance `q`, `qd` (n,) by `steps` steps of length `h` [s] of the classical Runge-Kutta method.

    Args:
        model: The plant's dynamics.
        q, qd: State, overwritten [rad, rad/s].
        tau: Torque held constant, (n,) [N m].
        h: Step [s].
        steps: Number of steps.
        work: Working memory, (5, n).
    """
    n = len(q)
    position, velocity, acceleration, sum_v, sum_a = work[0], work[1], work[2], work[3], work[4]
    for _ in range(steps):
        for i in range(n):
            position[i], velocity[i] = q[i], qd[i]
            sum_v[i] = sum_a[i] = 0.0
        for stage in range(4):
            forward_dynamics(model, position, velocity, tau, acceleration)
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
def euler_steps(model: Model, q: Array, qd: Array, tau: Array, h: float, steps: int, work: Array) -> None:
    """Advance `q`, `qd` by `steps` steps of semi-implicit Euler; arguments as in `rk4_steps`."""
    acceleration = work[2]
    for _ in range(steps):
        forward_dynamics(model, q, qd, tau, acceleration)
        for i in range(len(q)):
            qd[i] += h * acceleration[i]
            q[i] += h * qd[i]


class AnalyticPlant:
    """A plant that integrates an analytic model; follows the `Plant` protocol.

    Args:
        model: Dynamics of the truth, of any structure.
        timestep: Integration step [s].
        integrator: ``rk4`` or ``euler``.

    Raises:
        ValueError: the time step is not finite and positive, or the integrator is unknown.
    """

    def __init__(self, model: RobotModel, timestep: float = 0.001, integrator: str = "rk4") -> None:
        check_scheme(timestep, integrator)
        self.n = model.n
        self.timestep = timestep
        self.tau_max = model.flat.tau_max.copy()
        self._steps = rk4_steps if integrator == "rk4" else euler_steps
        self._model = own_copy(model.flat)
        self._q, self._qd, self._work = np.zeros(model.n), np.zeros(model.n), np.zeros((5, model.n))

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,)."""
        self._q[:], self._qd[:] = q, qd

    def state(self) -> tuple[Array, Array]:
        """Return copies of the joint position [rad] and velocity [rad/s], each (n,)."""
        return self._q.copy(), self._qd.copy()

    def step(self, tau: Array, substeps: int) -> None:
        """Integrate `substeps` time steps under the constant joint torque `tau` (n,) [N m]."""
        try:
            with np.errstate(all="ignore"):
                self._steps(self._model, self._q, self._qd, tau, self.timestep, substeps, self._work)
        except (ArithmeticError, ValueError):
            # an overflowing state: interpreted, math.cos(inf) raises where compiled code gives NaN
            self._q[:] = self._qd[:] = np.nan
