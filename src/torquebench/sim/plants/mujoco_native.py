"""A MuJoCo plant in native form: MuJoCo's C functions called from compiled code.

A step is `mj_step`, or on a plain arm only those of its stages that such an arm needs. The lean step calls MuJoCo's
own kinematics, composite inertia, factorisation, Newton-Euler and solve, and then does what its integrators do. On an
arm of hinges, slides and motors it is equal to `mj_step` in every byte, which is checked on the arm
at hand before it is used.
"""

from __future__ import annotations

import copy
import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from numba import types
from numba.extending import register_jitable

from torquebench.kernel import Array
from torquebench.kernel.struct import Structure, structure_at, vector
from torquebench.robot.mjcf import features
from torquebench.sim.friction import NONE, Resistance, drag_along, resist
from torquebench.sim.joints import Joints, advance, begin, rigid, transmit
from torquebench.sim.native import STEP_SIGNATURE, NativeFunction
from torquebench.sim.plants import NativeError

_STATE = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL)
_ON = types.void(types.intp, types.intp)
SIGNATURES = {
    "mj_step": _ON,
    "mj_forward": _ON,
    "mj_kinematics": _ON,
    "mj_comPos": _ON,
    "mj_crb": _ON,
    "mj_comVel": _ON,
    "mj_rne": types.void(types.intp, types.intp, types.int32, types.intp),
    "mj_factorI": types.void(types.intp, types.intp, types.int32, *[types.intp] * 4),
    "mj_solveLD": types.void(types.intp, types.intp, types.intp, types.int32, types.int32, *[types.intp] * 4),
}
"""C functions by name; the last two are exported by the library but not declared in its header."""


