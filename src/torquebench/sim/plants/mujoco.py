"""The arm in MuJoCo, and MuJoCo's own terms of the dynamics for comparison."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import numpy.typing as npt

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.kernel.twin import on_numbers, python_numbers
from torquebench.robot.library import ArmSource
from torquebench.robot.lock import Lock, falling_in, phases_of
from torquebench.robot.mjcf import compile_arm, joint_names, tool_frame, torque_limits
from torquebench.robot.mjcf_links import links_of, with_links
from torquebench.robot.payload import Payload, add_payload
from torquebench.robot.perturbation import scaled
from torquebench.robot.robot_model import Passive
from torquebench.sim.friction import Friction, acting, drag_along, own_bristles, resist
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
from torquebench.sim.plants import NativePlant, check_own, check_scheme, range_of, stages

if TYPE_CHECKING:
    from torquebench.sim.native import NativeFunction

_CODES = {"rk4": mujoco.mjtIntegrator.mjINT_RK4, "euler": mujoco.mjtIntegrator.mjINT_EULER}


def _quiet(message: str) -> None:
    """Receive MuJoCo's warnings so that no MUJOCO_LOG.TXT is written; the loop checks the state itself."""


def load_mujoco(source: ArmSource) -> tuple[Any, Passive]:
    """Return an arm for stepping, and what its file says of friction and limits, which the model has no more.

    Joints must be hinges or slides, and a bad state must not reset itself.

    Raises:
        ModelError: no such model, it does not compile, or it has other joints.
    """
    compiled, passive = compile_arm(source)
    m = copy.copy(compiled)
    if m.nq != m.nv or m.nv == 0:
        raise ModelError(f"{source}: wanted hinge and slide joints only, at least one")
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    m.opt.enableflags = 0  # sleeping bodies freeze in mid-air; discrete inverse dynamics is another quantity
    return m, passive


def mass_matrices(m: Any, q: Array) -> Array:
    """Return MuJoCo's mass matrix, armature included, (N, n, n) [kg m^2], at positions `q` (N, n) [rad]."""
    d, out = mujoco.MjData(m), np.zeros((len(q), m.nv, m.nv))
    for i, position in enumerate(q):
        d.qpos[:] = position
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, out[i])
    return out


