"""A MuJoCo plant in native form: which arms the lean step serves, and the proof of it on the arm at hand."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np

from torquebench.robot.mjcf import features
from torquebench.sim.friction import NONE, Resistance
from torquebench.sim.mujoco_library import addresses
from torquebench.sim.mujoco_step import Stepped, compiled_step

PROOF_STEPS = 20
"""Steps over which the lean step is compared with ``mj_step`` before it is used."""
SERVED = ("joint damping",)
"""Features the lean step serves although the analytic side has no counterpart for them."""


def native_arm(m: Any, d: Any, friction: Resistance, lean: bool | None = None) -> Stepped:
    """Return what the compiled step works on; lean where that is proven to change no byte.

    Args:
        m: The model, with its time step and integrator set.
        d: Its data; not changed.
        friction: Friction beside the model's own damping; it enters as a torque, so that what is proven of the step
            without it holds with it.
        lean: What was found of a model that this one is a copy of; None to find out.

    Raises:
        NativeError: MuJoCo's library cannot be called.
    """
    return _stepped(m, d, friction, _is_plain(m) and _lean_is_equal(m) if lean is None else lean)


def _is_plain(m: Any) -> bool:
    """Whether an arm has nothing but hinges, slides, viscous damping and motors."""
    poly = np.any(m.dof_dampingpoly != 0.0) or m.opt.enableflags != 0 or m.nhistory > 0
    return not poly and not any(present for name, present in features(m).items() if name not in SERVED)


def _lean_is_equal(m: Any) -> bool:
    """Whether the lean step equals ``mj_step`` in every byte, from a random state under random torques."""
    own = copy.copy(m)
    lean, whole = mujoco.MjData(own), mujoco.MjData(own)
    rng = np.random.default_rng(0)
    for d in (lean, whole):
        d.qpos[:], d.qvel[:] = np.random.default_rng(1).normal(size=(2, own.nv))
    arm = _stepped(own, lean, NONE, True)
    step = compiled_step().ctypes
    for _ in range(PROOF_STEPS):
        torque = np.tile(rng.normal(size=own.nv), (3, 1))
        step(arm.address, torque.ctypes.data, 1, 0)
        whole.qfrc_applied[:] = torque[0]
        mujoco.mj_step(own, whole)
        # the forces too: an error of an ulp in them moves the state by less than one of its own ulps in most steps
        if any(getattr(lean, x).tobytes() != getattr(whole, x).tobytes() for x in ("qpos", "qvel", "qfrc_smooth")):
            return False
    return bool(np.all(np.isfinite(whole.qpos)))


def _stepped(m: Any, d: Any, friction: Resistance, lean: bool) -> Stepped:
    disabled = m.opt.disableflags & (mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_DAMPER)
    undamped = m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_DAMPER
    at = addresses(m, d)
    return Stepped(
        m=at[0],
        d=at[1],
        lean=lean,
        rk4=m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4,
        implicit_damping=not disabled and bool(np.any(m.dof_damping > 0.0)),
        timestep=float(m.opt.timestep),
        q=d.qpos,
        qd=d.qvel,
        qdd=d.qacc,
        applied=d.qfrc_applied,
        bias=d.qfrc_bias,
        warmstart=d.qacc_warmstart,
        damping=np.zeros(m.nv) if undamped else m.dof_damping,
        smooth=d.qfrc_smooth,
        M=d.M,
        factor=d.qLD,
        inverse_diagonal=d.qLDiagInv,
        damped=d.qH,
        damped_inverse_diagonal=d.qHDiagInv,
        row_lengths=m.M_rownnz.ctypes.data,
        row_addresses=m.M_rowadr.ctypes.data,
        columns=m.M_colind.ctypes.data,
        diagonal=(m.M_rowadr + m.M_rownnz - 1).astype(np.int64),
        stages=np.zeros((11, m.nv)),
        friction=friction,
    )