def c_function(name: str) -> Any:
    """Return one of `SIGNATURES` for use in compiled code."""
    return types.ExternalFunction(name, SIGNATURES[name])


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Make the functions of `SIGNATURES` known to compiled code by name, and return MuJoCo's library.

    Raises:
        NativeError: the library that the Python package has loaded is not found, or lacks a function.
    """
    folder = Path(mujoco.__file__).parent
    found = sorted(p for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco*.dll") for p in folder.glob(pattern))
    if len(found) != 1:
        raise NativeError(f"{len(found)} MuJoCo libraries in its package, wanted one")
    opened = ctypes.CDLL(str(found[0]))
    for name in SIGNATURES:
        try:
            address = ctypes.cast(getattr(opened, name), ctypes.c_void_p).value
        except AttributeError as error:
            raise NativeError(f"MuJoCo {mujoco.__version__} exports no {name}") from error
        llvm.add_symbol(name, address)
    return opened


def addresses(m: Any, d: Any) -> tuple[int, int]:
    """Return the addresses of a model and its data after checking that the library sees them there.

    The library is asked for a state that was written through the Python bindings.

    Raises:
        NativeError: it answers with another state.
    """
    call = library().mj_getState
    call.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
    call.restype = None
    try:
        at = int(m._address), int(d._address)
    except AttributeError as error:
        raise NativeError(f"MuJoCo {mujoco.__version__} does not tell where its structures lie") from error
    mark = np.arange(1.0, 1.0 + m.nq + m.nv)
    before = np.concatenate([d.qpos, d.qvel])
    d.qpos[:], d.qvel[:] = mark[: m.nq], mark[m.nq :]
    seen = np.zeros(m.nq + m.nv)
    call(*at, seen.ctypes.data, _STATE)
    d.qpos[:], d.qvel[:] = before[: m.nq], before[m.nq :]
    if not np.array_equal(seen, mark):
        raise NativeError("MuJoCo's library reads another state than its Python bindings write")
    return at


mj_step, mj_forward = c_function("mj_step"), c_function("mj_forward")
mj_kinematics, mj_comPos, mj_crb = c_function("mj_kinematics"), c_function("mj_comPos"), c_function("mj_crb")
mj_comVel, mj_rne = c_function("mj_comVel"), c_function("mj_rne")
mj_factorI, mj_solveLD = c_function("mj_factorI"), c_function("mj_solveLD")


@dataclass(frozen=True, eq=False)
class Stepped(Structure):
    """A MuJoCo model and its data, with views of what the step reads and writes."""

    m: int
    d: int
    lean: bool
    rk4: bool
    timestep: float
    q: Array
    qd: Array
    qdd: Array
    applied: Array
    bias: Array
    warmstart: Array
    smooth: Array
    """Views of ``qpos, qvel, qacc, qfrc_applied, qfrc_bias, qacc_warmstart, qfrc_smooth``, (n,)."""
    M: Array
    factor: Array
    inverse_diagonal: Array
    """Views of ``M, qLD, qLDiagInv``: the mass matrix and its factors."""
    row_lengths: int
    row_addresses: int
    columns: int
    """Addresses of ``M_rownnz, M_rowadr, M_colind``, the sparsity of all these."""
    stages: Annotated[Array, 2]
    """Working memory of the Runge-Kutta method, and a row for the torque minus friction, (11, n)."""
    friction: Resistance
    """Friction of the joints."""
    joints: Joints
    """The joints themselves."""


@register_jitable(_nrt=False)
def accelerate(arm: Stepped, torque: Array) -> None:
    """Compute the acceleration of the current state under `torque` (n,) [N m], with friction, through the joints."""
    n = len(arm.q)
    if len(arm.joints.state) > 0:
        transmit(arm.joints, arm.friction, arm.q, arm.qd, torque, arm.stages[10])
        torque = arm.stages[10]
    elif len(arm.friction.viscous) > 0:
        resist(arm.friction, arm.qd, torque, arm.stages[10])
        torque = arm.stages[10]
    if not arm.lean:
        for i in range(n):
            arm.applied[i] = torque[i]
        mj_forward(arm.m, arm.d)
        return
    mj_kinematics(arm.m, arm.d)
    mj_comPos(arm.m, arm.d)
    mj_crb(arm.m, arm.d)
    mj_comVel(arm.m, arm.d)
    mj_rne(arm.m, arm.d, np.int32(0), arm.bias.ctypes.data)
    for i in range(len(arm.M)):
        arm.factor[i] = arm.M[i]
    mj_factorI(
        arm.factor.ctypes.data,
        arm.inverse_diagonal.ctypes.data,
        np.int32(n),
        arm.row_lengths,
        arm.row_addresses,
        arm.columns,
        0,
    )
    for i in range(n):
        arm.smooth[i] = 0.0 - arm.bias[i] + torque[i]
        arm.qdd[i] = arm.smooth[i]
    solve(arm, arm.qdd, arm.factor, arm.inverse_diagonal)


@register_jitable(_nrt=False)
def solve(arm: Stepped, x: Array, factor: Array, inverse_diagonal: Array) -> None:
    """Replace `x` (n,) by the solution with a matrix given by its `factor` and `inverse_diagonal`, on `arm`."""
    mj_solveLD(
        x.ctypes.data,
        factor.ctypes.data,
        inverse_diagonal.ctypes.data,
        np.int32(len(x)),
        np.int32(1),
        arm.row_lengths,
        arm.row_addresses,
        arm.columns,
        0,
    )


@register_jitable(_nrt=False)
def euler(arm: Stepped, torque: Array) -> None:
    """Semi-implicit Euler as ``mj_Euler`` does it."""
    n, h = len(arm.q), arm.timestep
    drag_along(arm.friction, arm.qd, torque, h)
    accelerate(arm, torque)
    for i in range(n):
        arm.qd[i] += h * arm.qdd[i]
        arm.q[i] += h * arm.qd[i]


@register_jitable(_nrt=False)
def runge_kutta(arm: Stepped, start: Array, middle: Array, end: Array) -> None:
    """Classical Runge-Kutta on `arm` as ``mj_RungeKutta`` does it, with the torque at the time of each stage.

    Args:
        arm: The arm; moved on by one time step.
        start, middle, end: Torque at these times of the step, (n,) [N m].
    """
    n, h, w = len(arm.q), arm.timestep, arm.stages
    for i in range(n):
        w[8, i], w[9, i] = arm.q[i], arm.qd[i]
    begin(arm.joints, arm.friction, arm.qd, start, h)
    for stage in range(4):
        accelerate(arm, start if stage == 0 else end if stage == 3 else middle)
        ahead = 1.0 if stage == 2 else 0.5
        for i in range(n):
            w[stage, i], w[4 + stage, i] = arm.qd[i], arm.qdd[i]
            if stage < 3:
                arm.q[i] = w[8, i] + h * (ahead * w[stage, i])
                arm.qd[i] = w[9, i] + h * (ahead * w[4 + stage, i])
        advance(arm.joints, stage, h)
    sixth, third = 1.0 / 6.0, 1.0 / 3.0
    for i in range(n):
        velocity = w[0, i] * sixth + w[1, i] * third + w[2, i] * third + w[3, i] * sixth
        acceleration = w[4, i] * sixth + w[5, i] * third + w[6, i] * third + w[7, i] * sixth
        arm.q[i] = w[8, i] + h * velocity
        arm.qd[i] = w[9, i] + h * acceleration
        arm.warmstart[i] = arm.qdd[i]  # where constraints start from in the next step


stepped_at = structure_at(Stepped)


def _step(address: int, torque: int, substeps: int, varying: int) -> int:
    arm = stepped_at(address)
    n = len(arm.q)
    start, middle, end = vector(torque, n), vector(torque + 8 * n, n), vector(torque + 16 * n, n)
    if not varying:
        middle, end = start, start
    rough, moving = len(arm.friction.viscous) > 0, len(arm.joints.state) > 0
    if arm.lean or (arm.rk4 and (varying or rough or moving)):
        for _ in range(substeps):
            if arm.rk4:
                runge_kutta(arm, start, middle, end)
            else:
                euler(arm, start)
    else:
        for i in range(n):
            arm.applied[i] = start[i]
        for _ in range(substeps):
            if rough:
                drag_along(arm.friction, arm.qd, start, arm.timestep)
                resist(arm.friction, arm.qd, start, arm.applied)
            mj_step(arm.m, arm.d)
    return 0


STEP = NativeFunction(STEP_SIGNATURE, _step)
"""The native step, (arm, torque, substeps, varying) -> 0; `library` must have been called before it is used."""
PROOF_STEPS = 20
"""Steps over which the lean step is compared with ``mj_step`` before it is used."""


def native_arm(m: Any, d: Any, friction: Resistance, joints: Joints, lean: bool | None = None) -> Stepped:
    """Return what the compiled step works on; lean where that is proven to change no byte.

    Args:
        m: The model, with its time step and integrator set.
        d: Its data; not changed.
        friction: Friction of the joints; it enters as a torque, so that what is proven of the step
            without it holds with it.
        joints: The joints, for which the same holds.
        lean: What was found of a model that this one is a copy of; None to find out.

    Raises:
        NativeError: MuJoCo's library cannot be called.
    """
    return _stepped(m, d, friction, joints, _is_plain(m) and _lean_is_equal(m) if lean is None else lean)


def _is_plain(m: Any) -> bool:
    """True if an arm has only hinges, slides and motors."""
    return m.opt.enableflags == 0 and m.nhistory == 0 and not any(features(m).values())


def _lean_is_equal(m: Any) -> bool:
    """True if the lean step equals ``mj_step`` in every byte, from a random state under random torques."""
    own = copy.copy(m)
    lean, whole = mujoco.MjData(own), mujoco.MjData(own)
    rng = np.random.default_rng(0)
    for d in (lean, whole):
        d.qpos[:], d.qvel[:] = np.random.default_rng(1).normal(size=(2, own.nv))
    arm = _stepped(own, lean, NONE, rigid(int(own.nv)), True)
    step = STEP.call
    for _ in range(PROOF_STEPS):
        torque = np.tile(rng.normal(size=own.nv), (3, 1))
        step(arm.address, torque.ctypes.data, 1, 0)
        whole.qfrc_applied[:] = torque[0]
        mujoco.mj_step(own, whole)
        # the forces too: an error of an ulp in them moves the state by less than one of its own ulps in most steps
        if any(getattr(lean, x).tobytes() != getattr(whole, x).tobytes() for x in ("qpos", "qvel", "qfrc_smooth")):
            return False
    return bool(np.all(np.isfinite(whole.qpos)))


def _stepped(m: Any, d: Any, friction: Resistance, joints: Joints, lean: bool) -> Stepped:
    at = addresses(m, d)
    return Stepped(
        m=at[0],
        d=at[1],
        lean=lean,
        rk4=m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4,
        timestep=float(m.opt.timestep),
        q=d.qpos,
        qd=d.qvel,
        qdd=d.qacc,
        applied=d.qfrc_applied,
        bias=d.qfrc_bias,
        warmstart=d.qacc_warmstart,
        smooth=d.qfrc_smooth,
        M=d.M,
        factor=d.qLD,
        inverse_diagonal=d.qLDiagInv,
        row_lengths=m.M_rownnz.ctypes.data,
        row_addresses=m.M_rowadr.ctypes.data,
        columns=m.M_colind.ctypes.data,
        stages=np.zeros((11, m.nv)),
        friction=friction,
        joints=joints,
    )
