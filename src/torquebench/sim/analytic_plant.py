"""The arm without MuJoCo: a plant that integrates the analytic dynamics."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.arm import RobotModel
from torquebench.robot.model import own_copy
from torquebench.robot.payload import Payload, phases
from torquebench.sim.friction import NONE, Friction, check_stable, poses
from torquebench.sim.integration import Integrated, integrate
from torquebench.sim.native_analytic import compiled_step
from torquebench.sim.plant import NativePlant, check_own, check_scheme, stages


class AnalyticPlant:
    """A plant that integrates an analytic model; follows the `Plant` protocol.

    Args:
        model: Dynamics of the truth, of any structure.
        timestep: Integration step [s].
        integrator: ``rk4`` or ``euler``.
        payload: What the last link takes up, at the start or in the middle of a run.
        friction: Friction of the joints.

    Raises:
        ValueError: the time step is not finite and positive, the integrator is unknown, or the friction does not fit
            them.
        ModelError: the model has no terms for the payload; see `carrying`.
    """

    def __init__(
        self,
        model: RobotModel,
        timestep: float = 0.001,
        integrator: str = "rk4",
        *,
        payload: Payload | None = None,
        friction: Friction | None = None,
    ) -> None:
        check_scheme(timestep, integrator)
        self.n = model.n
        self.timestep = timestep
        self.tau_max = model.flat.tau_max.copy()
        self.payload, self.friction = payload, friction
        resistance = NONE if friction is None else friction.of_joints(model.n)
        if friction is not None:
            check_stable(resistance, model.mass_matrix(poses(model.n)), timestep, integrator)
        n, (first, later) = model.n, phases(model, payload)
        self._empty = Integrated(
            own_copy(first.flat), resistance, integrator == "rk4", timestep, np.zeros(n), np.zeros(n), np.zeros((6, n))
        )
        self._loaded = None if later is None else replace(self._empty, model=own_copy(later.flat))
        self._arm = self._empty

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,), without a payload to come."""
        self._arm = self._empty
        self._arm.q[:], self._arm.qd[:] = q, qd

    def attach(self) -> None:
        """Go on with the payload; see `Carrier`."""
        self._arm = self._loaded or self._empty

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
        return NativePlant(compiled_step().address, self._empty, self._arm.q, self._arm.qd, self._loaded)

    def replica(self) -> AnalyticPlant:
        """Return another plant of the same arm, for another thread."""
        twin, old = copy.copy(self), self._empty
        twin._empty = replace(old, model=own_copy(old.model), q=old.q.copy(), qd=old.qd.copy(), work=old.work.copy())
        if self._loaded is not None:
            twin._loaded = replace(twin._empty, model=own_copy(self._loaded.model))
        twin._arm = twin._empty
        return twin