class MujocoPlant:
    """A plant stepped by MuJoCo; follows the `Plant` protocol.

    Torque enters as ``qfrc_applied``, so that disturbances beyond an actuator's range act in full; the model's
    own actuators stay at zero.

    Args:
        source: Name of a model in ``models/``, path of an MJCF or URDF file, or an arm that was read from one.
        timestep: Integration step [s]; overrides the file's.
        integrator: ``rk4`` or ``euler``; overrides the file's.
        payload: What the last joint's link takes up, at the start or in the middle of a run.
        lock: Joint that is held, from the start or from the middle of a run on.
        friction: Friction of the joints; None for that which the arm's file gives them, if any.
        transmission: What lies between motors and links; None for rigid joints.
        factors: What the links' parameters are multiplied by, (n, 8): see `scaled`; None for the links as they are.
        stops: Whether a run ends where a joint leaves its range; see `Bounded`.

    Raises:
        ModelError: the model cannot be used as a plant, or cannot carry the payload.
        ValueError: the time step is not finite and positive, the integrator is unknown, or friction or transmission do
            not fit them.
    """

    def __init__(
        self,
        source: ArmSource,
        timestep: float = 0.001,
        integrator: str = "rk4",
        *,
        payload: Payload | None = None,
        lock: Lock | None = None,
        friction: Friction | None = None,
        transmission: Transmission | None = None,
        factors: Array | None = None,
        stops: bool = False,
    ) -> None:
        check_scheme(timestep, integrator, transmission)
        mujoco.set_mju_user_warning(_quiet)
        self._m, passive = load_mujoco(source)
        self._m.opt.timestep = timestep
        self._m.opt.integrator = _CODES[integrator]
        if factors is not None:
            self._m = with_links(self._m, scaled(links_of(self._m), factors))
        self.range = range_of(passive) if stops else None
        self.tau_max = torque_limits(self._m)[0]
        joints = rigid(int(self._m.nv))
        masses = moved_by(transmission, self._m.dof_armature.copy(), functools.partial(mass_matrices, self._m))
        if transmission is not None:
            links = links_of(self._m)
            joints = transmission.of_joints(links.armature)
            self._m = with_links(self._m, links._replace(armature=np.zeros_like(links.armature)))
        self.friction, self._resistance = acting(friction, passive, masses, timestep, integrator, self.tau_max)
        check_followed(joints, self._resistance, functools.partial(mass_matrices, self._m), timestep)
        self.sensor = "link" if transmission is None else transmission.sensor
        self._phases, self._free, self._arms = phases_of(payload, lock), [], list[tuple[Any, Joints]]()
        for _, load, brake in self._phases:
            free = m = self._m if load is None else with_links(self._m, add_payload(links_of(self._m), load))
            own = joints
            if brake is not None and transmission is None:
                m = copy.copy(free)
                m.dof_armature[:] = brake.on(m.dof_armature)
                mujoco.mj_setConst(m, mujoco.MjData(m))
            elif brake is not None:
                own = replace(joints, inertia=brake.on(joints.inertia))
            self._free.append(free)
            self._arms.append((m, own))
        self.changes = tuple(at for at, _, _ in self._phases[1:])
        self._phase, self._m = 0, self._arms[0][0]
        self._d = mujoco.MjData(self._m)
        self._native: NativePlant | None = None
        self._lean: list[bool] | None = None
        self.n = int(self._m.nv)
        self.timestep = timestep
        self.joint_names = tuple(joint_names(self._m))

    @property
    def _now(self) -> Any:
        """The model of the arm that it is now."""
        return self._arms[self._phase][0]

    @property
    def _joints(self) -> Joints:
        """Its joints."""
        return self._arms[self._phase][1]

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,), as the first of its arms."""
        self._phase = 0
        mujoco.mj_resetData(self._m, self._d)
        if len(self.motors()) > 0:
            self._d.qpos[:] = q
            mujoco.mj_forward(self._m, self._d)
            settle(self._joints, q, self._d.qfrc_bias - self._d.qfrc_passive)
        self._d.qpos[:], self._d.qvel[:] = q, qd
        self._resistance.bristles[:] = 0.0

    def change(self) -> None:
        """Go on as the next of its arms; see `Changing`."""
        self._phase += 1
        if brake := falling_in(self._phases, self._phase):
            free, d = self._free[self._phase], self._d
            brake.stop(self.motors(), d.qvel, lambda: mass_matrices(free, d.qpos[None])[0])

    def state(self) -> tuple[Array, Array]:
        """Return copies of the joint position [rad] and velocity [rad/s], each (n,)."""
        return self._d.qpos.copy(), self._d.qvel.copy()

    def motors(self) -> Array:
        """Return position [rad] and velocity [rad/s] of the motors, (2, n), or (0, n); see `Geared`."""
        return motors_in(self._joints)

    def step(self, tau: Array, substeps: int) -> None:
        """Integrate `substeps` time steps under the joint torque `tau` [N m]: see `Plant.step`."""
        start, middle, end = stages(tau)
        rough, rk4 = self.friction is not None, self._m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        if rk4 and (rough or len(self._joints.state) > 0 or tau.ndim == 2):
            for _ in range(substeps):
                self._runge_kutta(start, middle, end)
        elif rough:
            for _ in range(substeps):
                on_numbers(drag_along)(self._resistance, self._d.qvel, start, self.timestep)
                self._apply(start)
                mujoco.mj_step(self._now, self._d)
        else:
            self._d.qfrc_applied[:] = start
            mujoco.mj_step(self._now, self._d, substeps)

    def _apply(self, torque: Array) -> None:
        """Apply `torque` (n,) [N m] minus the friction at the current velocity, through the joints."""
        self._d.qfrc_applied[:] = torque
        if len(self._joints.state) > 0:
            d = self._d
            given = (d.qpos, d.qvel, d.qfrc_applied, d.qfrc_applied)
            on_numbers(transmit)(python_numbers(self._joints), self._resistance, *map(python_numbers, given))
        elif self.friction is not None:
            on_numbers(resist)(self._resistance, self._d.qvel, self._d.qfrc_applied, self._d.qfrc_applied)

    def _runge_kutta(self, start: Array, middle: Array, end: Array) -> None:
        """One Runge-Kutta step like ``mj_step``'s, with the torque at the time of each stage."""
        d, h = self._d, self.timestep
        q, qd = d.qpos.copy(), d.qvel.copy()
        velocity, acceleration = np.zeros(self.n), np.zeros(self.n)
        stages_of = ((start, 0.5, 1.0 / 6.0), (middle, 0.5, 1.0 / 3.0), (middle, 1.0, 1.0 / 3.0), (end, 0.0, 1.0 / 6.0))
        joints = python_numbers(self._joints)
        on_numbers(begin)(joints, self._resistance, d.qvel, start, h)
        for stage, (torque, ahead, weight) in enumerate(stages_of):
            self._apply(torque)
            mujoco.mj_forward(self._now, d)
            velocity += d.qvel * weight
            acceleration += d.qacc * weight
            at = d.qvel.copy()
            d.qpos[:], d.qvel[:] = q + h * (ahead * at), qd + h * (ahead * d.qacc)
            on_numbers(advance)(joints, stage, h)
        d.qpos[:], d.qvel[:] = q + h * velocity, qd + h * acceleration
        d.qacc_warmstart[:] = d.qacc  # where constraints start from in the next step

    def native(self) -> NativePlant:
        """Return what the compiled loop needs; see `NativePlant`.

        Raises:
            NativeError: MuJoCo's library cannot be called from compiled code, or this is a subclass, whose own
                methods the compiled loop would pass over.
        """
        check_own(self, MujocoPlant)
        if self._native is None:
            from torquebench.sim.plants.mujoco_native import STEP, native_arm

            lean: Sequence[bool | None] = self._lean or [None] * len(self._arms)
            arms = [
                native_arm(m, self._d, self._resistance, joints, own)
                for (m, joints), own in zip(self._arms, lean, strict=True)
            ]
            self._lean = [arm.lean for arm in arms]
            _ = STEP.address  # compiled
            self._native = NativePlant(STEP, arms[0], self._d.qpos, self._d.qvel, tuple(arms[1:]), self.motors())
        return self._native

    @property
    def native_step(self) -> NativeFunction:
        """The function of `native`, compiled or not."""
        from torquebench.sim.plants.mujoco_native import STEP

        return STEP

    def replica(self) -> MujocoPlant:
        """Return another plant of the same arm, for another thread."""
        twin, joints = copy.copy(self), own_states(self._arms[0][1])
        twin._arms = [(copy.copy(m), replace(joints, inertia=own.inertia)) for m, own in self._arms]
        twin._phase, twin._m = 0, twin._arms[0][0]
        twin._d = mujoco.MjData(twin._m)
        twin._resistance = own_bristles(self._resistance)
        twin._native = None
        return twin


