"""Facts about an arm's joints from the arm's file, with the source of each number."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.flat_model import SLIDE, force_unit
from torquebench.robot.library import ArmSource, file_of_arm
from torquebench.robot.robot_model import RobotModel

ROUNDED = 1e-9
"""Relative change by rounding of a torque at its limit, at most [1]."""
TWITCH = 10.0
"""Change of speed in one control period, by full torque, from which it is said that a rotor's inertia is missing
[rad/s]."""
_COMMENT = re.compile(r"\s*(?:<\?xml.*?\?>\s*)?<!--(?! torquebench: )(.*?)-->", re.DOTALL)


class Number(NamedTuple):
    """A number of a joint."""

    value: float | tuple[float, float] | None
    """In SI units; two for a range; None for no limit."""
    unit: str
    source: Literal["file", "table", "assumed"]
    """The arm's file; a table that was given to ``torquebench import``; or, as neither has any, none or zero."""


class JointFacts(NamedTuple):
    """A joint as its arm's file has it."""

    joint: str
    kind: Literal["hinge", "slide"]
    range: Number
    """Position limits; the file's own even where it does not enforce them."""
    enforced: bool
    """Whether the range is a limit in the file: a run then tells where it is left, or stops there."""
    speed: Number
    torque: Number
    armature: Number
    damping: Number
    friction: Number


class ArmFacts(NamedTuple):
    """An arm as its file has it."""

    arm: str
    file: Path | None
    comment: str
    """What the file begins with, where that is a comment."""
    changes: tuple[str, ...]
    """What was left out or changed of the file."""
    keyframes: tuple[str, ...]
    joints: tuple[JointFacts, ...]
    remarks: tuple[str, ...] = ()
    """Torque that holds it at its first keyframe, or at zero without one, and joints that lack a rotor's inertia."""


def holding(arm: RobotModel, q: Array, tau_max: Array, where: str) -> tuple[str, bool]:
    """Return what gravity takes of the joint that has the least to spare, and whether that is more than it has.

    Args:
        arm: The arm.
        q: A pose, (n,) [rad].
        tau_max: Torque limits, (n,) [N m].
        where: What the pose is called.
    """
    gravity = np.abs(arm.gravity(q[None])[0])
    worst = int(np.argmax(gravity / tau_max))
    unit, joint = force_unit(arm.flat.kind[worst]), arm.joint_names[worst]
    took, most = f"{gravity[worst]:.4g} {unit}", f"{tau_max[worst]:.4g} {unit}"
    if gravity[worst] > tau_max[worst] * (1.0 + ROUNDED):
        text = f"the arm cannot hold itself {where}: gravity alone needs {took} of {joint}, its limit is {most}"
        return text, True
    return f"holding the arm {where} takes {took} of {joint}, its limit is {most}", False


def without_rotor(arm: RobotModel, q: Array, control_period: float = 1e-3) -> str:
    """Return a line on joints without armature that full torque moves too far in one control period, or nothing.

    It changes their speed by T tau_max (M^-1)_ii, which is more than `TWITCH`.

    Args:
        arm: The arm.
        q: A pose, (n,) [rad].
        control_period: T [s].
    """
    change = control_period * arm.flat.tau_max * np.diag(np.linalg.inv(arm.mass_matrix(q[None])[0]))
    change = np.where((arm.flat.armature == 0.0) & (arm.flat.kind != SLIDE), change, 0.0)
    joints = [arm.joint_names[i] for i in np.flatnonzero(change > TWITCH)]
    if not joints:
        return ""
    worst = arm.joint_names[int(np.argmax(change))]
    return (
        f"no armature, the inertia of the rotor, of {', '.join(joints)}: full torque changes the speed of {worst} by "
        f"{np.max(change):.3g} rad/s in {1e3 * control_period:.4g} ms, which only soft laws or shorter periods stand"
    )


def arm_facts(source: ArmSource) -> ArmFacts:
    """Return what an arm's file says of its joints.

    Args:
        source: Name of a model in ``models/``, path of an MJCF or URDF file, or an arm that was read from one.

    Raises:
        ModelError: there is no such arm, or not one that laws can drive.
    """
    from torquebench.robot import load_model, mjcf

    file = file_of_arm(source)
    arm = mjcf.read_arm(file)
    m, passive = mjcf.compile_arm(arm)
    (low, high), limits, given = mjcf.ranges(m), mjcf.torque_limits(m)[0], mjcf.limits_given(m)
    comment = _COMMENT.match(file.text)
    joints = []
    for i, name in enumerate(mjcf.joint_names(m)):
        slides = mjcf.is_slide(m, i)
        bounds = _number((float(low[i]), float(high[i])), "m" if slides else "rad")
        force, turn, per_turn = ("N", "m", "N s/m") if slides else ("N m", "rad", "N m s/rad")
        torque = Number(float(limits[i]), force, "table" if given[i] else "file")
        joints.append(
            JointFacts(
                name,
                "slide" if slides else "hinge",
                bounds,
                math.isfinite(passive.low[i]) or math.isfinite(passive.high[i]),
                _number(passive.speed[i], f"{turn}/s"),
                torque,
                _number(float(m.dof_armature[i]), "kg" if slides else "kg m^2"),
                _number(passive.viscous[i], per_turn),
                _number(passive.coulomb[i], force),
            )
        )
    text = "" if comment is None else " ".join(comment[1].split())
    keys, model = mjcf.keyframes(m), load_model(arm)
    pose, where = next(((q, f"at key:{name}") for name, q in keys.items()), (np.zeros(m.nq), "at zero"))
    told = holding(model, pose, limits, where)[0], without_rotor(model, pose)
    return ArmFacts(file.name, file.origin, text, arm.remarks, tuple(keys), tuple(joints), tuple(filter(None, told)))


def _number(value: float | tuple[float, float], unit: str) -> Number:
    """Return a number that is the file's unless it is what stands for none: zero, or an infinite limit."""
    if isinstance(value, tuple):
        return Number(value, unit, "file") if any(map(math.isfinite, value)) else Number(None, unit, "assumed")
    if math.isinf(value):
        return Number(None, unit, "assumed")
    return Number(value, unit, "file" if value else "assumed")
