"""Where a point of the world lies in a camera's picture, and cameras that see the same in any shape of frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.kernel import Array


class Lens(NamedTuple):
    """A camera fixed in the world."""

    position: Array
    """(3,) [m]."""
    axes: Array
    """Columns: right, up and backward in the world, (3, 3)."""
    slope: float
    """Tangent of half the vertical opening."""


def lens(model: Any, camera: int, width: int, height: int) -> Lens:
    """Return a camera of a model; in a frame higher than wide it opens as wide as in a square one.

    Args:
        model: Compiled model; the camera's opening is set in it.
        camera: Its number.
        width, height: Size of the frame [px].
    """
    slope = float(np.tan(np.deg2rad(model.cam_fovy[camera]) / 2.0)) * max(1.0, height / width)
    model.cam_fovy[camera] = 2.0 * np.rad2deg(np.arctan(slope))
    d = mujoco.MjData(model)
    mujoco.mj_kinematics(model, d)
    mujoco.mj_camlight(model, d)
    return Lens(d.cam_xpos[camera].copy(), d.cam_xmat[camera].reshape(3, 3).copy(), slope)


def project(view: Lens, points: Array, width: int, height: int) -> Array:
    """Return the pixels of points, (N, 2): to the right and down from the frame's upper left corner.

    Args:
        view: The camera.
        points: (N, 3) [m], in front of it.
        width, height: Size of the frame [px].
    """
    inside = (points - view.position) @ view.axes
    scale = 0.5 * height / view.slope / np.maximum(-inside[:, 2], 1e-9)
    return np.stack([0.5 * width + scale * inside[:, 0], 0.5 * height - scale * inside[:, 1]], axis=1)
