"""The arm without MuJoCo: a plant that integrates the analytic dynamics."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.arm import RobotModel
from torquebench.robot.model import own_copy
from torquebench.sim.integration import Integrated, integrate
from torquebench.sim.native_analytic import compiled_step
from torquebench.sim.plant import NativePlant, check_own, check_scheme, stages


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
        n = model.n
        self._arm = Integrated(
            own_copy(model.flat), integrator == "rk4", timestep, np.zeros(n), np.zeros(n), np.zeros((5, n))
        )

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,)."""
        self._arm.q[:], self._arm.qd[:] = q, qd

    def state(self) -> tuple[Array, Array]:
        """Return copies of the joint position [rad] and velocity [rad/s], each (n,)."""
        return self._arm.q.copy(), self._arm.qd.copy()

    def step(self, tau: Array, substeps: int) -> None:
        """Integrate `substeps` time steps under the joint torque `tau` [N m]: see `Plant.step`."""
        start, middle, end = stages(tau)
        try:
            with np.errstate(all="ignore"):
                integrate(self._arm, start, middle, end, substeps)
        except (ArithmeticError, ValueError):
            # an overflowing state: interpreted, math.cos(inf) raises where compiled code gives NaN
            self._arm.q[:] = self._arm.qd[:] = np.nan

    def native(self) -> NativePlant:
        """Return what the compiled loop needs; see `NativePlant`.

        Raises:
            NativeError: a subclass, whose own methods the compiled loop would pass over.
        """
        check_own(self, AnalyticPlant)
        return NativePlant(compiled_step().address, self._arm, self._arm.q, self._arm.qd)

    def replica(self) -> AnalyticPlant:
        """Return another plant of the same arm, for another thread."""
        twin = copy.copy(self)
        twin._arm = replace(
            self._arm, model=own_copy(self._arm.model), q=self._arm.q.copy(), qd=self._arm.qd.copy(),
            work=self._arm.work.copy(),
        )  # fmt: skip
        return twin
