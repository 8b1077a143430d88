"""Error of the tool: how far it is from where the reference has it, and turned by how much; by forward kinematics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, shared
from torquebench.robot import RobotModel


class ToolError(NamedTuple):
    """Error of the tool at N positions of the joints, (N,)."""

    distance: Array
    """From where it should be [m]."""
    angle: Array
    """By which it is turned from how it should be [rad]."""


def tool_error(arm: RobotModel, q: Array, q_ref: Array) -> ToolError:
    """Return how far an arm's tool is from where the reference has it.

    With R the orientations and d = |R - R_ref|, the root of the sum of squares, the angle is 2 asin(d / sqrt 8), which
    loses no digits where it is small.

    Args:
        arm: The arm.
        q: Joint positions, (N, n) [rad].
        q_ref: Desired joint positions, (N, n) [rad].
    """
    gap = arm.forward_kinematics(q) - arm.forward_kinematics(q_ref)
    apart = np.linalg.norm(gap[:, :3, :3], axis=(1, 2))
    return ToolError(np.linalg.norm(gap[:, :3, 3], axis=1), 2.0 * np.arcsin(np.minimum(apart / np.sqrt(8.0), 1.0)))


@shared
def _in_window(run: JointRecord) -> ToolError:
    if run.arm is None:
        return ToolError(np.full(1, np.nan), np.full(1, np.nan))
    return tool_error(run.arm, run.q[run.window], run.q_ref[run.window])


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x * x)))


@metric("tool_rmse", title="RMS tool error", unit="m", of_tool=True, column="tool", shown_as=("mm", 1e3))
def tool_rmse(run: JointRecord) -> Array:
    """sqrt(mean d^2) over the window, d the tool's distance from where it should be; of paths of the tool only."""
    return _rms(_in_window(run).distance)


@metric("tool_max_error", title="maximum tool error", unit="m", of_tool=True, column="tool max", shown_as=("mm", 1e3))
def tool_max_error(run: JointRecord) -> Array:
    """Max d over the window."""
    return np.asarray(np.max(_in_window(run).distance))


@metric("tool_turn_rmse", title="RMS turn of the tool", unit="rad", of_tool=True, column="tool turn")
def tool_turn_rmse(run: JointRecord) -> Array:
    """sqrt(mean angle^2) over the window, of the turn from the desired orientation."""
    return _rms(_in_window(run).angle)


@metric("tool_max_turn", title="maximum turn of the tool", unit="rad", of_tool=True, column="")
def tool_max_turn(run: JointRecord) -> Array:
    """Max angle over the window."""
    return np.asarray(np.max(_in_window(run).angle))
