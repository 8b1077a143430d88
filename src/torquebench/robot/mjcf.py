"""Reading MJCF: compiling a model safely, and turning a serial arm into the flat arrays of the analytic side."""

from __future__ import annotations

import dataclasses
import functools
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.errors import ModelError, Problem
from torquebench.kernel import Array
from torquebench.robot.flat_model import HINGE, SLIDE, Model, own_copy, rigid_model
from torquebench.robot.library import ArmFile, ArmSource, file_of_arm
from torquebench.robot.links import check_physical
from torquebench.robot.mjcf_links import (
    GIVEN,
    ON_JOINT,
    SPEEDS,
    at_zero,
    carrier,
    frames,
    joint_name,
    links_of,
    moving_parent,
    numeric,
    speed_limits,
)
from torquebench.robot.mjcf_text import listed, refused_inside, remarks_in, standing_alone, urdf_speeds, with_remarks
from torquebench.robot.robot_model import Passive, RobotModel

_OFF = mujoco.mjtDisableBit


class Compiled(NamedTuple):
    """An arm's file, compiled."""

    model: Any
    """``MjModel`` without friction and limits of the joints, which act otherwise; not to be written to."""
    passive: Passive
    """The friction and the limits."""


def compile_arm(source: ArmSource) -> Compiled:
    """Compile an arm: a shipped one, one that was read, or a file that stands alone.

    Raises:
        ModelError: there is no such arm, its file cannot be read, refers to other files, does not compile, or has a
            time step, mass or inertia that MuJoCo's compiler lets pass although no simulation can use it.
    """
    return _compiled(read_arm(source, is_serial=False))


def read_arm(source: ArmSource, is_serial: bool = True) -> ArmFile:
    """Return an arm whose text stands alone.

    Args:
        source: The name of a shipped arm, a file, or an arm that was read already.
        is_serial: Whether it must be an arm that the analytic side can represent.

    Raises:
        ModelError: it is not; all reasons at once.
    """
    return _read(file_of_arm(source), is_serial)


@functools.lru_cache(maxsize=32)
def _read(arm: ArmFile, is_serial: bool) -> ArmFile:
    text, told, problems, compiles = standing_alone(arm.text)
    left_out, reasons = remarks_in(text) or (*arm.remarks, *told), list[Problem | str](problems)
    read, broken = dataclasses.replace(arm, text=with_remarks(text, left_out), remarks=left_out), None
    try:
        if compiles:
            m = _compiled(read).model
            reasons += (*torque_limits(m)[1], *(unrepresented(m) if is_serial else ()))
    except ModelError as error:  # without what it needs it may well not compile
        broken = None if reasons else error
    if (reasons or broken) and arm.origin is not None:
        return _imported(arm, arm.origin, reasons)
    if broken:
        raise broken
    if reasons:
        raise ModelError.of_file(str(arm), reasons)
    return read


def _imported(arm: ArmFile, path: Path, reasons: Sequence[Problem | str]) -> ArmFile:
    """Return the plain chain that an import makes of a file which cannot be taken as it is, for `reasons`."""
    if inside := refused_inside(path):
        known = {problem.text for problem in inside}
        raise ModelError.of_file(str(path), [*(one for one in reasons if _text(one) not in known), *inside])
    from torquebench.robot.importing import RefusedArmError, import_arm

    try:
        made = import_arm(path)
    except RefusedArmError as error:
        flags = " ".join(error.flags)
        hint = [f"torquebench import {shlex.quote(str(path))} {flags} makes an arm of it"] if flags else []
        raise ModelError.of_file(str(path), [*error.problems, *hint]) from error
    except ModelError as error:
        raise ModelError.of_file(str(path), [*reasons, *error.problems]) from error
    told = [
        f"{part.verdict} {part.what} ({listed(part.places)})" if part.places else f"{part.verdict} {part.what}"
        for part in made.findings
        if part.verdict != "kept"
    ]
    text = f"is made a plain chain: {'; '.join(told) or 'nothing is left out'}"
    return _read(ArmFile(arm.name, made.mjcf, (text,)), is_serial=True)


def _text(reason: Problem | str) -> str:
    return reason if isinstance(reason, str) else reason.text


