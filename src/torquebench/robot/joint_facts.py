"""What an arm's file says of its joints, and where each number is from."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Literal, NamedTuple

from torquebench.robot.library import ArmSource, file_of_arm

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


def arm_facts(source: ArmSource) -> ArmFacts:
    """Return what an arm's file says of its joints.

    Args:
        source: Name of a model in ``models/``, path of an MJCF or URDF file, or an arm that was read from one.

    Raises:
        ModelError: there is no such arm, or not one that laws can drive.
    """
    from torquebench.robot import mjcf

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
    return ArmFacts(file.name, file.origin, text, arm.remarks, tuple(mjcf.keyframes(m)), tuple(joints))


def _number(value: float | tuple[float, float], unit: str) -> Number:
    """Return a number that is the file's unless it is what stands for none: zero, or an infinite limit."""
    if isinstance(value, tuple):
        return Number(value, unit, "file") if any(map(math.isfinite, value)) else Number(None, unit, "assumed")
    if math.isinf(value):
        return Number(None, unit, "assumed")
    return Number(value, unit, "file" if value else "assumed")
