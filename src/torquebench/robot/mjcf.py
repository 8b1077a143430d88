"""Reading MJCF: compiling a model safely, and turning a serial arm into the flat arrays of the analytic side."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.flat_model import HINGE, SLIDE, Model, rigid_model
from torquebench.robot.links import check_physical
from torquebench.robot.mjcf_links import at_zero, carrier, frames, links_of, moving_parent
from torquebench.robot.robot_model import RobotModel

MAX_BYTES = 4 * 1024 * 1024
_OUTSIDE = ("include", "plugin", "extension", "mesh", "hfield", "texture", "skin", "model", "attach", "replicate")
_JOINT = mujoco.mjtTrn.mjTRN_JOINT
_TEXT = ("name", "class", "childclass", "model", "joint", "body", "site")
_NOT_NEGATIVE = ("mass", "density", "armature", "diaginertia", "damping", "frictionloss")


def compile_mjcf(path: Path) -> Any:
    """Compile an MJCF file that stands alone.

    Args:
        path: The XML file; at most 4 MiB, without includes, plugins or other files.

    Returns:
        The compiled ``mujoco.MjModel``.

    Raises:
        ModelError: the file cannot be read, refers to other files, does not compile, or has a time step, mass or
            inertia that MuJoCo's compiler lets pass although no simulation can use it.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelError(f"{path}: larger than {MAX_BYTES // 2**20} MiB")
        text = path.read_text(encoding="utf-8")
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise ModelError(f"{path}: not a readable MJCF file ({error})") from error
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ModelError(f"{path}: document types and entities are refused")
    for element in root.iter():
        if element.tag in _OUTSIDE:
            raise ModelError(f"{path}: <{element.tag}> is refused: a model must stand alone")
        if "file" in element.attrib:
            raise ModelError(f"{path}: <{element.tag} file=...> is refused: a model must stand alone")
        for key, value in element.attrib.items():
            if key in _TEXT:
                continue
            numbers = _numbers(value)
            if not np.all(np.isfinite(numbers)) or (key in _NOT_NEGATIVE and np.any(numbers < 0)):
                # MuJoCo's compiler turns a negative mass into zero without a word
                raise ModelError(f'{path}: <{element.tag} {key}="{value}"> is negative or not finite')
    try:
        m = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise ModelError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    if not (np.isfinite(m.opt.timestep) and m.opt.timestep > 0):
        raise ModelError(f"{path}: timestep is {m.opt.timestep}, wanted finite and positive")
    return m


def _numbers(text: str) -> Array:
    try:
        return np.array([float(word) for word in text.split()])
    except ValueError:
        return np.zeros(0)


