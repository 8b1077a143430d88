"""An arm as the page draws it: the triangles of each body, and the poses of bodies and tool."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.mjcf import tool_frame
from torquebench.video.scene import VISIBLE_GROUPS, Scene
from torquebench.view import shapes
from torquebench.view.shapes import Triangles

_KIND = mujoco.mjtGeom
_UNSET = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
"""MuJoCo's colour of a geom without one, which is shown in its material's colour."""


class Part(NamedTuple):
    """One body."""

    moves: bool
    """Whether it moves with a joint, so that the reference has it too."""
    shape: Triangles
    """In the body's frame."""
    colours: Array
    """(T, 3), red, green and blue from 0 to 1."""


class View(NamedTuple):
    """The scene's first camera."""

    eye: Array
    """(3,) [m]."""
    target: Array
    """The point on its axis nearest to the scene's centre, (3,) [m]."""
    opening: float
    """Vertical field of view [rad]."""


class Arm:
    """An arm that can be drawn at any pose.

    Args:
        scene: The arm.

    Raises:
        ModelError: it cannot be drawn.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, m = scene, scene.model
        self._d = mujoco.MjData(m)
        mujoco.mj_kinematics(m, self._d)
        mujoco.mj_camlight(m, self._d)
        visible = [
            g for g in range(m.ngeom) if m.geom_group[g] <= VISIBLE_GROUPS and m.geom_type[g] != _KIND.mjGEOM_PLANE
        ]
        self._bodies = sorted({int(m.geom_bodyid[g]) for g in visible})
        self.parts = tuple(self._part([g for g in visible if m.geom_bodyid[g] == body], body) for body in self._bodies)
        self.floor = float(self._d.geom_xpos[m.geom_type == _KIND.mjGEOM_PLANE, 2][0])
        self.view = self._view()

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the poses of the bodies of `parts` and the tool's place.

        Args:
            q: Joint positions, (N, n) [rad].

        Returns:
            Position [m] and unit quaternion (w, x, y, z) of each body, (N, B, 7), and the tool, (N, 3) [m].
        """
        m, d = self._scene.model, self._d
        bodies, tool = np.empty((len(q), len(self._bodies), 7)), np.empty((len(q), 3))
        for k, position in enumerate(q):
            d.qpos[:] = position
            mujoco.mj_kinematics(m, d)
            bodies[k, :, :3], bodies[k, :, 3:] = d.xpos[self._bodies], d.xquat[self._bodies]
            tool[k] = tool_frame(m, d, "arm")[1]
        return bodies, tool

    def _part(self, geoms: list[int], body: int) -> Part:
        """Join the geoms of a body in the body's frame; the kinematics must have been computed."""
        m, d = self._scene.model, self._d
        turn, origin = d.xmat[body].reshape(3, 3), d.xpos[body]
        corners, normals, colours = [], [], []
        for g in geoms:
            shape = triangles(m, g)
            own = turn.T @ d.geom_xmat[g].reshape(3, 3)
            corners.append(shape.corners @ own.T + turn.T @ (d.geom_xpos[g] - origin))
            normals.append(shape.normals @ own.T)
            colours.append(np.tile(colour(m, g), (len(shape.corners), 1)))
        fine = (
            np.round(np.concatenate(corners) / self._scene.reach, 6) * self._scene.reach
        )  # no gap where triangles share a corner
        return Part(bool(m.body_weldid[body] != 0), Triangles(fine, np.concatenate(normals)), np.concatenate(colours))

    def _view(self) -> View:
        m, d = self._scene.model, self._d
        eye, back = d.cam_xpos[0].copy(), d.cam_xmat[0].reshape(3, 3)[:, 2]
        away = max(float((eye - m.stat.center) @ back), 0.1 * self._scene.reach)
        return View(eye, eye - away * back, float(np.deg2rad(m.cam_fovy[0])))


def colour(m: Any, geom: int) -> Array:
    """Return the colour of a geom, (3,): its own or, without one, its material's."""
    own, material = m.geom_rgba[geom], int(m.geom_matid[geom])
    rgba: Array = np.array(m.mat_rgba[material] if material >= 0 and np.array_equal(own, _UNSET) else own)
    return rgba[:3]


def triangles(m: Any, geom: int) -> Triangles:
    """Return the surface of a geom in its own frame.

    Raises:
        ModelError: a geom of its kind cannot be drawn.
    """
    size, kind = m.geom_size[geom], int(m.geom_type[geom])
    if kind == _KIND.mjGEOM_SPHERE:
        return shapes.capsule(float(size[0]), 0.0)
    if kind == _KIND.mjGEOM_CAPSULE:
        return shapes.capsule(float(size[0]), float(size[1]))
    if kind == _KIND.mjGEOM_CYLINDER:
        return shapes.cylinder(float(size[0]), float(size[1]))
    if kind == _KIND.mjGEOM_ELLIPSOID:
        return shapes.ellipsoid(size)
    if kind == _KIND.mjGEOM_BOX:
        return shapes.box(size)
    if kind == _KIND.mjGEOM_MESH:
        mesh = int(m.geom_dataid[geom])
        faces = m.mesh_face[m.mesh_faceadr[mesh] :][: m.mesh_facenum[mesh]]
        corners: Array = m.mesh_vert[m.mesh_vertadr[mesh] :][faces].astype(np.float64)
        return shapes.flat(corners)
    raise ModelError(f"geom {geom} is a {_KIND(kind).name}, which the page cannot draw; wanted a solid or a mesh")