class MujocoModel:
    """MuJoCo's terms of the dynamics under the method names of `RobotModel`, each computed by MuJoCo alone.

    Args:
        source: As of `MujocoPlant`.
    """

    def __init__(self, source: ArmSource) -> None:
        self._m, _ = load_mujoco(source)
        self._d = mujoco.MjData(self._m)
        self.name = str(source)
        self.n = int(self._m.nv)
        self.joint_names = tuple(joint_names(self._m))

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """Mass matrix, armature included, (N, n, n) [kg m^2], at positions `q` (N, n) [rad]."""
        return mass_matrices(self._m, np.asarray(q, dtype=np.float64))

    def bias_forces(self, q: npt.ArrayLike, qd: npt.ArrayLike) -> Array:
        """Coriolis, centrifugal and gravity torque ``qfrc_bias``, (N, n) [N m]."""
        out = []
        for position, velocity in zip(np.asarray(q), np.asarray(qd), strict=True):
            self._forward(position, velocity)
            out.append(self._d.qfrc_bias.copy())
        return np.array(out)

    def gravity(self, q: npt.ArrayLike) -> Array:
        """Torque that holds the arm still, (N, n) [N m]: ``qfrc_bias`` at rest."""
        return self.bias_forces(q, np.zeros_like(np.asarray(q, dtype=np.float64)))

    def inverse_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike) -> Array:
        """Torque that produces the acceleration `qdd` (N, n) [rad/s^2], by ``mj_inverse``, (N, n) [N m]."""
        out = []
        for position, velocity, acceleration in zip(np.asarray(q), np.asarray(qd), np.asarray(qdd), strict=True):
            self._forward(position, velocity)
            self._d.qacc[:] = acceleration
            mujoco.mj_inverse(self._m, self._d)
            out.append(self._d.qfrc_inverse.copy())
        return np.array(out)

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool in the world, (N, 4, 4) [-, m]; see `tool_frame`."""
        out = np.tile(np.eye(4), (len(np.asarray(q)), 1, 1))
        for i, position in enumerate(np.asarray(q)):
            self._d.qpos[:] = position
            mujoco.mj_kinematics(self._m, self._d)
            rotation, origin = tool_frame(self._m, self._d, self.name)
            out[i, :3, :3], out[i, :3, 3] = rotation.reshape(3, 3), origin
        return out

    def _forward(self, q: Array, qd: Array) -> None:
        self._d.qpos[:], self._d.qvel[:] = q, qd
        mujoco.mj_forward(self._m, self._d)
