"""A chain as an MJCF file of its own: bodies at the zero position, inertias lumped, numbers in full precision."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import did_you_mean
from torquebench.kernel import Array
from torquebench.robot.importing.chain import Chain, Options, body_name, is_zero
from torquebench.robot.importing.findings import Part
from torquebench.robot.importing.forces import Forces
from torquebench.robot.mjcf_links import GIVEN, SPEEDS, joint_name, lump

TOOLS = ("tool", "tcp", "attachment_site", "ee", "ee_site", "eef", "eef_site", "end_effector", "grip_site", "pinch")
"""Sites that are the tool, in this order."""
_ROUNDING = 4e-15
"""Error that the turns between two links leave in a number that was round."""


def write(chain: Chain, forces: Forces, options: Options, name: str, source: str) -> str:
    """Return the text of a chain's MJCF file.

    Args:
        chain: The chain.
        forces: Its forces.
        options: Which site or body is the tool.
        name: Name of the arm.
        source: Name of the published file.
    """
    m, d = chain.model, chain.at(np.zeros(len(chain.joints)))
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = ElementTree.SubElement(root, "option", timestep="0.001", integrator="RK4", gravity=text_of(forces.gravity))
    ElementTree.SubElement(option, "flag", contact="disable", autoreset="disable")
    parent = ElementTree.SubElement(root, "worldbody")
    R, p, names = np.eye(3), np.zeros(3), _Names()
    for body in dict.fromkeys(int(m.jnt_bodyid[j]) for j in chain.joints):
        rigid = [b for b in range(1, m.nbody) if b not in chain.removed and chain.link(b) == body]
        turn = d.xmat[body].reshape(3, 3)
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, (R.T @ turn).ravel())
        place = _exact(R.T @ (d.xpos[body] - p), m.body_pos[body])
        quat = _exact(quat, m.body_quat[body], -m.body_quat[body])
        parent = ElementTree.SubElement(parent, "body", name=names(body_name(m, body)), pos=text_of(place))
        if not np.array_equal(quat, [1.0, 0.0, 0.0, 0.0]):
            parent.set("quat", text_of(quat))
        R, p = turn, d.xpos[body].copy()
        _inertial(parent, chain, d, rigid, R, p)
        for i, j in enumerate(chain.joints):
            if int(m.jnt_bodyid[j]) == body:
                at = _exact(R.T @ (d.xanchor[j] - p), m.jnt_pos[j])
                _joint(parent, chain, forces, i, at, _exact(R.T @ d.xaxis[j], m.jnt_axis[j]))
    where, axes, what = tool_of(chain, d, options)
    site = ElementTree.SubElement(parent, "site", name="tool", pos=text_of(clean(R.T @ (where - p))))
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, (R.T @ axes).ravel())
    if not np.array_equal(clean(quat), [1.0, 0.0, 0.0, 0.0]):
        site.set("quat", text_of(clean(quat)))
    chain.findings.append(Part("kept", "tool", (what,), "the site tool of the last link; --tool names another"))
    motors = ElementTree.SubElement(root, "actuator")
    for j, limit in zip(chain.joints, forces.torque_limits, strict=True):
        joint, most = joint_name(m, j), float(limit)
        ElementTree.SubElement(
            motors, "motor", name=joint, joint=joint, ctrllimited="true", ctrlrange=text_of([-most, most])
        )
    some = np.isfinite(forces.speeds)
    told = {SPEEDS: np.where(some, forces.speeds, 0.0)} if np.any(some) else {}
    told |= {GIVEN: forces.given} if np.any(forces.given) else {}
    if told:
        custom = ElementTree.SubElement(root, "custom")
        for key, numbers in told.items():
            ElementTree.SubElement(custom, "numeric", name=key, data=text_of(numbers))
    keys = ElementTree.SubElement(root, "keyframe")
    ElementTree.SubElement(keys, "key", name="home", qpos=text_of(chain.home[chain.places]))
    return to_text(root, f"Imported from {source} by torquebench; README.md says what was kept and what was left out.")


def to_text(root: Any, comment: str) -> str:
    """Return an element as the text of a file.

    Args:
        root: The element.
        comment: The first line.
    """
    ElementTree.indent(root, "  ")
    body = ElementTree.tostring(root, encoding="unicode").replace(" />", "/>")
    return f"<!-- {comment.replace('--', '- -')} -->\n{body}\n"


def tool_of(chain: Chain, d: Any, options: Options) -> tuple[Array, Array, str]:
    """Return place (3,) [m] and axes (3, 3) of the tool in the world, and what it is called in the published file.

    Args:
        chain: The chain.
        d: Its data, kinematics done.
        options: Which site or body is the tool; a wrong one is added to the findings.
    """
    m = chain.model
    last = chain.link(int(m.jnt_bodyid[chain.joints[-1]]))
    carried = [b for b in range(1, m.nbody) if b not in chain.removed and chain.link(b) == last]
    sites = {
        mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_SITE, s) or "": s
        for s in range(m.nsite)
        if int(m.site_bodyid[s]) in carried
    }
    bodies = {body_name(m, b): b for b in carried}
    if options.tool and options.tool not in (*sites, *bodies):
        among = [name for name in sites if name] + list(bodies)
        reason = f"no site or body of the last link is called so{did_you_mean(options.tool, among)}"
        chain.findings.append(Part("refused", "--tool", (options.tool,), reason))
    for name in [options.tool] if options.tool else [] if options.tip else TOOLS:
        if name in sites:
            return d.site_xpos[sites[name]].copy(), d.site_xmat[sites[name]].reshape(3, 3).copy(), f"site {name}"
    name = next((word for word in (options.tool, options.tip) if word in bodies), body_name(m, _end(m, last, carried)))
    body = bodies[name]
    return d.xpos[body].copy(), d.xmat[body].reshape(3, 3).copy(), f"body {name}"


def _end(m: Any, link: int, carried: Sequence[int]) -> int:
    """Return the last body of those that a link carries; where they branch, as a gripper's fingers do, the one before.

    Args:
        m: The compiled model.
        link: The link.
        carried: It, and the bodies that are welded to it.
    """
    while len(below := [b for b in carried if b != link and int(m.body_parentid[b]) == link]) == 1:
        link = below[0]
    return link


class _Names:
    """Names of bodies, each given once."""

    def __init__(self) -> None:
        self.given = set[str]()

    def __call__(self, name: str) -> str:
        while name in self.given:
            name += "_"
        self.given.add(name)
        return name


def _joint(parent: Any, chain: Chain, forces: Forces, i: int, place: Array, axis: Array) -> None:
    """Write joint `i` of a chain."""
    m, j = chain.model, chain.joints[i]
    kind = "slide" if m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE else "hinge"
    joint = ElementTree.SubElement(parent, "joint", name=joint_name(m, j), type=kind, axis=text_of(axis))
    if not is_zero(place):
        joint.set("pos", text_of(place))
    for key, value in (("armature", forces.armature), ("damping", forces.damping), ("frictionloss", forces.friction)):
        if value[i]:
            joint.set(key, text_of([value[i]]))
    if not is_zero(forces.range[i]):
        joint.set("limited", "true" if forces.limited[i] else "false")
        joint.set("range", text_of(forces.range[i]))


def _inertial(parent: Any, chain: Chain, d: Any, bodies: Sequence[int], R: Array, p: Array) -> None:
    """Write the inertia of bodies that move as one, in the frame of the first."""
    m = chain.model
    heavy = [b for b in bodies if m.body_mass[b] > 0 or not is_zero(m.body_inertia[b])]
    if heavy == [bodies[0]]:
        b = heavy[0]
        mass, centre, turn, moments = float(m.body_mass[b]), m.body_ipos[b], m.body_iquat[b], m.body_inertia[b]
    else:
        mass, centre, inertia = lump(m, d, heavy, R, p)
        moments, directions = np.linalg.eigh(inertia)
        moments, directions = moments[::-1], directions[:, ::-1].copy()
        directions[:, 2] *= np.sign(np.linalg.det(directions))
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, directions.ravel())
        turn *= -1.0 if turn[int(np.argmax(np.abs(turn)))] < 0 else 1.0
        centre, turn = clean(centre), clean(turn)
    low, middle, high = np.sort(moments)
    last = bodies[0] == int(m.jnt_bodyid[chain.joints[-1]])
    several = int(np.sum(m.jnt_bodyid[list(chain.joints)] == bodies[0])) > 1
    if mass <= 0 or low <= 0:
        where = body_name(m, bodies[0])
        if heavy or last or not several:
            text = "neither it nor what is welded to it has mass and inertia: give it an <inertial> in the file"
            before = any(part.what == "link without inertia" for part in chain.findings)
            flags = ("--fix", where) if last and not before and len(chain.joints) > 1 else ()
            chain.findings.append(Part("refused", "link without inertia", (where,), text, flags))
        return
    if low + middle < high * (1.0 - 1e-9):
        text = f"the two smaller of {' '.join(f'{x:.4g}' for x in moments)} kg m^2 add up to less than the largest, "
        text += "which no body has; --drop impossible-inertia makes each their mean"
        flags = ("--drop", "impossible-inertia")
        chain.findings.append(Part("refused", "impossible inertia", (body_name(m, bodies[0]),), text, flags))
    inertial = ElementTree.SubElement(parent, "inertial", mass=text_of([mass]), pos=text_of(centre))
    if not np.array_equal(turn, [1.0, 0.0, 0.0, 0.0]):
        inertial.set("quat", text_of(turn))
    inertial.set("diaginertia", text_of(moments))


def _exact(values: Array, *published: Array) -> Array:
    """Return the published numbers that computed ones are but for rounding, else those, cleaned.

    Args:
        values: The computed ones.
        *published: What they may have come from.
    """
    for numbers in published:
        if np.max(np.abs(values - numbers)) <= _ROUNDING:
            return np.array(numbers) + 0.0
    return clean(values)


def clean(values: Array, scale: float = 1.0) -> Array:
    """Return computed numbers, those of few digits without the rounding of their computation.

    Args:
        values: The numbers.
        scale: Size of what they were computed from.
    """
    short = np.array([float(f"{x:.12g}") if abs(x) > _ROUNDING * scale else 0.0 for x in values])
    cleaned: Array = np.where(np.abs(values - short) <= _ROUNDING * scale, short, values) + 0.0
    return cleaned


def text_of(values: Any) -> str:
    """Return numbers as they are written in a file, each read back as the same number."""
    return " ".join(repr(float(x)).removesuffix(".0") for x in values)