def features(m: Any) -> dict[str, bool]:
    """Return what an arm of hinges, slides, rigid bodies and motors has not, and whether this model has it."""

    def nonzero(*names: str) -> bool:
        return any(np.any(getattr(m, name) != 0) for name in names)

    contacts = not m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    hinge_or_slide = np.isin(m.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    return {
        "joints other than hinges and slides": not np.all(hinge_or_slide),
        "joint damping": nonzero("dof_damping", "dof_dampingpoly"),
        "joint friction": nonzero("dof_frictionloss"),
        "joint stiffness": nonzero("jnt_stiffness", "jnt_stiffnesspoly"),
        "enforced joint limits": nonzero("jnt_limited"),
        "gravity compensation": nonzero("body_gravcomp"),
        "equality constraints": m.neq > 0,
        "tendons": m.ntendon > 0,
        "a fluid": m.opt.density != 0 or m.opt.viscosity != 0,
        "actuator states": m.na > 0,
        "actuator armature": nonzero("actuator_armature"),
        "actuator damping": nonzero("actuator_damping", "actuator_dampingpoly"),
        "plugins": m.nplugin > 0,
        "mocap bodies": m.nmocap > 0,
        "flexible bodies": m.nflex > 0,
        "colliding geoms": contacts and (m.npair > 0 or nonzero("geom_contype", "geom_conaffinity")),
        "no joint at all": m.nv == 0,
    }


def check_smooth(m: Any, where: str) -> None:
    """Refuse what the analytic side has no counterpart for.

    Raises:
        ModelError: the model has anything but hinges, slides, rigid bodies and motors, or is not a single chain.
    """
    several = m.body_jntnum[m.jnt_bodyid] > 1
    wrong = [name for name, present in features(m).items() if present]
    if not wrong and np.any(several & (m.qpos0 != 0)):
        wrong.append("a reference angle on a body with several joints")
    parents = [moving_parent(m, b) for b in range(1, m.nbody) if m.body_jntnum[b] > 0]
    if len(set(parents)) != len(parents):
        wrong.append("branches (wanted one chain of moving bodies)")
    if wrong:
        raise ModelError(f"{where}: the analytic model cannot represent {', '.join(wrong)}")


def _gravity(m: Any) -> Array:
    off = bool(m.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return np.zeros(3) if off else np.array(m.opt.gravity)


def flatten(m: Any, where: str) -> Model:
    """Return the EXACT model of a compiled serial arm, for the analytic side.

    See `frames` for the joints' frames, `links_of` for the links, `tool_frame` for the tool.

    Raises:
        ModelError: the model has something the analytic side cannot represent; see `check_smooth`.
    """
    check_smooth(m, where)
    n, d, links = int(m.nv), at_zero(m), links_of(m)
    world_R, world_p = frames(m)
    tool_R, tool_p = tool_frame(m, d, where)
    model = rigid_model(
        kind=[HINGE if t == mujoco.mjtJoint.mjJNT_HINGE else SLIDE for t in m.jnt_type],
        rotation=np.array([world_R[j].T @ world_R[j + 1] for j in range(n)]),
        offset=np.array([world_R[j].T @ (world_p[j + 1] - world_p[j]) for j in range(n)]),
        mass=links.mass,
        com=links.com,
        inertia=links.inertia,
        armature=links.armature,
        gravity=_gravity(m),
        tool_rotation=world_R[n].T @ tool_R.reshape(3, 3),
        tool_offset=world_R[n].T @ (tool_p - world_p[n]),
        tau_max=torque_limits(m, where),
        inertia_scale=np.ones(n),
    )
    arm = RobotModel(where, tuple(joint_names(m)), model)
    model = replace(model, inertia_scale=np.diag(arm.mass_matrix(np.zeros(n))).copy())
    check_physical(model, where)
    return model


def tool_frame(m: Any, d: Any, where: str) -> tuple[Array, Array]:
    """Return orientation (9,) and origin (3,) [m] of the tool in the world, from data with kinematics done.

    The site ``tool``, which must be on the last link, else the last body that belongs to that link.

    Raises:
        ModelError: the site is somewhere else.
    """
    last = int(m.jnt_bodyid[-1])
    site = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_SITE, "tool")
    if site < 0:
        body = max(b for b in range(1, m.nbody) if carrier(m, b) == last)
        return d.xmat[body], d.xpos[body]
    if carrier(m, int(m.site_bodyid[site])) != last:
        raise ModelError(f"{where}: the site 'tool' is not on the last link")
    return d.site_xmat[site], d.site_xpos[site]


def joint_names(m: Any) -> list[str]:
    """Names of the joints of a compiled model; unnamed ones are called by their number."""
    return [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_JOINT, j) or f"joint{j + 1}" for j in range(m.njnt)]


def keyframes(m: Any) -> dict[str, Array]:
    """Return the keyframes of a compiled model that have a name, each a position (nq,)."""
    names = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_KEY, k) for k in range(m.nkey)]
    return {name: np.array(m.key_qpos[k]) for k, name in enumerate(names) if name}


def torque_limits(m: Any, where: str) -> Array:
    """Return each joint's torque limit (n,) [N m]: the sum of its motors' limits, at most its ``actuatorfrcrange``.

    A motor's limit is gear x the smaller of gain x control range and force range.

    Raises:
        ModelError: an actuator is not a plain motor on a joint, a joint has no limit, or a range is not symmetric.
    """
    total, own = np.zeros(int(m.nv)), np.full(int(m.nv), np.inf)
    for a in range(m.nu):
        kinds = (m.actuator_trntype[a], m.actuator_gaintype[a], m.actuator_biastype[a], m.actuator_dyntype[a])
        if kinds != (_JOINT, mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtDyn.mjDYN_NONE):
            name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, a) or a + 1
            raise ModelError(f"{where}: actuator {name} is not a plain motor on a joint (laws command torques)")
        j, limit = int(m.actuator_trnid[a, 0]), np.inf
        if m.actuator_ctrllimited[a]:
            limit = abs(float(m.actuator_gainprm[a, 0])) * _symmetric(m.actuator_ctrlrange[a], where, j)
        if m.actuator_forcelimited[a]:
            limit = min(limit, _symmetric(m.actuator_forcerange[a], where, j))
        total[j] += abs(float(m.actuator_gear[a, 0])) * limit
    for j in range(m.nv):
        if m.jnt_actfrclimited[j]:
            own[j] = _symmetric(m.jnt_actfrcrange[j], where, j)
    limits: Array = np.minimum(np.where(total > 0, total, np.inf), own)
    if not np.all(np.isfinite(limits)):
        missing = ", ".join(name for name, x in zip(joint_names(m), limits, strict=True) if not np.isfinite(x))
        raise ModelError(f"{where}: no torque limit for {missing} (wanted a limited motor or actuatorfrcrange)")
    return limits


def _symmetric(limits: Array, where: str, joint: int) -> float:
    if not (limits[0] == -limits[1] and limits[1] > 0):
        raise ModelError(f"{where}: joint {joint + 1}: torque range {limits.tolist()} is not symmetric about zero")
    return float(limits[1])
