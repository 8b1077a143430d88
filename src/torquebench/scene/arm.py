"""An arm as a page draws it: its bodies, how joints move them, their triangles, and where the camera stands."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.mjcf import tool_frame
from torquebench.scene import shapes
from torquebench.scene.look import VISIBLE_GROUPS, Scene
from torquebench.scene.shapes import Triangles

_KIND = mujoco.mjtGeom
_UNSET = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
"""MuJoCo's colour of a geom without one, which is shown in its material's colour."""


class Joint(NamedTuple):
    """Joint that moves a body against its parent: a turn by q - zero about an axis, or a slide by it along the axis."""

    of_q: int
    """Place in q."""
    slides: bool
    axis: Array
    """(3,), in the body's frame."""
    place: Array
    """A point of the axis in the body's frame, (3,) [m]."""
    zero: float
    """Position at which the body is where `Body` says [rad or m]."""


class Part(NamedTuple):
    """One geom's surface, in its body's frame."""

    colour: Array
    """Red, green and blue from 0 to 1, (3,)."""
    surface: Triangles


class Body(NamedTuple):
    """One body; its frame is that of its parent, moved and turned, and then moved by its joints in order."""

    parent: int
    """Place of the parent in `Arm.bodies`; of the world its own, 0."""
    place: Array
    """(3,) [m]."""
    turn: Array
    """Unit quaternion (w, x, y, z)."""
    joints: tuple[Joint, ...]
    parts: tuple[Part, ...]
    moves: bool
    """Whether it moves with a joint, so that the reference has it too."""


class View(NamedTuple):
    """The scene's first camera."""

    eye: Array
    """(3,) [m]."""
    target: Array
    """The point on its axis nearest to the scene's centre, (3,) [m]."""
    opening: float
    """Vertical field of view [rad]."""


class Arm(NamedTuple):
    """An arm that can be drawn at any pose."""

    bodies: tuple[Body, ...]
    """Parents come before their children; the first is the world."""
    tool: tuple[int, Array]
    """The tool's body, and its place in that body's frame, (3,) [m]."""
    floor: float
    """Height of the floor [m]."""
    view: View


def read_arm(scene: Scene) -> Arm:
    """Return the arm of a scene.

    Raises:
        ModelError: it cannot be drawn.
    """
    m = scene.model
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    mujoco.mj_camlight(m, d)
    where = tool_frame(m, d, "arm")[1]
    last = int(m.jnt_bodyid[-1])
    tool = d.xmat[last].reshape(3, 3).T @ (where - d.xpos[last])
    floor = float(d.geom_xpos[m.geom_type == _KIND.mjGEOM_PLANE, 2][0])
    return Arm(tuple(body_of(m, b) for b in range(m.nbody)), (last, tool), floor, _view(scene, d))


def body_of(m: Any, body: int) -> Body:
    """Return a body of a compiled model by its number; errors as of `triangles`."""
    joints = [
        Joint(
            int(m.jnt_qposadr[j]),
            bool(m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE),
            m.jnt_axis[j].copy(),
            m.jnt_pos[j].copy(),
            float(m.qpos0[m.jnt_qposadr[j]]),
        )
        for j in range(m.njnt)
        if m.jnt_bodyid[j] == body
    ]
    visible = [
        g
        for g in range(m.ngeom)
        if m.geom_bodyid[g] == body and m.geom_group[g] <= VISIBLE_GROUPS and m.geom_type[g] != _KIND.mjGEOM_PLANE
    ]
    parts = tuple(Part(colour(m, g), in_body(m, g)) for g in visible)
    place, turn = m.body_pos[body].copy(), m.body_quat[body].copy()
    return Body(int(m.body_parentid[body]), place, turn, tuple(joints), parts, bool(m.body_weldid[body] != 0))


def _view(scene: Scene, d: Any) -> View:
    m = scene.model
    eye, back = d.cam_xpos[0].copy(), d.cam_xmat[0].reshape(3, 3)[:, 2]
    away = max(float((eye - m.stat.center) @ back), 0.1 * scene.reach)
    return View(eye, eye - away * back, float(np.deg2rad(m.cam_fovy[0])))


def colour(m: Any, geom: int) -> Array:
    """Return the colour of a geom, (3,): its own or, without one, its material's."""
    own, material = m.geom_rgba[geom], int(m.geom_matid[geom])
    rgba: Array = np.array(m.mat_rgba[material] if material >= 0 and np.array_equal(own, _UNSET) else own)
    return rgba[:3]


def in_body(m: Any, geom: int) -> Triangles:
    """Return the surface of a geom in its body's frame; errors as of `triangles`."""
    turn, shape = np.empty(9), triangles(m, geom)
    mujoco.mju_quat2Mat(turn, m.geom_quat[geom])
    matrix = turn.reshape(3, 3)
    return Triangles(shape.corners @ matrix.T + m.geom_pos[geom], shape.normals @ matrix.T)


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
