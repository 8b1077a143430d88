"""The links of a compiled MJCF arm: reading them in the frames of its joints, and changing them there."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.perturbation import Links

ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
"""Kinds of actuators that drive one joint."""

SPEEDS = "speed_limits"
"""Custom numbers of an MJCF file: the greatest speed of each joint [rad/s; m/s of a slide], 0 for none."""
GIVEN = "torque_limits_given"
"""Custom numbers of an imported arm: 1 for each joint whose torque limit was given to the import, else 0."""


def joint_name(m: Any, joint: int) -> str:
    """Return the name of a joint of a compiled model, or its number from 1."""
    return mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_JOINT, joint) or f"joint{joint + 1}"


def numeric(m: Any, name: str) -> Array | None:
    """Return custom numbers of a compiled model, one for each joint, (n,); None where there are not so many."""
    i = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if i < 0 or int(m.numeric_size[i]) != m.njnt:
        return None
    first = int(m.numeric_adr[i])
    return np.array(m.numeric_data[first : first + m.njnt])


def speed_limits(m: Any) -> Array | None:
    """Return the greatest speed of each joint, (n,) [rad/s], infinite where the file states none.

    MJCF has no such limits: they are the custom numbers `SPEEDS`. None where these do not fit the joints.
    """
    if mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_NUMERIC, SPEEDS) < 0:
        return np.full(m.njnt, np.inf)
    speeds = numeric(m, SPEEDS)
    if speeds is None or not (np.all(np.isfinite(speeds)) and np.all(speeds >= 0.0)):
        return None
    return np.where(speeds > 0.0, speeds, np.inf)


def frames(m: Any, d: Any) -> tuple[list[Array], list[Array]]:
    """Return orientation (3, 3) and origin (3,) [m] of the base and of each joint's frame in the world, at q = 0.

    Frame i sits at joint i's anchor with z along its axis (the body's axes, where its z is the joint's); `d` is the
    arm `at_zero`.
    """
    rotations = [np.eye(3)] + [_joint_frame(m, d, j) for j in range(m.nv)]
    return rotations, [np.zeros(3)] + [d.xanchor[j].copy() for j in range(m.nv)]


def at_zero(m: Any) -> Any:
    """Return data of the arm at q = 0, with its kinematics done."""
    d = mujoco.MjData(m)
    d.qpos[:] = 0.0
    mujoco.mj_kinematics(m, d)
    mujoco.mj_comPos(m, d)
    return d


def links_of(m: Any, d: Any = None) -> Links:
    """Return the links of an arm of hinges and slides.

    Bodies without joints belong to the link that carries them; a body with several joints becomes several links, all
    but the last without mass. `d` is the arm `at_zero`, where it is there already.
    """
    n, d = int(m.nv), at_zero(m) if d is None else d
    rotations, origins = frames(m, d)
    links = Links(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.array(m.dof_armature))
    for j in range(n):
        body = int(m.jnt_bodyid[j])
        if j == m.body_jntadr[body] + m.body_jntnum[body] - 1:
            rigid = [b for b in range(1, m.nbody) if carrier(m, b) == body]
            links.mass[j], links.com[j], links.inertia[j] = lump(m, d, rigid, rotations[j + 1], origins[j + 1])
    return links


def with_links(m: Any, links: Links) -> Any:
    """Return a copy of a compiled arm with other links; bodies of unchanged links are left alone.

    Args:
        m: The arm.
        links: As `links_of` returns them.

    Raises:
        ModelError: MuJoCo has compiled the arm for a special case that these links are not.
    """
    changed, d = copy.copy(m), at_zero(m)
    before, (rotations, origins) = links_of(m, d), frames(m, d)
    for j in range(m.nv):
        same = (np.array_equal(getattr(links, x)[j], getattr(before, x)[j]) for x in ("mass", "com", "inertia"))
        if all(same):
            continue
        body = int(m.jnt_bodyid[j])
        axes = d.xmat[body].reshape(3, 3)
        for b in range(1, m.nbody):
            if carrier(m, b) == body:  # welded to it: what they have is among the link's
                changed.body_mass[b], changed.body_inertia[b] = 0.0, 0.0
        across = axes.T @ rotations[j + 1]
        principal, directions = np.linalg.eigh(across @ links.inertia[j] @ across.T)
        directions[:, 2] *= np.sign(np.linalg.det(directions))
        changed.body_mass[body], changed.body_inertia[body] = links.mass[j], principal
        changed.body_ipos[body] = axes.T @ (origins[j + 1] + rotations[j + 1] @ links.com[j] - d.xpos[body])
        mujoco.mju_mat2Quat(changed.body_iquat[body], directions.ravel())
        changed.body_sameframe[body] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    changed.dof_armature[:] = links.armature
    try:
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
    except mujoco.FatalError as error:
        raise ModelError(f"MuJoCo cannot change the links of this arm: {error}") from error
    return changed


def moving_parent(m: Any, body: int) -> int:
    """Return the nearest body below `body` that has joints; 0 for the world."""
    parent = int(m.body_parentid[body])
    while parent > 0 and m.body_jntnum[parent] == 0:
        parent = int(m.body_parentid[parent])
    return parent


def carrier(m: Any, body: int) -> int:
    """Return the body with joints that `body` is, or is welded to; 0 for the world."""
    while body > 0 and m.body_jntnum[body] == 0:
        body = int(m.body_parentid[body])
    return body


def _joint_frame(m: Any, d: Any, joint: int) -> Array:
    """World orientation of the joint's frame: the body's, turned where its z axis is not the joint's."""
    body = d.xmat[m.jnt_bodyid[joint]].reshape(3, 3)
    axis = m.jnt_axis[joint]
    if np.array_equal(axis, [0.0, 0.0, 1.0]):
        return np.array(body)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    x /= np.sqrt(x @ x)
    return np.array(body @ np.column_stack([x, np.cross(axis, x), axis]))


def lump(m: Any, d: Any, bodies: Sequence[int], R: Array, p: Array) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia about it of bodies that move as one, in a frame of orientation R and origin p.

    Args:
        m, d: MuJoCo's model, and its data with the bodies placed.
        bodies: Numbers of the bodies.
        R: Axes of the frame, (3, 3).
        p: Its origin, (3,) [m].
    """
    masses = np.array([m.body_mass[b] for b in bodies])
    total = float(np.sum(masses))
    centre = sum((m.body_mass[b] * d.xipos[b] for b in bodies), np.zeros(3)) / total if total > 0 else p
    inertia = np.zeros((3, 3))
    for b in bodies:
        axes = d.ximat[b].reshape(3, 3)
        away = d.xipos[b] - centre
        inertia += axes @ np.diag(m.body_inertia[b]) @ axes.T
        inertia += m.body_mass[b] * (away @ away * np.eye(3) - np.outer(away, away))
    return total, R.T @ (centre - p), R.T @ inertia @ R
