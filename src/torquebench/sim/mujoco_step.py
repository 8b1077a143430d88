"""One step of MuJoCo from compiled code: `mj_step`, or only those stages of it that a plain arm needs.

The lean step calls MuJoCo's own kinematics, composite inertia, factorisation, Newton-Euler and solve, and then does
what its integrators do. On an arm of hinges, slides, viscous damping and motors it is equal to `mj_step` in every
byte; `lean_arm.py` decides which arms those are, and checks the equality on the arm at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numba.extending import register_jitable

from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import Structure, at, vector
from torquebench.sim.friction import Resistance, resist
from torquebench.sim.mujoco_library import function, library
from torquebench.sim.native_calls import STEP_SIGNATURE, native

mj_step, mj_forward = function("mj_step"), function("mj_forward")
mj_kinematics, mj_comPos, mj_crb = function("mj_kinematics"), function("mj_comPos"), function("mj_crb")
mj_comVel, mj_rne = function("mj_comVel"), function("mj_rne")
mj_factorI, mj_solveLD = function("mj_factorI"), function("mj_solveLD")


@dataclass(frozen=True, eq=False)
class Stepped(Structure):
    """A MuJoCo model and its data, with views of what the step reads and writes."""

    m: int
    d: int
    lean: bool
    rk4: bool
    implicit_damping: bool
    """Whether Euler's method takes the damping implicitly, as MuJoCo does where there is any."""
    timestep: float
    q: Array
    qd: Array
    qdd: Array
    applied: Array
    bias: Array
    warmstart: Array
    damping: Array
    smooth: Array
    """Views of ``qpos, qvel, qacc, qfrc_applied, qfrc_bias, qacc_warmstart, dof_damping, qfrc_smooth``, (n,)."""
    M: Array
    factor: Array
    inverse_diagonal: Array
    damped: Array
    damped_inverse_diagonal: Array
    """Views of ``M, qLD, qLDiagInv, qH, qHDiagInv``: the mass matrix, its factors, and those with damping."""
    row_lengths: int
    row_addresses: int
    columns: int
    """Addresses of ``M_rownnz, M_rowadr, M_colind``, the sparsity of all these."""
    diagonal: IntArray
    """Index of each diagonal element in M, (n,)."""
    stages: Annotated[Array, 2]
    """Working memory of the Runge-Kutta method, and a row for the torque less friction, (11, n)."""
    friction: Resistance
    """Friction of the joints beside the model's own damping."""


@register_jitable(_nrt=False)
def accelerate(arm: Stepped, torque: Array) -> None:
    """Compute the acceleration of the current state under `torque` (n,) [N m] and the friction at its velocity."""
    n = len(arm.q)
    if len(arm.friction.viscous) > 0:
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
        arm.smooth[i] = -arm.qd[i] * arm.damping[i] - arm.bias[i] + torque[i]
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
    """Semi-implicit Euler as ``mj_Euler`` does it; the damping of the new velocity where there is any."""
    n, h = len(arm.q), arm.timestep
    accelerate(arm, torque)
    if arm.implicit_damping:
        for i in range(len(arm.M)):
            arm.damped[i] = arm.M[i]
        for i in range(n):
            arm.damped[arm.diagonal[i]] += h * arm.damping[i]
            arm.qdd[i] = arm.smooth[i]
        mj_factorI(
            arm.damped.ctypes.data,
            arm.damped_inverse_diagonal.ctypes.data,
            np.int32(n),
            arm.row_lengths,
            arm.row_addresses,
            arm.columns,
            0,
        )
        solve(arm, arm.qdd, arm.damped, arm.damped_inverse_diagonal)
    for i in range(n):
        arm.qd[i] += h * arm.qdd[i]
        arm.q[i] += h * arm.qd[i]


@register_jitable(_nrt=False)
def runge_kutta(arm: Stepped, start: Array, middle: Array, end: Array) -> None:
    """Classical Runge-Kutta on `arm` as ``mj_RungeKutta`` does it, with the torque of each stage's own time.

    Args:
        arm: The arm; moved on by one time step.
        start, middle, end: Torque at these times of the step, (n,) [N m].
    """
    n, h, w = len(arm.q), arm.timestep, arm.stages
    for i in range(n):
        w[8, i], w[9, i] = arm.q[i], arm.qd[i]
    for stage in range(4):
        accelerate(arm, start if stage == 0 else end if stage == 3 else middle)
        ahead = 1.0 if stage == 2 else 0.5
        for i in range(n):
            w[stage, i], w[4 + stage, i] = arm.qd[i], arm.qdd[i]
            if stage < 3:
                arm.q[i] = w[8, i] + h * (ahead * w[stage, i])
                arm.qd[i] = w[9, i] + h * (ahead * w[4 + stage, i])
    sixth, third = 1.0 / 6.0, 1.0 / 3.0
    for i in range(n):
        velocity = w[0, i] * sixth + w[1, i] * third + w[2, i] * third + w[3, i] * sixth
        acceleration = w[4, i] * sixth + w[5, i] * third + w[6, i] * third + w[7, i] * sixth
        arm.q[i] = w[8, i] + h * velocity
        arm.qd[i] = w[9, i] + h * acceleration
        arm.warmstart[i] = arm.qdd[i]  # where constraints start from in the next step


stepped_at = at(Stepped)


@lru_cache(maxsize=1)
def compiled_step() -> Any:
    """Return the step, a native function (arm, torque, substeps, varying) -> 0; see `STEP_SIGNATURE`.

    Raises:
        NativeError: MuJoCo's library cannot be called.
    """
    library()

    def step(address: int, torque: int, substeps: int, varying: int) -> int:
        arm = stepped_at(address)
        n = len(arm.q)
        start, middle, end = vector(torque, n), vector(torque + 8 * n, n), vector(torque + 16 * n, n)
        if not varying:
            middle, end = start, start
        rough = len(arm.friction.viscous) > 0
        if arm.lean or (arm.rk4 and (varying or rough)):
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
                    resist(arm.friction, arm.qd, start, arm.applied)
                mj_step(arm.m, arm.d)
        return 0

    return native(STEP_SIGNATURE, step)
