"""The arm without MuJoCo: a plant that integrates the analytic dynamics."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array, kernel
from torquebench.kernel.struct import Structure, structure_at, vector
from torquebench.kernel.twin import on_numbers, python_numbers
from torquebench.robot.dynamics import forward_dynamics, gravity
from torquebench.robot.flat_model import EXACT, Model, own_copy
from torquebench.robot.lock import Lock, falling_in, phases_of
from torquebench.robot.payload import Payload, carrying
from torquebench.robot.perturbation import perturbed
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.friction import Friction, Resistance, acting, drag_along, own_bristles, resist
from torquebench.sim.joints import (
    Joints,
    Transmission,
    advance,
    begin,
    check_followed,
    motors_in,
    moved_by,
    own_states,
    rigid,
    settle,
    transmit,
)
from torquebench.sim.native import STEP_SIGNATURE, NativeFunction
from torquebench.sim.plants import NativePlant, check_own, check_scheme, range_of, stages


class AnalyticPlant:
    """A plant that integrates an analytic model; follows the `Plant` protocol.

    Attributes:
        burden: Control steps of a law that take as long as one time step of the plant, interpreted.

    Args:
        model: Dynamics of the truth, of any structure.
        timestep: Integration step [s].
        integrator: ``rk4`` or ``euler``.
        payload: What the last link takes up, at the start or in the middle of a run.
        lock: Joint that is held, from the start or from the middle of a run on.
        friction: Friction of the joints; None for that which the model has of its own, if any.
        transmission: What lies between motors and links; None for rigid joints.
        stops: Whether a run ends where a joint leaves its range; see `Plant`.

    Raises:
        ValueError: the time step is not finite and positive, the integrator is unknown, or friction or transmission do
            not fit them.
        ModelError: the model has no terms for the payload, see `carrying`, or no motor to lock.
    """

    burden = 15

    def __init__(
        self,
        model: RobotModel,
        timestep: float = 0.001,
        integrator: str = "rk4",
        *,
        payload: Payload | None = None,
        lock: Lock | None = None,
        friction: Friction | None = None,
        transmission: Transmission | None = None,
        stops: bool = False,
    ) -> None:
        check_scheme(timestep, integrator, transmission)
        self.n = model.n
        self.timestep = timestep
        self.tau_max = model.flat.tau_max.copy()
        self.range = range_of(model.passive) if stops else None
        joints, masses = rigid(model.n), moved_by(transmission, model.flat.armature, model.mass_matrix)
        if transmission is not None:
            joints, model = transmission.of_joints(model.flat.armature), without_armature(model)
        self.friction, resistance = acting(friction, model.passive, masses, timestep, integrator, self.tau_max)
        check_followed(joints, resistance, model.mass_matrix, timestep)
        self.sensor = "link" if transmission is None else transmission.sensor
        n, arms, self._phases = model.n, list[Integrated](), phases_of(payload, lock)
        shared = (resistance, joints, integrator == "rk4", timestep, np.zeros(n), np.zeros(n), np.zeros((6, n)))
        self._free = [model if load is None else carrying(model, load) for _, load, _ in self._phases]
        for free, (_, _, brake) in zip(self._free, self._phases, strict=True):
            arm = Integrated(own_copy(free.flat), *shared)
            if brake is not None:
                if free.flat.structure != EXACT:
                    raise ModelError("structures 'corrected' and 'printed' have no motor that a brake could hold")
                if transmission is None:
                    arm = replace(arm, model=own_copy(free.flat, armature=brake.on(free.flat.armature)))
                else:
                    arm = replace(arm, joints=replace(joints, inertia=brake.on(joints.inertia)))
            arms.append(arm)
        self.changes = tuple(at for at, _, _ in self._phases[1:])
        self._arms, self._phase, self._is_compiled = tuple(arms), 0, False

    @property
    def _arm(self) -> Integrated:
        """The arm that it is now."""
        return self._arms[self._phase]

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,), as the first of its arms."""
        self._phase = 0
        self._arm.q[:], self._arm.qd[:] = q, qd
        self._arm.friction.bristles[:] = 0.0
        if len(self.motors()) > 0:
            load = np.zeros(self.n)
            on_numbers(gravity)(python_numbers(self._arm.model), python_numbers(q), python_numbers(load))
            settle(self._arm.joints, q, load)

    def change(self) -> None:
        """Go on as the next of its arms; see `Changing`."""
        self._phase += 1
        if brake := falling_in(self._phases, self._phase):
            free, arm = self._free[self._phase], self._arm
            brake.stop(self.motors(), arm.qd, lambda: free.mass_matrix(arm.q[None])[0])

    def state(self) -> tuple[Array, Array]:
        """Return copies of the joint position [rad] and velocity [rad/s], each (n,)."""
        return self._arm.q.copy(), self._arm.qd.copy()

    def motors(self) -> Array:
        """Return position [rad] and velocity [rad/s] of the motors, (2, n), or (0, n); see `Geared`."""
        return motors_in(self._arm.joints)

    def step(self, tau: Array, substeps: int) -> None:
        """Integrate `substeps` time steps under the joint torque `tau` [N m]: see `Plant.step`.

        In Python, which takes milliseconds a step, until the step is compiled: by `native`, or in the cache on disk.
        """
        if self._is_compiled or STEP.is_compiled:
            self._is_compiled = True
            torque = np.ascontiguousarray(np.broadcast_to(tau, (3, self.n)), dtype=np.float64)
            STEP.call(self._arm.address, torque.ctypes.data, substeps, int(tau.ndim == 2))
            return
        try:
            on_numbers(integrate)(python_numbers(self._arm), *map(python_numbers, stages(tau)), substeps)
        except (ArithmeticError, ValueError):
            # an overflowing state: interpreted, math.cos(inf) raises where compiled code gives NaN
            self._arm.q[:] = self._arm.qd[:] = np.nan

    def native(self) -> NativePlant:
        """Return what the compiled loop needs; see `NativePlant`.

        Raises:
            NativeError: a subclass, whose own methods the compiled loop would pass over.
        """
        check_own(self, AnalyticPlant)
        _ = STEP.address  # compiled
        return NativePlant(STEP, self._arms[0], self._arm.q, self._arm.qd, self._arms[1:], self.motors())

    @property
    def native_step(self) -> NativeFunction:
        """The function of `native`, compiled or not."""
        return STEP

    def replica(self) -> AnalyticPlant:
        """Return another plant of the same arm, for another thread."""
        twin, old = copy.copy(self), self._arms[0]
        q, qd, work = old.q.copy(), old.qd.copy(), old.work.copy()
        friction, joints = own_bristles(old.friction), own_states(old.joints)
        twin._arms = tuple(
            replace(
                arm,
                model=own_copy(arm.model),
                joints=replace(joints, inertia=arm.joints.inertia),
                friction=friction,
                q=q,
                qd=qd,
                work=work,
            )
            for arm in self._arms
        )
        twin._phase = 0
        return twin