@functools.lru_cache(maxsize=32)
def _compiled(arm: ArmFile) -> Compiled:
    try:
        m = mujoco.MjModel.from_xml_string(arm.text)
    except (ValueError, RuntimeError, MemoryError) as error:
        raise ModelError(f"{arm}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error
    if not (np.isfinite(m.opt.timestep) and m.opt.timestep > 0):
        raise ModelError(f"{arm}: timestep is {m.opt.timestep}, wanted finite and positive")
    if unsound := _unsound(m):
        raise ModelError(f"{arm}: {unsound}")
    if (speeds := speed_limits(m)) is None:
        raise ModelError(f"{arm}: <numeric {SPEEDS}> wants a number for each of {m.njnt} joints, 0 for no limit")
    if "<robot" in arm.text:
        stated = urdf_speeds(arm.text)
        speeds = np.array([stated.get(name, np.inf) for name in joint_names(m)])
    damped, rubs, limited = not _is_off(m, "DAMPER"), not _is_off(m, "FRICTIONLOSS", "CONSTRAINT"), _has_limits(m)
    none = np.zeros(m.nv)
    passive = Passive(
        tuple((m.dof_damping if damped else none).tolist()),
        tuple((m.dof_frictionloss if rubs else none).tolist()),
        tuple(np.where(limited, m.jnt_range[:, 0], -np.inf).tolist()),
        tuple(np.where(limited, m.jnt_range[:, 1], np.inf).tolist()),
        tuple(speeds.tolist()),
    )
    m.dof_damping[:], m.dof_frictionloss[:], m.jnt_limited[:] = 0.0, 0.0, 0
    return Compiled(m, passive)


LARGEST, QUICKEST, FLATTEST = 1e12, 1e12, 1e-12
"""No arm has a torque limit or a torque of gravity beyond the first [N m], gains speed faster than the second at its
limit [rad/s^2], or has joints whose mass matrix is nearer to singular than the third, scaled to a diagonal of ones."""


def _unsound(m: Any) -> str:
    """Return what of a compiled arm no simulation can use, finite as each number of its file may be; else nothing."""
    if m.nv == 0:
        return ""
    with np.errstate(all="ignore"):
        d, M = at_zero(m), np.zeros((m.nv, m.nv))
        mujoco.mj_crb(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_fullM(m, d, M)
        gravity = np.zeros(m.nv)
        mujoco.mj_rne(m, d, 0, gravity)
        own = np.sqrt(np.diag(M))
        if not (np.all(np.isfinite(M)) and np.all(own > 0.0)):
            return "its mass matrix at zero is not finite, or not positive"
        if not np.linalg.eigvalsh(M / own / own[:, None])[0] > FLATTEST:
            return "its mass matrix at zero is singular: two joints turn about one axis, or a link has no inertia"
        if not np.all(np.abs(gravity) < LARGEST):
            return f"gravity's torque at zero is {np.max(np.abs(gravity)):.3g} N m, wanted below {LARGEST:g}"
        limits = torque_limits(m)[0]
        limits = limits[np.isfinite(limits)]
        if np.any(limits > LARGEST):
            return f"its torque limit is {np.max(limits):.3g} N m, wanted at most {LARGEST:g}"
        if len(limits) == m.nv and not np.all(limits / own**2 < QUICKEST):
            return f"its torque limit makes {np.max(limits / own**2):.3g} rad/s^2 of it, wanted below {QUICKEST:g}"
    return ""


def _is_off(m: Any, *flags: str) -> bool:
    """Whether the file switches something off by one of these flags."""
    return any(m.opt.disableflags & getattr(_OFF, f"mjDSBL_{flag}") for flag in flags)


def _has_limits(m: Any) -> Array:
    limited: Array = (m.jnt_limited != 0) & (not _is_off(m, "LIMIT", "CONSTRAINT"))
    return limited


def features(m: Any) -> dict[str, list[str]]:
    """Return what an arm of hinges, slides, rigid bodies and motors has not, with what of this model has it.

    What the file's own flags switch off counts as not there, and so do geoms without a partner to touch.
    """

    def at(kind: Any, *arrays: Any) -> list[str]:
        found = np.unique([i for array in arrays for i in np.argwhere(array)[:, 0]])
        return [f"'{_name(m, kind, int(i))}'" for i in found]

    joint, body, actuator = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_ACTUATOR
    other = ~np.isin(m.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    damper, spring, constraint = (not _is_off(m, flag) for flag in ("DAMPER", "SPRING", "CONSTRAINT"))
    dof = m.dof_jntid
    damped = np.zeros(m.njnt)
    np.add.at(damped, dof, damper * np.abs(m.dof_dampingpoly).sum(axis=1))
    whole = ["the file"]
    return {
        "joints other than hinges and slides": at(joint, other),
        "joint damping that grows with speed": at(joint, damped),
        "joint stiffness": at(joint, spring * m.jnt_stiffness, spring * m.jnt_stiffnesspoly),
        "gravity compensation": at(body, m.body_gravcomp),
        "equality constraints": whole * (constraint and not _is_off(m, "EQUALITY") and m.neq > 0),
        "tendons": whole * (m.ntendon > 0),
        "a fluid": whole * (m.opt.density != 0 or m.opt.viscosity != 0),
        "actuator states": whole * (m.na > 0),
        "actuator armature": at(actuator, m.actuator_armature),
        "actuator damping": at(actuator, m.actuator_damping, m.actuator_dampingpoly),
        "plugins": whole * (m.nplugin > 0),
        "mocap bodies": whole * (m.nmocap > 0),
        "flexible bodies": whole * (m.nflex > 0),
        "colliding geoms": touching(m),
        "no joint at all": whole * (m.nv == 0),
    }


CURES = {
    "joint damping that grows with speed": "leave the polynomial out, or write the damping of usual speeds",
    "joint stiffness": 'leave it out, or switch it off by <flag spring="disable"/>',
    "gravity compensation": "leave gravcomp out: laws compensate gravity themselves",
    "equality constraints": "leave them out",
    "tendons": "leave them out",
    "a fluid": "leave density and viscosity out",
    "actuator armature": "give it to the joint",
    "actuator damping": "give it to the joint",
    "colliding geoms": 'switch contacts off by <flag contact="disable"/>, or by contype="0" conaffinity="0"',
}
"""Feature -> what to do about it."""


def touching(m: Any) -> list[str]:
    """Return names of two geoms that MuJoCo would let touch each other; none where no geom has such a partner."""
    if _is_off(m, "CONTACT", "CONSTRAINT"):
        return []
    if m.npair > 0:
        return ["the file's contact pairs"]
    able = np.flatnonzero((m.geom_contype != 0) | (m.geom_conaffinity != 0))
    weld, excluded = m.body_weldid, set(m.exclude_signature.tolist())
    for i, a in enumerate(able):
        for b in able[i + 1 :]:
            masks = (m.geom_contype[a] & m.geom_conaffinity[b]) | (m.geom_contype[b] & m.geom_conaffinity[a])
            bodies = sorted((int(m.geom_bodyid[a]), int(m.geom_bodyid[b])))
            one, two = int(weld[bodies[0]]), int(weld[bodies[1]])
            if not masks or one == two or (bodies[0] << 16) + bodies[1] in excluded:
                continue
            parents = int(weld[m.body_parentid[one]]), int(weld[m.body_parentid[two]])
            if one and two and not _is_off(m, "FILTERPARENT") and (one == parents[1] or two == parents[0]):
                continue
            kind = mujoco.mjtObj.mjOBJ_GEOM
            return [f"'{_name(m, kind, int(a))}' and '{_name(m, kind, int(b))}'"]
    return []


def _name(m: Any, kind: Any, i: int) -> str:
    return mujoco.mj_id2name(m, kind, i) or f"number {i + 1}"


def unrepresented(m: Any) -> list[str]:
    """Return what the analytic side has no counterpart for: the element's name, and what to do about it.

    That is anything but hinges, slides, rigid bodies and motors, and anything but a single chain.
    """
    found = [(name, listed(names)) for name, names in features(m).items() if names]
    if not found and np.any((m.body_jntnum[m.jnt_bodyid] > 1) & (m.qpos0 != 0)):
        found.append(("a reference angle on a body with several joints", "the file"))
    parents = [moving_parent(m, b) for b in range(1, m.nbody) if m.body_jntnum[b] > 0]
    if len(set(parents)) != len(parents):
        found.append(("branches", "wanted one chain of moving bodies"))
    texts = [
        f"the analytic model cannot represent {name}{f' ({where})' * (where != 'the file')}" for name, where in found
    ]
    return [text + (f": {CURES[name]}" if name in CURES else "") for text, (name, _) in zip(texts, found, strict=True)]


def check_smooth(m: Any, where: str) -> None:
    """Refuse what the analytic side has no counterpart for; see `unrepresented`.

    Raises:
        ModelError: there is such a thing; all of them at once.
    """
    if reasons := unrepresented(m):
        raise ModelError.of_file(where, reasons)


def _gravity(m: Any) -> Array:
    return np.zeros(3) if _is_off(m, "GRAVITY") else np.array(m.opt.gravity)


def analytic_model(arm: ArmFile) -> RobotModel:
    """Return the EXACT model of an arm that was read, with scratch space of its own; see `flatten`."""
    kept = _analytic_model(arm)
    return RobotModel(kept.name, kept.joint_names, own_copy(kept.flat), kept.passive)


@functools.lru_cache(maxsize=32)
def _analytic_model(arm: ArmFile) -> RobotModel:
    m, passive = _compiled(arm)
    return RobotModel(arm.name, tuple(joint_names(m)), flatten(m, str(arm)), passive)


def flatten(m: Any, where: str) -> Model:
    """Return the EXACT model of a compiled serial arm, for the analytic side.

    See `frames` for the joints' frames, `links_of` for the links, `tool_frame` for the tool.

    Raises:
        ModelError: the model has something the analytic side cannot represent; see `check_smooth`.
    """
    check_smooth(m, where)
    n, d = int(m.nv), at_zero(m)
    links, (world_R, world_p) = links_of(m, d), frames(m, d)
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
        tau_max=torque_limits(m)[0],
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
    return [joint_name(m, j) for j in range(m.njnt)]


def is_slide(m: Any, joint: int) -> bool:
    """Whether a joint slides instead of turning."""
    return bool(m.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)


def ranges(m: Any) -> tuple[Array, Array]:
    """Return least and greatest position of each joint that a file states, enforced or not; infinite for none."""
    low, high = np.array(m.jnt_range).reshape(-1, 2).T
    told = high > low
    return np.where(told, low, -np.inf), np.where(told, high, np.inf)


def limits_given(m: Any) -> Array:
    """Return whether the torque limit of each joint is one that was given to an import, (n,)."""
    given = numeric(m, GIVEN)
    return np.zeros(m.njnt, dtype=bool) if given is None else given != 0


def keyframes(m: Any) -> dict[str, Array]:
    """Return the keyframes of a compiled model that have a name, each a position (nq,)."""
    names = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_KEY, k) for k in range(m.nkey)]
    return {name: np.array(m.key_qpos[k]) for k, name in enumerate(names) if name}


def torque_limits(m: Any) -> tuple[Array, list[str]]:
    """Return each joint's torque limit (n,) [N m], the sum of its motors' limits, at most its ``actuatorfrcrange``.

    A motor's limit is gear x the smaller of gain x control range and force range. Where there are reasons why laws
    cannot command torques by these actuators, the second part has them all.
    """
    total, own, reasons = np.zeros(int(m.nv)), np.full(int(m.nv), np.inf), list[str]()
    names = joint_names(m)

    def symmetric(limits: Array, what: str) -> float:
        if not (limits[0] == -limits[1] and limits[1] > 0):
            got = limits.tolist()
            reasons.append(f"{what}: torque range {got} is not symmetric about zero: wanted [-x, x]")
        return float(limits[1])

    for a in range(m.nu):
        kinds = (m.actuator_gaintype[a], m.actuator_biastype[a], m.actuator_dyntype[a])
        name = f"actuator '{_name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, a)}'"
        motor = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtDyn.mjDYN_NONE)
        if int(m.actuator_trntype[a]) not in ON_JOINT or kinds != motor:
            reasons.append(f"{name} is not a plain motor on a joint, <motor joint=...>: laws command torques")
            continue
        j, limit = int(m.jnt_dofadr[m.actuator_trnid[a, 0]]), np.inf
        if m.actuator_ctrllimited[a]:
            limit = abs(float(m.actuator_gainprm[a, 0])) * symmetric(m.actuator_ctrlrange[a], name)
        if m.actuator_forcelimited[a]:
            limit = min(limit, symmetric(m.actuator_forcerange[a], name))
        total[j] += abs(float(m.actuator_gear[a, 0])) * limit
    for j in range(m.njnt):
        if m.jnt_actfrclimited[j]:
            own[m.jnt_dofadr[j]] = symmetric(m.jnt_actfrcrange[j], f"joint '{names[j]}'")
    limits: Array = np.minimum(np.where(total > 0, total, np.inf), own)
    missing = [names[m.dof_jntid[j]] for j in np.flatnonzero(~np.isfinite(limits))]
    if missing and not reasons:
        reasons.append(f"no torque limit for {listed(missing)}: wanted a limited motor or actuatorfrcrange")
    return limits, reasons
