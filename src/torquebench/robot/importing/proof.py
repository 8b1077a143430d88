"""Proof that a flattened arm is the published one: both in plain MuJoCo, at random states."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.kernel import Array
from torquebench.robot.importing.chain import Chain

STATES = 100
LIMIT = 1e-12
_LIGHT = 1e-4
"""Joints that have less than this fraction of the heaviest one's inertia show MuJoCo's own rounding."""


class Proof(NamedTuple):
    """Largest relative differences between a flattened arm and the published file, over all states.

    Torques are held against the largest torque of any joint: a light wrist's own may be the small difference of large
    moments. The mass matrix is held against each joint's own inertia, so that no light joint hides behind a heavy one.
    """

    mass_matrix: float
    """abs(A - B) over sqrt(A_ii A_jj), very light joints being held against a ten-thousandth of the heaviest."""
    bias: float
    """Torque of gravity and velocity, over the largest inverse dynamics torque."""
    inverse_dynamics: float
    """Torque for a random acceleration, over the largest."""
    tool: float
    """Distance of the tools, over the largest distance of the tool from the world's origin."""

    @property
    def worst(self) -> float:
        """The largest of them."""
        return max(self)

    @property
    def holds(self) -> bool:
        """Whether all differences are within `LIMIT`."""
        return self.worst <= LIMIT


def prove(chain: Chain, plain: Any, gravity: Array, tool: Any) -> Proof:
    """Compare a flattened arm with the published one, damping, friction and constraints being off in both.

    Joints that are not kept stand still at home in the published arm; bodies that are left out have no mass there.

    Args:
        chain: The published arm.
        plain: The flattened one, compiled.
        gravity: That of the flattened one, (3,) [m/s^2].
        tool: Function of the published arm's data that returns where its tool is, (3,) [m].
    """
    m = _bare(chain.model)
    m.opt.gravity[:] = gravity
    for b in chain.removed:
        m.body_mass[b], m.body_inertia[b] = 0.0, 0.0
        first, count = int(m.body_dofadr[b]), int(m.body_dofnum[b])
        m.dof_armature[first : first + count] += 1.0  # so that MuJoCo's mass matrix has an inverse
    other = _bare(plain)
    random, dofs, places = np.random.default_rng(0), chain.dofs, chain.places
    n = len(dofs)
    low, high = np.full(n, -np.pi), np.full(n, np.pi)
    for i, j in enumerate(chain.joints):
        if m.jnt_limited[j]:
            low[i], high[i] = m.jnt_range[j]
        elif m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
            low[i], high[i] = -0.5, 0.5
    a, b = mujoco.MjData(m), mujoco.MjData(other)
    columns: list[list[tuple[Array, Array]]] = [[], [], [], []]
    for _ in range(STATES):
        q, qd, qdd = random.uniform(low, high), random.normal(0.0, 1.0, n), random.normal(0.0, 3.0, n)
        a.qpos[:], a.qvel[:], a.qacc[:] = chain.home, 0.0, 0.0
        a.qpos[places], a.qvel[dofs], a.qacc[dofs] = q, qd, qdd
        b.qpos[:], b.qvel[:], b.qacc[:] = q, qd, qdd
        for model, data in ((m, a), (other, b)):
            mujoco.mj_inverse(model, data)
        M, N = np.zeros((m.nv, m.nv)), np.zeros((n, n))
        mujoco.mj_fullM(m, a, M)
        mujoco.mj_fullM(other, b, N)
        M = M[np.ix_(dofs, dofs)]
        own = np.sqrt(np.maximum(np.diag(M), _LIGHT * np.max(np.diag(M))))
        scale = np.outer(own, own)
        columns[0].append(((M - N) / scale, np.ones(1)))
        columns[1].append((a.qfrc_bias[dofs] - b.qfrc_bias, a.qfrc_inverse[dofs].copy()))
        columns[2].append((a.qfrc_inverse[dofs] - b.qfrc_inverse, a.qfrc_inverse[dofs].copy()))
        columns[3].append((tool(a) - b.site("tool").xpos, np.atleast_1d(np.linalg.norm(b.site("tool").xpos))))
    return Proof(*(_relative(column) for column in columns))


def _relative(pairs: list[tuple[Array, Array]]) -> float:
    """Return the largest difference of some, over the largest size of what differs."""
    differences, sizes = (np.abs(np.array(column)) for column in zip(*pairs, strict=True))
    return float(np.max(differences)) / max(float(np.max(sizes)), 1e-300)


def _bare(model: Any) -> Any:
    """Return a copy of a model that has nothing but weight and inertia."""
    m = copy.copy(model)
    for name in (
        "dof_damping",
        "dof_dampingpoly",
        "dof_frictionloss",
        "jnt_stiffness",
        "jnt_stiffnesspoly",
        "actuator_damping",
        "actuator_dampingpoly",
        "tendon_stiffness",
        "tendon_stiffnesspoly",
        "tendon_damping",
        "tendon_dampingpoly",
        "tendon_frictionloss",
        "tendon_armature",
        "body_gravcomp",
    ):
        getattr(m, name)[:] = 0.0
    m.jnt_plasticadr[:] = -1
    m.opt.density = m.opt.viscosity = 0.0
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    m.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    m.opt.enableflags = 0
    return m