def without_armature(model: RobotModel) -> RobotModel:
    """Return the links of an arm alone, its motors taken off.

    Raises:
        ModelError: the model is a closed form, which has no links.
    """
    return perturbed(model, np.tile([1.0] * 7 + [0.0], (model.n, 1)))


@kernel
def rk4_steps(
    model: Model,
    friction: Resistance,
    joints: Joints,
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
        joints: The joints; those with states of their own are moved on.
        q, qd: State, overwritten [rad, rad/s].
        start, middle, end: Torque at these times of each step, (n,) [N m].
        h: Step [s].
        steps: Number of steps.
        work: Working memory, (6, n).
    """
    n = len(q)
    position, velocity, acceleration, sum_v, sum_a = work[0], work[1], work[2], work[3], work[4]
    rough, moving = len(friction.viscous) > 0, len(joints.state) > 0
    for _ in range(steps):
        for i in range(n):
            position[i], velocity[i] = q[i], qd[i]
            sum_v[i] = sum_a[i] = 0.0
        begin(joints, friction, qd, start, h)
        for stage in range(4):
            torque = start if stage == 0 else end if stage == 3 else middle
            if moving:
                transmit(joints, friction, position, velocity, torque, work[5])
                forward_dynamics(model, position, velocity, work[5], acceleration)
            elif rough:
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
            advance(joints, stage, h)
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
            drag_along(friction, qd, torque, h)
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
    joints: Joints
    rk4: bool
    timestep: float
    q: Array
    qd: Array
    work: Annotated[Array, 2]


@kernel
def integrate(arm: Integrated, start: Array, middle: Array, end: Array, steps: int) -> None:
    """Advance `arm` by `steps` time steps under the torque (n,) [N m] at the start, middle and end of each."""
    if arm.rk4:
        rk4_steps(arm.model, arm.friction, arm.joints, arm.q, arm.qd, start, middle, end, arm.timestep, steps, arm.work)
    else:
        euler_steps(arm.model, arm.friction, arm.q, arm.qd, start, arm.timestep, steps, arm.work)


arm_at = structure_at(Integrated)


def _step(address: int, torque: int, substeps: int, varying: int) -> int:
    arm = arm_at(address)
    n = len(arm.q)
    start, middle, end = vector(torque, n), vector(torque + 8 * n, n), vector(torque + 16 * n, n)
    if not varying:
        middle, end = start, start
    integrate(arm, start, middle, end, substeps)
    return 0


STEP = NativeFunction(STEP_SIGNATURE, _step)
"""The native step, (arm, torque, substeps, varying) -> 0."""
